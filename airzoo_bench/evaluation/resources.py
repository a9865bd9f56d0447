"""What a run may use of the machine."""

from __future__ import annotations

from dataclasses import dataclass

from airzoo_bench.core.progress import Progress, silent

__all__ = ["Resources"]


@dataclass(frozen=True)
class Resources:
    """What a run may use, and what it keeps; no number depends on it.

    Attributes
    ----------
    memory_bytes : int
        The most that a prediction file may make the run hold.
    jobs : int
        Threads or processes.
    progress : Progress
    keep : bool
        Keep what pictures need beside the scores, such as clouds.
    """

    memory_bytes: int = 2 << 30
    jobs: int = 1
    progress: Progress = silent
    keep: bool = False
