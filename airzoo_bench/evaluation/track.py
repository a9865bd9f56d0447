"""The contract of tracks: how predictions are opened, matched to the truth and scored.

A track is a folder of the package with an ``info.py`` (a `TrackInfo`, which the registry names and
the help shows) and a ``track.py`` (a `Track`, imported when something is scored). `evaluate`
calls open, truth, assign, score and notes, in this order, and makes a result of their records.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import pandas as pd

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import PredictionError, UsageError
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.core.sandbox import Limits
from airzoo_bench.engines.engine import HERE, Engine
from airzoo_bench.evaluation.info import TrackInfo
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.results.result import Reference, ScoreColumn


@dataclass(frozen=True)
class ScenePredictions:
    """Predictions that are listed when they are opened, and read a scene at a time.

    An entry opens a scene for as long as it is used; it takes the bytes that the scene may hold,
    and how meshes become points. It opens a dataclass, as `Track.open` does; what is not in memory
    has a method ``stored(folder)``, which writes it to files and returns it as read from there.
    """

    path: Path
    entries: Mapping[str, Callable[[int, Any], AbstractContextManager[Any]]]
    extra_files: tuple[str, ...] = ()  # of no scene
    protocol: str | None = None  # that they name


@dataclass(frozen=True, eq=False)
class Assignment:
    """Which part of the predictions is for which scene.

    `parts` are in the order of the scenes; one is None where its scene is refused, and `errors` say
    why. `covered` says how much is answered, such as ``15 of 18 queries``, `facts` more of it,
    `notes` what is missing or ignored, `extra_queries` how many ids, or scenes, are not known.
    """

    parts: list[Any] = field(default_factory=list)
    covered: str = ""
    notes: list[str] = field(default_factory=list)
    extra_queries: int = 0
    errors: list[PredictionError] = field(default_factory=list)
    facts: list[str] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class SceneScores:
    """The scores of a scene; ``eval --resume`` keeps all of it but `details`.

    `records` have a row a query or cloud; `counts` and `kind`, what the predictions hold, are part
    of the result. `facts` are plain values for `Track.notes` and `TrackInfo.files`. `details` are
    for figures, None unless `Run.keep`.
    """

    records: pd.DataFrame = field(default_factory=pd.DataFrame)
    counts: dict[str, int] = field(default_factory=dict)
    kind: str | None = None
    notes: Sequence[str] = ()
    facts: dict[str, Any] = field(default_factory=dict)
    details: Any = None


@dataclass(frozen=True)
class Run:
    """Memory, processes and options of a run; no number depends on them.

    `memory_bytes` is the most that a prediction file may take, `jobs` the number of threads (on a
    cluster, of each worker). With `keep`, scenes keep what figures show. `limits` are those of the
    child that reads predictions of strangers; None reads them here.
    """

    memory_bytes: int = 2 << 30
    jobs: int = 1
    progress: Progress = silent
    keep: bool = False
    engine: Engine = HERE
    limits: Limits | None = None

    @property
    def processes(self) -> Engine:
        """Where tasks are done that keep the interpreter's lock: not in threads of this process."""
        as_well = self.engine.distributed or self.jobs == 1
        return self.engine if as_well else Engine(self.jobs)


class Track(ABC):
    """A track; ``Any`` marks types of its own.

    A `part` is one of `Assignment.parts`; truths are in the protocol's order. Patterns (as of
    `fnmatch`) of `recorded` name the columns of records that are neither scores nor conditions.
    """

    info: ClassVar[TrackInfo]
    protocol: ClassVar[type[Protocol]]
    recorded: ClassVar[frozenset[str]] = frozenset(("scene", "query", "answered"))

    @abstractmethod
    def open(self, path: Path, memory_bytes: int) -> Any:
        """Open predictions in the suite's own layout; anything else raises PredictionError.

        They have a `path`, and the `protocol` that they name, or None. They are `ScenePredictions`,
        or a dataclass of texts, numbers, arrays, paths, and dataclasses of these, as the child that
        reads what strangers wrote hands it to its parent.
        """

    @abstractmethod
    def truth(self, benchmark: Benchmark, scene: str) -> Any:
        """Read the truth of a scene from a benchmark folder, sealed or not.

        It has `scene`, `fingerprint`, of all that scores depend on, and `queries`, a table, if any.
        """

    @abstractmethod
    def assign(self, predictions: Any, truths: Sequence[Any], protocol: Any) -> Assignment:
        """Assign predictions to scenes; those for another benchmark raise PredictionError."""

    @abstractmethod
    def score(self, part: Any, truth: Any, protocol: Any, run: Run) -> SceneScores:
        """Score a scene; whatever is missing from its predictions gets the worst score."""

    @abstractmethod
    def scores(self, protocol: Any) -> list[ScoreColumn]:
        """Return the columns of scores; where a scene lacks one that others have, it is worst."""

    def check(self, part: Any, truth: Any, protocol: Any, run: Run) -> SceneScores:
        """Find errors of a scene; its truth may be sealed, and records may be empty."""
        return self.score(part, truth, protocol, run)

    def notes(
        self, predictions: Any, truths: Sequence[Any], protocol: Any, scored: Sequence[SceneScores]
    ) -> list[str]:
        """Return what a reader of the scores must know of all scenes, from `score` or `check`."""
        return []

    def references(self, protocol: Any, truths: Sequence[Any]) -> Mapping[str, Reference]:
        """Return scores that need no method, such as chance, by the name that tables print."""
        return {}

    def template(self, out: Path, truths: Sequence[Any], protocol: Any, kind: str) -> None:
        """Write an example prediction at random, of one of the kinds of `TrackInfo.templates`."""
        raise UsageError(f"the {self.info.name} track has no template")
