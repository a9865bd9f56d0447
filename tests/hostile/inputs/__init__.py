"""Every kind of input that the suite reads: a sound one each, and the commands that read it.

To add a kind, append an `Input` to what a file here returns.
"""

from __future__ import annotations

from pathlib import Path

from tests.hostile.inputs import matching, others, reconstruction, retrieval
from tests.hostile.inputs.case import Input

__all__ = ["made_inputs"]


def made_inputs(home: Path) -> list[Input]:
    """Make a sound input of every kind below a folder."""
    return [
        *retrieval.files(home / "retrieval"),
        *retrieval.of_methods(home / "readers"),
        *matching.files(home / "matching"),
        *reconstruction.files(home / "reconstruction"),
        *others.results(home / "results", home / "retrieval"),
        *others.tables(home / "tables"),
        *others.sources(home / "prepare"),
    ]
