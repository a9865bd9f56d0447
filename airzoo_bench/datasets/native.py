"""Published benchmarks as downloaded: what each says of itself, and a scene as it is read."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeVar

from airzoo_bench.core.options import Option
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.datasets.dataset import Dataset, Prepared, PrepareSettings

if TYPE_CHECKING:
    import pandas as pd

    from airzoo_bench.datasets.dji import PhotoPrior
    from airzoo_bench.datasets.scene_parts import SceneSource
    from airzoo_bench.datasets.truths import BenchmarkProtocols
    from airzoo_bench.geometry.cameras import Cameras
    from airzoo_bench.geometry.poses import Poses

__all__ = ["About", "NativeDataset", "NativeOptions", "NativeScene", "paths_among"]


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
        How far assumed values may be off, see `retrieval.assumptions.AssumedRanges`.
    without_range : tuple of str
        Assumptions of the truth that `ranges` cannot express, such as which way an angle turns.
    scene_files : mapping of str to tuple of str
        Patterns (`fnmatch`) of the paths in the repository that are of one scene alone, by its id,
        for `download --scene`; empty where scenes cannot be fetched by themselves.
    """

    title: str
    page: str
    licence: str
    repository: str | None = None
    links: tuple[str, ...] = ()
    assumptions: tuple[str, ...] = ()
    unverified: tuple[str, ...] = ()
    ranges: Mapping[str, float] = field(default_factory=dict)
    without_range: tuple[str, ...] = ()
    scene_files: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


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
    cameras : Cameras or None
        N, for the photos' own size; None, as `poses` and `crs`, where photos have no poses.
    poses : Poses or None
        N, in `crs`.
    crs : str or None
        Projected, in metres; `geometry.crs.LOCAL_CRS` for a frame in metres, z up, that has no
        place on the earth, where there is neither map nor surface model.
    dom, dsm, gallery, cloud : Path or None
        Map, surface model, the map that tiles are cut from where it is another than `dom`, true
        cloud. Tracks that need one that is missing have no truth.
    maps : Path or None
        Folder of a map and a surface model for each photo, where there are none of the whole
        scene, see `matching.maps.own_map`.
    plane_height_m : float or None
        z0; None for the median height of the surface model, or where there is no ground.
    priors : Poses or None
        N, NaN where a photo has none.
    metadata : mapping of str to PhotoPrior
        What photos say of themselves, by name.
    is_metadata : bool
        Whether poses are the metadata's, which are no priors then.
    conditions : mapping of str to sequence of N
        Further columns of queries.csv, by which scores can be broken down.
    unposed : tuple of str
        Names of photos without a pose.
    notes : tuple of str
        Sentences for the user about this scene, such as values that were assumed.
    poses_from : Path or None
        The file of the poses, for messages.
    crs_from : str
        Where the CRS is stated, for messages.
    truth_accuracy_m : float or None
        Standard error of the true positions, where it is stated.
    """

    scene: str
    images: Path
    names: tuple[str, ...]
    cameras: Cameras | None
    poses: Poses | None
    crs: str | None
    dom: Path | None = None
    dsm: Path | None = None
    gallery: Path | None = None
    cloud: Path | None = None
    maps: Path | None = None
    plane_height_m: float | None = None
    priors: Poses | None = None
    metadata: Mapping[str, PhotoPrior] = field(default_factory=dict)
    is_metadata: bool = False
    conditions: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    unposed: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    poses_from: Path | None = None
    crs_from: str = ""
    truth_accuracy_m: float | None = None

    @property
    def files(self) -> dict[str, Path]:
        """What the benchmark refers to, by the name that benchmark.toml has for it."""
        parts = {"images": self.images, "dom": self.dom, "dsm": self.dsm}
        parts |= {"gallery": self.gallery, "cloud": self.cloud, "maps": self.maps}
        return {key: path for key, path in parts.items() if path is not None}

    @property
    def pose_source(self) -> Path:
        """What messages about poses name: their file, or the folder of the photos."""
        return self.poses_from or self.images

    @property
    def crs_place(self) -> str:
        """What messages about the CRS name."""
        return self.crs_from or f"{self.pose_source}, scene {self.scene}"

    def condition_table(self) -> pd.DataFrame:
        """Return the conditions, a row a photo, with the column ``id``."""
        import pandas as pd

        from airzoo_bench.benchmark.queries import photo_id

        ids = [photo_id(self.scene, name) for name in self.names]
        return pd.DataFrame({"id": ids, **self.conditions})


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

    def files(self, options: OptionsT, scene: str) -> Iterable[Path]:
        """Return the files and folders that a scene is read from, all else may change.

        By them a second run knows that a scene need not be made again. This is the source and
        every other path among the options; a dataset whose scenes have folders of their own may
        say so.

        Parameters
        ----------
        options : NativeOptions
        scene : str
            One of `scenes`.
        """
        return paths_among(options)

    def folder_name(self, options: OptionsT, root: Path) -> str:
        """Name the folder, which is another where only some of the scenes are there or wanted."""
        source, protocols = self._source(options, silent), self.protocols(options, root)
        return protocols.of_scenes(source.scenes).every[0].benchmark

    def is_prepared(self, options: OptionsT, settings: PrepareSettings) -> bool:
        """Whether the folder is complete, and made from files that did not change since."""
        from airzoo_bench.datasets.native_prepare import is_prepared

        protocols = self.protocols(options, settings.root)
        return is_prepared(self._source(options, silent), protocols, settings)

    def prepare(self, options: OptionsT, settings: PrepareSettings) -> Prepared:
        """Make the benchmark folder of all scenes."""
        from airzoo_bench.datasets.native_prepare import prepare_scenes
        from airzoo_bench.datasets.sources import check_target

        check_target(paths_among(options), settings.folder)
        protocols = self.protocols(options, settings.root)
        return prepare_scenes(self._source(options, settings.progress), protocols, settings)

    def _source(self, options: OptionsT, progress: Progress) -> SceneSource:
        from airzoo_bench.datasets.native_prepare import chosen_scenes
        from airzoo_bench.datasets.scene_parts import SceneSource

        return SceneSource(
            chosen_scenes(self.scenes(options), options.scene, options.source),
            partial(self.read, options, progress=progress),
            partial(self.files, options),
            options,
            options.keep_going,
        )


def paths_among(options: Any) -> list[Path]:
    """Return the values of a dataclass that are paths."""
    values = [getattr(options, one.name) for one in fields(options)]
    return [value for value in values if isinstance(value, Path)]
