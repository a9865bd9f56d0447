"""The row of a track in the registry: all that the help shows, so it imports nothing heavy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal


@dataclass(frozen=True)
class Baseline:
    """A plain method that needs no weights.

    `predict` is a ``module:function`` of protocol, benchmark, settings, the path to write to, `Run`
    and a callable for notes. `settings`, and `demo` for the demonstration, are dataclasses.
    """

    method: str
    summary: str
    settings: Any
    demo: Any
    out: str
    predict: str


@dataclass(frozen=True)
class TrackInfo:
    """The row of a track in the registry; texts are for the help and for messages."""

    name: str  # as in protocol files, commands and results
    track: str  # ``module:NAME`` of its `Track`, which is imported when something is scored
    summary: str
    argument: str = "A prediction file."
    unit: Literal["query", "scene"] = "query"  # of a record; intervals and tests resample these
    suffixes: tuple[str, ...] = (".npz",)  # of files that can be predictions
    kinds: str = ".npz"  # the same for messages
    folders: bool = False  # whether predictions can be a folder, as templates then are
    fields: tuple[str, ...] = ()  # fields of an ``.npz`` that no other track has
    jobs: int = 2  # threads that ``eval`` takes by default
    # A ``module:function`` of the `Evaluation`, `Run` and output folder: draws ``eval --figures``.
    figures: str = ""
    baseline: Baseline | None = None
    # More files of a run, by name: a ``module:function`` of the `Evaluation` and the path.
    files: Mapping[str, str] = field(default_factory=dict)
    templates: tuple[str, ...] = ()  # what they can hold, the default first; () without a choice
