"""What a dataset is: native data become a benchmark folder (``airzoo-bench prepare NAME``)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Generic, TypeVar

from airzoo_bench.core.progress import Progress, silent

if TYPE_CHECKING:
    from airzoo_bench.datasets.scene_facts import SceneFacts
    from airzoo_bench.datasets.truths import SceneTruths

__all__ = ["Dataset", "PrepareSettings", "Prepared"]

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
    jobs : int
        The benchmark does not depend on it.
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
    jobs: int = 1
    progress: Progress = silent
    note: Callable[[str], None] = lambda _: None


@dataclass(frozen=True, eq=False)
class Prepared:
    """What was made.

    Attributes
    ----------
    folder : Path
        The benchmark folder.
    protocols : mapping of str to str
        The names of the protocols in it, with their tracks.
    truths : mapping of str to SceneTruths
        By scene.
    facts : mapping of str to SceneFacts
        By scene, what its parts say of each other, where the dataset has that measured.
    """

    folder: Path
    protocols: Mapping[str, str]
    truths: Mapping[str, SceneTruths]
    facts: Mapping[str, SceneFacts] = field(default_factory=dict)


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
        A frozen dataclass whose fields are annotated with `core.options.Option`; they become
        options of the command, next to those of `PrepareSettings`, which every dataset has.
    jobs : int or None
        Default of ``--jobs``; None where there is nothing to share out.
    without_truth : mapping of str to str
        Why a track may have no truth in this dataset, by the track's name.
    """

    summary: ClassVar[str]
    example: ClassVar[str]
    options: type[OptionsT]
    jobs: ClassVar[int | None] = None
    without_truth: ClassVar[Mapping[str, str]] = {}

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
