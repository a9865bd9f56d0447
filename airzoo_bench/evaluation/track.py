"""The contract of tracks: how predictions are opened, matched to the truth and scored.

A track is a folder of the package with an ``info.py`` (a `TrackInfo`, which the registry names and
the help shows) and a ``track.py`` (a `Track`, imported when something is scored). Scoring goes

    predictions = track.open(path, memory_bytes)
    truths = [track.truth(benchmark, scene) for scene in scenes]
    assignment = track.assign(predictions, truths, protocol)
    scored = [track.score(part, truth, protocol, run) for part, truth in zip(assignment.parts, ...)]
    notes = track.notes(predictions, truths, protocol, scored)

and `evaluate.evaluate` makes a result of it; its numbers all come from `SceneScores.records`.
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
from airzoo_bench.engines.engine import HERE, Engine, Processes
from airzoo_bench.evaluation.info import TrackInfo
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.results.result import Reference, ScoreColumn

Predictions = Any
"""A prediction file or folder, opened: its `path`, and the `protocol` that it names, or None.

A child process that reads what strangers wrote hands it to its parent by its fields, so it is a
dataclass of texts, numbers, arrays, paths, and dataclasses of these; or `ScenePredictions`.
"""

Truth = Any
"""The truth of a `scene`, and the `fingerprint` over all that scores depend on, by SHA-256.

Of a track with queries it has `queries`, a table with their ids.
"""


@dataclass(frozen=True)
class ScenePredictions:
    """Predictions that are listed when they are opened, and read a scene at a time.

    An entry opens a scene for as long as it is used; it takes the bytes that the scene may hold,
    and how meshes become points. It opens a dataclass, as of `Predictions`; what is not in memory
    has a method ``stored(folder)``, which writes it to files and returns it as read from there.
    """

    path: Path
    entries: Mapping[str, Callable[[int, Any], AbstractContextManager[Any]]]
    unknown_files: tuple[str, ...] = ()  # of no scene
    protocol: str | None = None  # that they name


@dataclass(frozen=True, eq=False)
class Assignment:
    """Which part of the predictions is for which scene.

    `parts` are given to `Track.score`, in the order of the scenes; one is None where its scene is
    refused, and `errors` say why. `covered` says how much is answered, such as ``15 of 18
    queries``, `notes` what is missing or ignored, `strange` how many ids the benchmark lacks.
    """

    parts: list[Any] = field(default_factory=list)
    covered: str = ""
    notes: list[str] = field(default_factory=list)
    strange: int = 0
    errors: list[PredictionError] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class SceneScores:
    """The scores of a scene; ``eval --resume`` keeps all of it but `details`.

    `records` have a row a query or cloud. `counts` and `kind`, what the predictions hold, stand in
    the result. `notes` are for readers of the scores; `facts` are plain values, as JSON has them,
    for `Track.notes` and `TrackInfo.files`. Figures show `details`, which are None unless
    `Run.keep`.
    """

    records: pd.DataFrame = field(default_factory=pd.DataFrame)
    counts: dict[str, int] = field(default_factory=dict)
    kind: str | None = None
    notes: tuple[str, ...] = ()
    facts: dict[str, Any] = field(default_factory=dict)
    details: Any = None


@dataclass(frozen=True)
class Run:
    """Memory, processes and options of a run; no number depends on them.

    `memory_bytes` is the most that a prediction file may take, `jobs` the number of threads or
    processes (on a cluster, of threads of each worker). With `keep`, scenes keep what figures show.
    `limits` are those of the child that reads predictions of strangers; None reads them here.
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
        return self.engine if as_well else Processes(self.jobs)


class Track(ABC):
    """A track; ``Any`` marks types of its own.

    Methods take what others return: `predictions` of `open`, `truths` of all scenes in the
    protocol's order, a `part` of `Assignment.parts`, and what was `scored` by `score` or `check`.
    `memory_bytes` is the most that reading may hold. Patterns (as of `fnmatch`) of `recorded` name
    the columns of records that are neither scores nor conditions of the queries.
    """

    info: ClassVar[TrackInfo]
    protocol: ClassVar[type[Protocol]]
    recorded: ClassVar[frozenset[str]] = frozenset(("scene", "query", "answered"))

    @abstractmethod
    def open(self, path: Path, memory_bytes: int) -> Any:
        """Open predictions in the suite's own layout; anything else raises PredictionError."""

    @abstractmethod
    def truth(self, benchmark: Benchmark, scene: str) -> Any:
        """Read the truth of a scene from a benchmark folder, sealed or not."""

    @abstractmethod
    def assign(self, predictions: Any, truths: Sequence[Any], protocol: Any) -> Assignment:
        """Assign predictions to scenes, and find the errors that are found quickly.

        Predictions for another benchmark raise PredictionError.
        """

    @abstractmethod
    def score(self, part: Any, truth: Any, protocol: Any, run: Run) -> SceneScores:
        """Score a scene; whatever is missing from its predictions gets the worst score."""

    @abstractmethod
    def scores(self, protocol: Any) -> list[ScoreColumn]:
        """Return the scores that are columns of the records.

        Records may lack some, but no headline; a scene without a column of others is worst there.
        """

    def check(self, part: Any, truth: Any, protocol: Any, run: Run) -> SceneScores:
        """Look for errors of a scene without scoring it.

        Records may be empty; counts, notes and facts are as of `score`. `truth` may be sealed.
        """
        return self.score(part, truth, protocol, run)

    def notes(
        self, predictions: Any, truths: Sequence[Any], protocol: Any, scored: Sequence[SceneScores]
    ) -> list[str]:
        """Return what a reader of the scores must know of all scenes, from `score` or `check`."""
        return []

    def references(self, protocol: Any, truths: Sequence[Any]) -> Mapping[str, Reference]:
        """Return scores that need no method, such as chance, by the name that tables print."""
        return {}

    def template(
        self, out: Path, truths: Sequence[Any], protocol: Any, kind: str, seed: int
    ) -> None:
        """Write an example prediction at random, of one of the kinds of `TrackInfo.templates`."""
        raise UsageError(f"the {self.info.name} track has no template")
