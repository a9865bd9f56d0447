"""What tracks are given and what they give, as far as all share it, and what they may offer."""

from __future__ import annotations

from collections.abc import Callable, Sized
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar
from typing import Protocol as Structural

from airzoo_bench.core.options import Option
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.engines.engine import HERE, Engine, Processes

if TYPE_CHECKING:
    import pandas as pd

    from airzoo_bench.core.sandbox import Limits
    from airzoo_bench.evaluation.scene_store import SceneStore

__all__ = [
    "DOUBLED",
    "Assigned",
    "Baseline",
    "EvalOption",
    "Predictions",
    "Resources",
    "ScoredScene",
    "Truth",
]

S = TypeVar("S")


class Predictions(Structural):
    """A prediction file or folder, as read or listed."""

    @property
    def path(self) -> Path:
        """Where it lies."""

    @property
    def protocol(self) -> str | None:
        """The protocol that it names."""


class Truth(Structural):
    """The truth of a scene."""

    @property
    def scene(self) -> str:
        """Its id."""

    @property
    def fingerprint(self) -> str:
        """SHA-256 over all that scores depend on."""


class Assigned(Structural):
    """Which part of the predictions is for which query or scene."""

    @property
    def strange(self) -> Sized:
        """Ids of queries or scenes that the benchmark does not have."""

    @property
    def covered(self) -> str:
        """How much of the benchmark is answered, such as ``15 of 18 queries``."""

    def notes(self) -> list[str]:
        """Return notes on what is missing or ignored."""


class ScoredScene(Structural):
    """The scores of a scene."""

    @property
    def records(self) -> pd.DataFrame:
        """A row a query, pair or cloud."""

    @property
    def counts(self) -> dict[str, int]:
        """Counts for the result: queries, missing ones, failures."""


@dataclass(frozen=True)
class Resources:
    """What a run may use and what it keeps; no score depends on it.

    Attributes
    ----------
    memory_bytes : int
        The most memory that a prediction file may take.
    jobs : int
        Threads or processes; on a cluster, threads of each of its workers.
    engine : Engine
        Where tasks are done.
    keep : bool
        Keep what figures need besides the scores, such as clouds.
    limits : Limits or None
        Of the child that reads predictions which are not trusted; None reads them in this process.
    scenes : SceneStore, optional
        Keeps scenes that are scored.
    """

    memory_bytes: int = 2 << 30
    jobs: int = 1
    progress: Progress = silent
    keep: bool = False
    engine: Engine = HERE
    limits: Limits | None = None
    scenes: SceneStore | None = None

    @property
    def processes(self) -> Engine:
        """Where tasks are done that keep the interpreter's lock: not in threads of this process."""
        as_well = self.engine.distributed or self.jobs == 1
        return self.engine if as_well else Processes(self.jobs)

    def finish(self, name: str, truth: object, compute: Callable[[], S]) -> S:
        """Return what an earlier run has kept of a scene, else compute it."""
        return compute() if self.scenes is None else self.scenes.load_or(name, truth, compute)


@dataclass(frozen=True)
class EvalOption:
    """An option of ``airzoo-bench eval`` that one track has.

    Attributes
    ----------
    name : str
        Without its hyphens.
    act : str
        ``module:function`` to call: it takes the `evaluate.Evaluation`, the option's value, the
        output folder or None, and `Resources`, and yields lines to print.
    default : bool or int
        An int makes it an option with a number from 1 to `most`.
    needs_out : bool
        Whether it writes files, into a folder of its name, so that ``--out`` must be given.
    files : str
        A regular expression of their names: a folder with other files is not replaced.
    """

    name: str
    help: str
    act: str
    default: bool | int = False
    most: int = 1
    needs_out: bool = True
    files: str = ".*"


DOUBLED = Option("double", "Look for the finest features too, for four times the time.")


@dataclass(frozen=True)
class Baseline(Generic[S]):
    """A track's baseline: a plain method that needs no weights.

    Attributes
    ----------
    method : str
        Its name in tables.
    summary : str
        What it does, in one sentence, for the help.
    settings, demo : S
        Its default settings, and those of the demonstration: a dataclass whose fields may be
        annotated with an `Option`.
    out : str
        Default name of the predictions.
    out_help, example : str
        For the help; the example names a protocol and where to write.
    predict : str
        ``module:function`` to call: it takes protocol, benchmark, settings, the path to write to,
        `Resources`, and a callable for notes on each scene.
    """

    method: str
    summary: str
    settings: S
    demo: S
    out: str
    out_help: str
    example: str
    predict: str
