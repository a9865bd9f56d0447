"""The row of a track in the registry: all that the help shows, so it imports nothing heavy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal


@dataclass(frozen=True)
class Baseline:
    """A plain method that needs no weights.

    `settings`, and `demo` for the demonstration, are dataclasses; the command line changes the
    fields max_features, long_side_px and doubled. `predict` is a ``module:function``: it takes
    protocol, benchmark, settings, the path to write to, `Run`, and a callable for notes. The rest
    is for tables and the help.
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
    # What ``eval --figures`` does: a ``module:function`` that takes the `evaluate.Evaluation`,
    # `Run` and the output folder, and writes into ``figures`` there.
    figures: str = ""
    baseline: Baseline | None = None
    # What a run writes beside result.json and records.csv: by its name the ``module:function`` to
    # call with the `evaluate.Evaluation` and the path.
    files: Mapping[str, str] = field(default_factory=dict)
    templates: tuple[str, ...] = ()  # what they can hold, the default first; () without a choice
