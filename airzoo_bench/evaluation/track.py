"""What a track is: all that evaluation and the command line need to know of one.

A track is an object that `registry.TRACKS` names. It reads predictions, holds them against the
truth scene by scene, scores them, and says what its scores are called; whatever else it offers
(a template, a baseline, options of ``eval``) has a default of "nothing".
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence, Sized
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar
from typing import Protocol as Structural

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import PredictionError, UsageError
from airzoo_bench.core.files import atomic_write, write_npz
from airzoo_bench.core.ids import Assignment, assign_queries, scene_of
from airzoo_bench.evaluation.baseline import Baseline
from airzoo_bench.evaluation.resources import Resources
from airzoo_bench.protocol.choice import IN_A_FIELD, other_benchmark
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.results.result import Reference
from airzoo_bench.results.scores import Score, concatenate

if TYPE_CHECKING:
    import pandas as pd


__all__ = [
    "Assigned",
    "EvalOption",
    "HasQueries",
    "Predictions",
    "QueryPredictions",
    "QueryTrack",
    "ScoredScene",
    "Track",
    "Truth",
]


class Predictions(Structural):
    """A prediction file or folder, as read or listed."""

    @property
    def path(self) -> Path:
        """Where it lies."""

    @property
    def protocol(self) -> str | None:
        """The protocol that it names."""


class QueryPredictions(Predictions, Structural):
    """Predictions with a row a query, of all scenes in one file."""

    @property
    def query_ids(self) -> NDArray[np.str_]:
        """Ids ``scene/name`` (Q,)."""

    @property
    def kind(self) -> str:
        """What they hold, for results."""


class Truth(Structural):
    """The truth of a scene."""

    @property
    def scene(self) -> str:
        """Its id."""

    @property
    def fingerprint(self) -> str:
        """SHA-256 over all that scores are held against."""


class HasQueries(Truth, Structural):
    """The truth of a scene of queries."""

    @property
    def queries(self) -> pd.DataFrame:
        """A row a query, with its ``id``."""


class Assigned(Structural):
    """Which part of the predictions answers which query or scene."""

    @property
    def strange(self) -> Sized:
        """What is predicted of queries or scenes that there are not."""

    def notes(self) -> list[str]:
        """Say what is missing or left aside."""


class ScoredScene(Structural):
    """What came of a scene."""

    @property
    def records(self) -> pd.DataFrame:
        """A row a query, pair or cloud."""

    @property
    def counts(self) -> dict[str, int]:
        """What a result states of the scene beside scores: queries, missing ones, failures."""


P = TypeVar("P", bound=Protocol)
R = TypeVar("R", bound=Predictions)
Q = TypeVar("Q", bound=QueryPredictions)
T = TypeVar("T", bound=Truth)
H = TypeVar("H", bound=HasQueries)
A = TypeVar("A", bound=Assigned)
C = TypeVar("C")
S = TypeVar("S", bound=ScoredScene)


@dataclass(frozen=True)
class EvalOption:
    """An option of ``airzoo-bench eval`` that one track has.

    Attributes
    ----------
    name : str
        Without its hyphens.
    help : str
    act : str
        Place ``module:function`` of what it does: takes the `evaluation.Evaluation`, the value, the
        folder for output or None, and `Resources`; yields sentences for the person.
    default : bool or int
        A number is asked for from 1 to `most`.
    most : int
    needs_out : bool
        Whether it writes, so that ``--out`` must be given.
    """

    name: str
    help: str
    act: str
    default: bool | int = False
    most: int = 1
    needs_out: bool = True


class Track(ABC, Generic[P, R, T, A, C, S]):
    """One track, by the types of its protocol, predictions, truth, assignment, claims and scores.

    Attributes
    ----------
    name : str
        As in protocol files, commands and results.
    summary : str
        What is scored, in one sentence, for the help.
    protocol : type of Protocol
    kinds : str
        What predictions come in, for messages.
    suffixes : tuple of str
        Endings of files that can be predictions.
    fields : tuple of str
        Fields of an ``.npz`` that no other track has.
    folders : bool
        Whether predictions can be a folder.
    says_protocol : tuple of str
        Where predictions say which protocol they are for, and how to mend that they do not.
    argument : str
        What predictions are, for the help.
    example : str
        Predictions and further options, for the help.
    jobs : int
        Threads that ``eval`` takes by default.
    options : tuple of EvalOption
    files : mapping of str to callable
        What a run writes beside ``result.json`` and ``records.csv``, by its name.
    baseline : Baseline or None
    template_kinds : tuple of str
        What templates can hold, the default first; empty where there is no choice.
    template_out : str
        What a template is called where nobody says.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    protocol: type[P]
    kinds: ClassVar[str] = ".npz"
    suffixes: ClassVar[tuple[str, ...]] = (".npz",)
    fields: ClassVar[tuple[str, ...]] = ()
    folders: ClassVar[bool] = False
    says_protocol: ClassVar[tuple[str, str]] = IN_A_FIELD
    argument: ClassVar[str] = "A prediction file."
    example: ClassVar[str] = "preds.npz --out results/mymethod"
    jobs: ClassVar[int] = 2
    options: ClassVar[tuple[EvalOption, ...]] = ()
    files: ClassVar[Mapping[str, Callable[[Any, Path], None]]] = {}
    baseline: ClassVar[Baseline[Any] | None] = None
    template_kinds: ClassVar[tuple[str, ...]] = ()
    template_out: ClassVar[str] = "template.npz"

    # --- what every track must have ---

    @abstractmethod
    def read(self, path: Path, memory_bytes: int) -> R:
        """Read or list predictions; what is no such thing raises PredictionError."""

    @abstractmethod
    def read_truth(self, benchmark: Benchmark, scene: str) -> T:
        """Read the truth of a scene from a benchmark folder."""

    @abstractmethod
    def assign(self, predictions: R, protocol: P, truths: Sequence[T], data: Path) -> A:
        """Find what of the predictions is of which query or scene.

        Where the benchmark folder is not there, `truths` is empty, and ids are looked at alone.

        Raises
        ------
        PredictionError
            They are of another benchmark altogether.
        """

    @abstractmethod
    def claims(
        self, predictions: R, assigned: A, truths: Sequence[T], protocol: P, resources: Resources
    ) -> Iterator[C | PredictionError]:
        """Hold predictions against each scene; yields what they claim of it, or what is wrong."""

    @abstractmethod
    def score(self, claim: C, truth: T, protocol: P, resources: Resources) -> S:
        """Score a scene; what is missing from the claim scores its worst."""

    @abstractmethod
    def scores(self, protocol: P, scored: Sequence[S]) -> list[Score]:
        """Return what the columns of the records are called."""

    # --- what a track may add ---

    def records(self, scored: Sequence[S], protocol: P) -> pd.DataFrame:
        """Put the records of scenes under each other."""
        return concatenate([scene.records for scene in scored])

    def expected_counts(self, truth: T) -> dict[str, int]:
        """Return those of a scene's counts that are known without predictions."""
        return {}

    def validation_errors(
        self, predictions: R, protocol: P, *, thorough: bool
    ) -> Iterator[PredictionError]:
        """Yield what is wrong with predictions and can be seen without truth.

        Where `thorough`, also what takes time to find, and what scoring would find by itself.
        """
        yield from ()

    def kind(self, predictions: R, scored: Sequence[S]) -> str:
        """Say what predictions hold, for the result."""
        return self.name

    def method(self, path: Path) -> str:
        """Name the method where nobody does."""
        return path.stem

    def notes(
        self,
        predictions: R,
        protocol: P,
        truths: Sequence[T],
        claims: Sequence[C],
        scored: Sequence[S],
    ) -> list[str]:
        """Say what a reader of the numbers must know."""
        return []

    def inspect(self, claim: C, truth: T, protocol: P, resources: Resources) -> list[str]:
        """Do with a claim what can be done without scoring; returns notes on it.

        Raises
        ------
        PredictionError
            Scoring would refuse it.
        """
        return []

    def inspect_alone(
        self, predictions: R, protocol: P, resources: Resources
    ) -> Iterator[PredictionError | str]:
        """Yield errors and notes of predictions whose benchmark folder is not there."""
        yield from ()

    def check_notes(
        self,
        predictions: R,
        protocol: P,
        truths: Sequence[T],
        claims: Sequence[C],
        resources: Resources,
    ) -> list[str]:
        """Say, without scoring, what `notes` would; asked where nothing is wrong."""
        return []

    def references(self, protocol: P, truths: Sequence[T]) -> dict[str, Reference]:
        """Return what scores without a method, by the name that tables print."""
        return {}

    def check_template_path(self, out: Path, *, force: bool) -> None:
        """Refuse, before any work, a path that a template cannot be written to."""
        if out.suffix != ".npz":
            raise UsageError("templates are written as .npz", where=out, mend=f"name it {out}.npz")
        if out.exists() and not out.is_dir() and not force:
            raise UsageError(
                "is there already, and could be a prediction",
                where=out,
                mend="name another file with --out, or add --force",
            )

    def write_template(
        self, out: Path, protocol: P, truths: Sequence[T], kind: str, seed: int
    ) -> None:
        """Write an example prediction, at random."""
        raise NotImplementedError(f"the {self.name} track has no template")

    def template_note(self, protocol: P, truths: Sequence[T]) -> str | None:
        """Say what a template will score, where that is known."""
        return None


