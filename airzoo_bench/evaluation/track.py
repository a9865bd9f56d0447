"""What a track is: all that evaluation and the command line need to know of one.

A track is an object that `registry.TRACKS` names. It reads predictions, matches them to the truth
of each scene, scores them, and names its scores. What else it may offer (a template, a baseline,
options of ``eval``) defaults to nothing. Its module is imported for the help, so NumPy and the like
are imported within its methods.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Literal, TypeVar

from airzoo_bench.core.errors import PredictionError, UsageError
from airzoo_bench.evaluation.parts import (
    Assigned,
    Baseline,
    EvalOption,
    Predictions,
    Resources,
    ScoredScene,
    Truth,
)

if TYPE_CHECKING:
    import pandas as pd

    from airzoo_bench.benchmark.folder import Benchmark
    from airzoo_bench.protocol.model import Protocol
    from airzoo_bench.results.result import Reference
    from airzoo_bench.results.scores import Score

__all__ = ["Track"]

P = TypeVar("P", bound="Protocol")
R = TypeVar("R", bound=Predictions)
T = TypeVar("T", bound=Truth)
A = TypeVar("A", bound=Assigned)
C = TypeVar("C")
S = TypeVar("S", bound=ScoredScene)


class Track(ABC, Generic[P, R, T, A, C, S]):
    """One track, by the types of what it reads, matches and scores.

    Attributes
    ----------
    name : str
        As in protocol files, commands and results.
    summary : str
        What is scored, in one sentence, for the help.
    kinds : str
        What predictions come in, for messages.
    suffixes : tuple of str
        Endings of files that can be predictions.
    fields : tuple of str
        Fields of an ``.npz`` that no other track has.
    folders : bool
        Whether predictions can be a folder.
    takes_image_size : bool
        Whether a reader of the track reads `reader.Reading.image_size`.
    says_protocol : tuple of str or None
        Where predictions say which protocol they are for, and how to fix that they do not; None
        where it is in a field of the file.
    unit : {"query", "scene"}
        What a record is of; of scenes, intervals and tests resample these.
    argument : str
        What predictions are, for the help.
    example : str
        Predictions and further options, for the help.
    jobs : int
        Threads that ``eval`` takes by default.
    options : tuple of EvalOption
    files : mapping of str to callable
        What a run writes next to ``result.json`` and ``records.csv``, by its name.
    baseline : Baseline or None
    template_kinds : tuple of str
        What templates can hold, the default first; empty where there is no choice.
    template_out : str
        What a template is called where nobody says.

    Notes
    -----
    What its methods take:

    path, out : Path
        Of predictions; of a template.
    memory_bytes : int
        The most that reading may hold.
    benchmark, data : Benchmark, Path
        The benchmark folder, opened; the folder that holds it.
    scene : str
        Its id.
    protocol : Protocol
        Of the class `protocol`.
    predictions, assigned : R, A
        From `read` and `assign`.
    truth, truths : T, sequence of T
        From `read_truth`: of a scene, and of all scenes in the protocol's order.
    predicted, scene_predictions : C, sequence of C
        From `match`: of a scene, and of all scenes.
    scored : sequence of S
        From `score`, of all scenes.
    resources : Resources
        Memory and threads that may be used; no number depends on them.
    read_scene, folder : callable, Path
        Has a child read one scene under limits; where that child leaves its arrays.
    thorough, force : bool
        Whether to look for what takes time to find; whether a file is replaced.
    kind, seed : str, int
        Of a template: one of `template_kinds`, and what its random answers come from.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    kinds: ClassVar[str] = ".npz"
    suffixes: ClassVar[tuple[str, ...]] = (".npz",)
    fields: ClassVar[tuple[str, ...]] = ()
    folders: ClassVar[bool] = False
    takes_image_size: ClassVar[bool] = False
    unit: ClassVar[Literal["query", "scene"]] = "query"
    says_protocol: ClassVar[tuple[str, str] | None] = None
    argument: ClassVar[str] = "A prediction file."
    example: ClassVar[str] = "preds.npz --out results/mymethod"
    jobs: ClassVar[int] = 2
    options: ClassVar[tuple[EvalOption, ...]] = ()
    files: ClassVar[Mapping[str, Callable[[Any, Path], None]]] = {}
    baseline: ClassVar[Baseline[Any] | None] = None
    template_kinds: ClassVar[tuple[str, ...]] = ()
    template_out: ClassVar[str] = "template.npz"

    # --- what every track must have ---

    @property
    @abstractmethod
    def protocol(self) -> type[P]:
        """The class of its protocols."""

    @abstractmethod
    def read(self, path: Path, memory_bytes: int) -> R:
        """Read or list predictions; what is no such thing raises PredictionError."""

    def portable(self, predictions: R) -> Any:
        """Return what a child that reads predictions under limits gives its parent."""
        return predictions

    def restored(self, predictions: Any, read_scene: Callable[..., Any]) -> R:
        """Return the predictions of `portable`; `read_scene` has a child read one scene."""
        read: R = predictions
        return read

    def store_scene(self, predictions: R, folder: Path, **scene: Any) -> Any:
        """Read one scene in a child, and leave its arrays in files of a folder."""
        raise NotImplementedError

    @abstractmethod
    def read_truth(self, benchmark: Benchmark, scene: str) -> T:
        """Read the truth of a scene from a benchmark folder."""

    @abstractmethod
    def assign(self, predictions: R, protocol: P, truths: Sequence[T], data: Path) -> A:
        """Find which part of the predictions is for which query or scene."""

    @abstractmethod
    def match(
        self, predictions: R, assigned: A, truths: Sequence[T], protocol: P, resources: Resources
    ) -> Iterator[C | PredictionError]:
        """Yield the predictions of each scene, matched to its truth, or what is wrong with them."""

    @abstractmethod
    def score(self, predicted: C, truth: T, protocol: P, resources: Resources) -> S:
        """Score a scene; whatever is missing from its predictions gets the worst score."""

    @abstractmethod
    def scores(self, protocol: P, scored: Sequence[S]) -> list[Score]:
        """Return the scores that are columns of the records."""

    # --- what a track may add ---

    @property
    def recorded(self) -> frozenset[str]:
        """Columns of the records that are neither scores nor conditions of the queries."""
        return frozenset(("scene", "query", "answered"))

    def records(self, scored: Sequence[S], protocol: P) -> pd.DataFrame:
        """Concatenate the records of all scenes."""
        from airzoo_bench.results.scores import concatenate

        return concatenate([scene.records for scene in scored])

    def expected_counts(self, truth: T) -> dict[str, int]:
        """Return those of a scene's counts that are known without predictions."""
        return {}

    def read_while_scoring(self, truth: T) -> Sequence[Path]:
        """Return the files of a scene's truth that are read, or read again, when it is scored."""
        return ()

    def validation_errors(
        self, predictions: R, protocol: P, *, thorough: bool
    ) -> Iterator[PredictionError]:
        """Yield the errors of predictions that can be found without truth."""
        yield from ()

    def kind(self, predictions: R, scored: Sequence[S]) -> str:
        """Name what the predictions hold, for the result."""
        return self.name

    def method(self, path: Path) -> str:
        """Return the default name of the method."""
        return path.stem

    def notes(
        self,
        predictions: R,
        protocol: P,
        truths: Sequence[T],
        scene_predictions: Sequence[C],
        scored: Sequence[S],
    ) -> list[str]:
        """Return what a reader of the scores must know."""
        return []

    def inspect(self, predicted: C, truth: T, protocol: P, resources: Resources) -> list[str]:
        """Check the predictions of a scene as far as possible without scoring; returns notes."""
        return []

    def inspect_alone(
        self, predictions: R, protocol: P, resources: Resources
    ) -> Iterator[PredictionError | str]:
        """Yield errors and notes of predictions whose benchmark folder is missing."""
        yield from ()

    def check_notes(
        self,
        predictions: R,
        protocol: P,
        truths: Sequence[T],
        scene_predictions: Sequence[C],
        resources: Resources,
    ) -> list[str]:
        """Return, without scoring, what `notes` would; called where there is no error."""
        return self.notes(predictions, protocol, truths, scene_predictions, ())

    def references(self, protocol: P, truths: Sequence[T]) -> dict[str, Reference]:
        """Return scores that need no method, such as chance, by the name that tables print."""
        return {}

    def no_template(self) -> UsageError:
        """Return the error for a track without a template."""
        return UsageError(
            f"the {self.name} track has no template",
            fix="write predictions as the track's own documentation says",
        )

    def check_template_path(self, out: Path, *, force: bool) -> None:
        """Refuse, before any work, a path that a template cannot be written to."""
        raise self.no_template()

    def write_template(
        self, out: Path, protocol: P, truths: Sequence[T], kind: str, seed: int
    ) -> None:
        """Write an example prediction, at random."""
        raise self.no_template()

    def template_note(self, protocol: P, truths: Sequence[T]) -> str | None:
        """Return what a template will score, where that is known."""
        return None
