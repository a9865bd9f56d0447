"""What a dataset is: native data become a benchmark folder (``airzoo-bench prepare NAME``)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Generic, TypeVar

from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.engines.engine import HERE, Engine

if TYPE_CHECKING:
    from airzoo_bench.datasets.about import About
    from airzoo_bench.datasets.scene_facts import SceneFacts

__all__ = ["Dataset", "PrepareSettings", "Prepared", "SceneSummary", "TrackSummary"]

OptionsT = TypeVar("OptionsT")


@dataclass(frozen=True)
class PrepareSettings:
    """What can be asked of every dataset.

    Attributes
    ----------
    folder : Path
        The benchmark folder to make; it appears when it is complete.
    root : Path
        The data root, for protocols to start from and for what is kept between runs.
    tiles_on_disk : bool
        Write each tile as PNG; otherwise tiles are windows of the map.
    crops_on_disk : bool
        Write the crop of each query as two GeoTIFF; otherwise crops are windows of the map.
    copy : bool
        Copy photos, maps and clouds into the folder; otherwise they are left where they are.
    replace : bool
        Whether a folder that stands there is replaced.
    engine : Engine
        Where work is done that is shared out; the benchmark does not depend on it.
    progress : Progress
    note : callable
        Takes a sentence for the user while the folder is made.
    """

    folder: Path
    root: Path
    tiles_on_disk: bool = False
    crops_on_disk: bool = False
    copy: bool = False
    replace: bool = False
    engine: Engine = HERE
    progress: Progress = silent
    note: Callable[[str], None] = lambda _: None

    def __reduce__(self) -> tuple[Callable[[], PrepareSettings], tuple[()]]:
        """Leave out what other processes cannot do and show; they may work in another folder."""
        own = ("engine", "progress", "note")
        values = {one.name: getattr(self, one.name) for one in fields(self) if one.name not in own}
        places = {name: one.absolute() for name, one in values.items() if isinstance(one, Path)}
        return partial(PrepareSettings, **{**values, **places}), ()


@dataclass(frozen=True)
class TrackSummary:
    """What is said of a scene's truth for a track: a line, and how many photos are left out."""

    text: str
    count: int
    left_out: int = 0


@dataclass(frozen=True)
class SceneSummary:
    """What is said of a scene.

    Attributes
    ----------
    photos : int
    facts : tuple of str
        A line for each part of the scene, where they were compared.
    tracks : mapping of str to TrackSummary
        The tracks that have truth.
    warnings, notes : tuple of str
    """

    photos: int
    facts: tuple[str, ...] = ()
    tracks: Mapping[str, TrackSummary] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Prepared:
    """What was made.

    Attributes
    ----------
    folder : Path
        The benchmark folder.
    protocols : mapping of str to str
        The names of the protocols in it, with their tracks.
    summaries : mapping of str to SceneSummary
        By scene.
    facts : mapping of str to SceneFacts
        By scene, what its parts say of each other, where that was measured in this run.
    failed : mapping of str to str
        Scenes that could not be made, and why.
    """

    folder: Path
    protocols: Mapping[str, str]
    summaries: Mapping[str, SceneSummary] = field(default_factory=dict)
    facts: Mapping[str, SceneFacts] = field(default_factory=dict)
    failed: Mapping[str, str] = field(default_factory=dict)


class Dataset(ABC, Generic[OptionsT]):
    """A kind of data, such as own photos, or a benchmark as it is downloaded.

    The module of a dataset is imported for the help of the command line: it imports NumPy and the
    like within its methods.

    Attributes
    ----------
    summary : str
        What is made, for the help: a sentence, then what else there is to say.
    example : str
        What stands behind ``airzoo-bench prepare``, for the help.
    options : type
        A frozen dataclass whose fields are annotated with `core.registry.Option`; they become
        options of the command, next to those of `PrepareSettings`, which every dataset has.
    jobs : int or None
        Default of ``--jobs``; None where there is nothing to share out, and no such option.
    without_truth : mapping of str to str
        Why a track may have no truth in this dataset, by the track's name.
    about : About or None
        What a published benchmark says of itself.
    """

    summary: ClassVar[str]
    example: ClassVar[str]
    options: type[OptionsT]
    jobs: ClassVar[int | None] = None
    without_truth: ClassVar[Mapping[str, str]] = {}
    about: ClassVar[About | None] = None

    @property
    def is_published(self) -> bool:
        """Whether it is a benchmark that others publish, so that there is a page to get it from."""
        return self.about is not None

    def reasons(self, options: OptionsT) -> Mapping[str, str]:
        """Return `without_truth`, as it is with these options.

        Parameters
        ----------
        options : object
            Of the class `options`.

        Returns
        -------
        mapping of str to str
            Why a track may have no truth, by the track's name.
        """
        del options
        return self.without_truth

    @abstractmethod
    def benchmark(self, options: OptionsT) -> str:
        """Name the benchmark, which is what its folder in the data root is called.

        Parameters
        ----------
        options : object
            Of the class `options`.

        Raises
        ------
        UserError
            The options name none.
        """

    def folder_name(self, options: OptionsT, root: Path) -> str:
        """Name the folder to make in the data root.

        Parameters
        ----------
        options : object
            Of the class `options`.
        root : Path
            The data root, for protocols to start from.

        Returns
        -------
        str
            That of the benchmark, unless the dataset says otherwise.

        Raises
        ------
        UserError
            See `benchmark`.
        """
        return self.benchmark(options)

    def is_prepared(self, options: OptionsT, settings: PrepareSettings) -> bool:
        """Whether the folder is complete, and made from data that did not change since.

        Parameters
        ----------
        options : object
            Of the class `options`.
        settings : PrepareSettings
            Of the run.

        Returns
        -------
        bool
            False where the dataset cannot tell.

        Raises
        ------
        UserError
            The data are not there, or the folder is damaged.
        """
        return False

    @abstractmethod
    def prepare(self, options: OptionsT, settings: PrepareSettings) -> Prepared:
        """Make the benchmark folder.

        `datasets.truths.build_truths` makes the truth of a scene, `datasets.folder.write_benchmark`
        the folder.

        Parameters
        ----------
        options : object
            Of the class `options`.
        settings : PrepareSettings
            Where the folder is made, and how.

        Raises
        ------
        UserError
            The data are missing or wrong, or the folder cannot be written.
        """