class QueryTrack(Track[P, Q, H, Assignment, C, S]):
    """A track whose predictions have a row a query."""

    @abstractmethod
    def claim(
        self,
        predictions: Q,
        truth: H,
        rows: NDArray[np.intp],
        protocol: P,
        resources: Resources,
    ) -> C:
        """Hold predictions against one scene.

        Parameters
        ----------
        predictions : QueryPredictions
        truth : HasQueries
        rows : (Q,) int
            The row that answers each query, -1 where there is none.
        protocol : Protocol
        resources : Resources

        Raises
        ------
        PredictionError
            They do not fit the scene.
        """

    def assign(self, predictions: Q, protocol: P, truths: Sequence[H], data: Path) -> Assignment:
        """See `Track.assign`."""
        ids = predictions.query_ids
        assigned = assign_queries(ids, [truth.queries["id"] for truth in truths])
        if truths:
            known = any((found >= 0).any() for found in assigned.rows)
        else:
            known = bool({scene.id for scene in protocol.scenes} & set(np.unique(scene_of(ids))))
        if not known:
            example = str(truths[0].queries["id"].iloc[0]) if truths else None
            raise other_benchmark(predictions.path, ids, protocol, data, example)
        return assigned

    def claims(
        self,
        predictions: Q,
        assigned: Assignment,
        truths: Sequence[H],
        protocol: P,
        resources: Resources,
    ) -> Iterator[C | PredictionError]:
        """See `Track.claims`."""
        pairs = zip(truths, assigned.rows, strict=True)
        for truth, rows in resources.progress(pairs, "scenes", len(truths)):
            try:
                yield self.claim(predictions, truth, rows, protocol, resources)
            except PredictionError as error:
                yield error

    def expected_counts(self, truth: H) -> dict[str, int]:
        """See `Track.expected_counts`."""
        return {"queries": len(truth.queries)}

    def kind(self, predictions: Q, scored: Sequence[S]) -> str:
        """See `Track.kind`."""
        return predictions.kind

    def template(
        self, protocol: P, truths: Sequence[H], kind: str, seed: int
    ) -> dict[str, NDArray[Any]]:
        """Return the arrays of an example prediction, at random, without its protocol."""
        raise NotImplementedError(f"the {self.name} track has no template")

    def write_template(
        self, out: Path, protocol: P, truths: Sequence[H], kind: str, seed: int
    ) -> None:
        """See `Track.write_template`."""
        arrays = self.template(protocol, truths, kind, seed)
        with atomic_write(out) as stream:
            write_npz(stream, {"protocol": np.array(protocol.name), **arrays})
