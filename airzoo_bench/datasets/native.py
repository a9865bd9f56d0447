"""Published benchmarks as downloaded: what each says of itself, and a scene as it is read."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeVar

from airzoo_bench.core.options import Option
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.dataset import Dataset, Prepared, PrepareSettings

if TYPE_CHECKING:
    from airzoo_bench.datasets.dji import PhotoPrior
    from airzoo_bench.datasets.truths import BenchmarkProtocols
    from airzoo_bench.geometry.cameras import Cameras
    from airzoo_bench.geometry.poses import Poses

__all__ = ["About", "NativeDataset", "NativeOptions", "NativeScene"]


@dataclass(frozen=True)
class About:
    """What users want to know of a benchmark before they have it.

    Attributes
    ----------
    title : str
        Such as "UAV-VisLoc".
    page : str
        Address of the page that tells where to get it.
    licence : str
        As the benchmark states it, or that it states none.
    repository : str or None
        The dataset's id on Hugging Face, where the data lie there.
    links : tuple of str
        Addresses of the files, where they can be fetched by link.
    assumptions : tuple of str
        A sentence for each value that the truth rests on and that the benchmark does not state.
    unverified : tuple of str
        A sentence for each part of the layout that nobody of us has seen.
    ranges : mapping of str to float
        How far assumed values may be off, see `retrieval.sensitivity.AssumedRanges`.
    """

    title: str
    page: str
    licence: str
    repository: str | None = None
    links: tuple[str, ...] = ()
    assumptions: tuple[str, ...] = ()
    unverified: tuple[str, ...] = ()
    ranges: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class NativeScene:
    """A scene as a benchmark's files state it, in the conventions of `geometry`.

    Attributes
    ----------
    scene : str
        Its id, that of the protocols.
    images : Path
        Folder of the photos.
    names : tuple of N str
        Photos with a pose, relative to `images`.
    cameras : Cameras
        N, for the photos' own size.
    poses : Poses
        N, in `crs`.
    crs : str
        Projected, in metres; a local frame in metres where there is neither map nor surface model.
    dom, dsm, gallery, cloud : Path or None
        Map, surface model, the map that tiles are cut from where it is another than `dom`, true
        cloud. Tracks that need one that is missing have no truth.
    plane_height_m : float or None
        z0; None for the median height of the surface model.
    priors : Poses or None
        N, NaN where a photo has none.
    metadata : mapping of str to PhotoPrior
        What photos say of themselves, by name.
    conditions : mapping of str to sequence of N
        Further columns of queries.csv, by which scores can be broken down.
    unposed : tuple of str
        Names of photos without a pose.
    notes : tuple of str
        Sentences for the user about this scene, such as values that were assumed.
    """

    scene: str
    images: Path
    names: tuple[str, ...]
    cameras: Cameras
    poses: Poses
    crs: str
    dom: Path | None = None
    dsm: Path | None = None
    gallery: Path | None = None
    cloud: Path | None = None
    plane_height_m: float | None = None
    priors: Poses | None = None
    metadata: Mapping[str, PhotoPrior] = field(default_factory=dict)
    conditions: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    unposed: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class NativeOptions:
    """What every benchmark asks for; each may add options of its own."""

    source: Annotated[Path, Option("source", "Folder of the benchmark, as it is downloaded.")]
    scene: Annotated[
        list[str] | None, Option("scene", "Only this scene; repeat it (default: all).")
    ] = None
    keep_going: Annotated[
        bool, Option("keep-going", "Leave out scenes that cannot be read, instead of stopping.")
    ] = False


OptionsT = TypeVar("OptionsT", bound=NativeOptions)


class NativeDataset(Dataset[OptionsT]):
    """A published benchmark as it is downloaded.

    Attributes
    ----------
    about : About
    """

    about: ClassVar[About]

    @abstractmethod
    def protocols(self, options: OptionsT, root: Path) -> BenchmarkProtocols:
        """Return the protocols that the benchmark's truth is made for.

        Parameters
        ----------
        options : NativeOptions
        root : Path
            The data root, for protocols to start from.
        """

    @abstractmethod
    def scenes(self, options: OptionsT) -> list[str]:
        """Return the ids of the scenes that stand below the source, in the protocols' order.

        Parameters
        ----------
        options : NativeOptions

        Raises
        ------
        UserError
            None is there; the message says what was found and what the layout is.
        """

    @abstractmethod
    def read(self, options: OptionsT, scene: str, progress: Progress) -> NativeScene:
        """Read a scene's native files.

        Parameters
        ----------
        options : NativeOptions
        scene : str
            One of `scenes`.
        progress : Progress

        Raises
        ------
        UserError
            A file is missing, half there or not as the benchmark has it.
        """

    def prepare(self, options: OptionsT, settings: PrepareSettings) -> Prepared:
        """Make the benchmark folder of all scenes."""
        raise NotImplementedError
