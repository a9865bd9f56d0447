"""Options of every dataset, and the result of `prepare`; imports little, for the help's sake."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal

from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.engines.engine import HERE, Engine

Convention = Literal["gimbal", "airframe", "omega-phi-kappa"]
"""What three angles mean, see `datasets.cameras`."""
Files = list[str] | None
"""What is given as SCENE=FILE, repeated."""


@dataclass(frozen=True)
class SourceOptions:
    """The options that a dataset has unless it states more."""

    source: Path
    scene: list[str] | None = None


@dataclass(frozen=True, kw_only=True)
class SceneOptions:
    """The further parts of a scene, and what differs from the protocols to start from."""

    dsm: Path | None = None
    cloud: Path | None = None
    priors: Path | None = None
    crs: str | None = None
    plane_height: float | None = None
    truth_accuracy: float | None = None
    protocol: list[str] | None = None
    tile_size: list[int] | None = None
    rule: Literal["plane", "dsm", "iou"] | None = None
    iou_above: float | None = None


@dataclass(frozen=True, kw_only=True)
class SurveyOptions(SceneOptions, SourceOptions):
    """Options of surveys from other programs."""

    name: str | None = None
    images: Path | None = None
    dom: Path | None = None


@dataclass(frozen=True)
class PhotoOptions(SceneOptions):
    """Where the parts of a scene lie."""

    name: str
    images: Path
    poses: Path
    dom: Path


@dataclass(frozen=True, kw_only=True)
class ColmapOptions(SurveyOptions):
    """Options of a COLMAP model."""

    georeference: Path | None = None
    from_exif: bool = False


@dataclass(frozen=True, kw_only=True)
class DjiOptions(SurveyOptions):
    """Options of a folder of DJI photos."""

    camera: Path | None = None


@dataclass(frozen=True, kw_only=True)
class PoseTableOptions(SurveyOptions):
    """Choices that a table of poses leaves open."""

    camera: Path | None = None
    angles: Convention | None = None


@dataclass(frozen=True)
class MiniOptions:
    """Which of AirZoo-Mini's worlds it is: of a seed, or of a sealed edition's key."""

    seed: int = 0
    key_file: Path | None = None


@dataclass(frozen=True)
class UavVisLocOptions(SourceOptions):
    """Choices that UAV-VisLoc leaves open."""

    fov_across: float = 52.0
    fov_along: float = 36.0
    plane_height: list[str] | None = None
    protocol: str = "uav-visloc-retrieval"


@dataclass(frozen=True)
class UavScenesOptions(SourceOptions):
    """Which photos of a run are reconstructed, and what its files do not settle."""

    interval: int = 5
    every: int = 10
    cloud: Files = None


@dataclass(frozen=True)
class UrbanScene3DOptions(SourceOptions):
    """Scans, and how the frame of the poses leads to theirs."""

    scan: Files = None
    transform: Files = None
    same_frame: bool = False
    every: int = 1


@dataclass(frozen=True)
class AirZooTestOptions(SourceOptions):
    """Which frames are reconstructed, and how depth is encoded."""

    name: str = "airzoo-test"
    every: int = 30
    depth_kind: Literal["z", "ray"] = "z"
    depth_scale: float | None = None


@dataclass(frozen=True)
class AirZooRealOptions(SourceOptions):
    """Choices that the release leaves open, and files of one kind to tell apart."""

    dom: Files = None
    dsm: Files = None
    satellite: Files = None
    priors: Files = None
    prior: Literal["metadata", "truth"] = "metadata"
    cloud: Files = None


@dataclass(frozen=True)
class ExtreMatchOptions(SourceOptions):
    """Differences from the paper's protocol."""

    reference: Literal["hq", "lq"] = "hq"
    prior: Literal["metadata", "truth"] = "metadata"
    priors: Path | None = None


OPTIONS: dict[str, type[Any]] = {
    "photos": PhotoOptions,
    "airzoo-mini": MiniOptions,
    "poses": PoseTableOptions,
    "odm": SurveyOptions,
    "dji": DjiOptions,
    "colmap": ColmapOptions,
    "uav-visloc": UavVisLocOptions,
    "uavscenes": UavScenesOptions,
    "urbanscene3d": UrbanScene3DOptions,
    "airzoo-test": AirZooTestOptions,
    "airzoo-real": AirZooRealOptions,
    "aerialextrematch": ExtreMatchOptions,
    **dict.fromkeys(
        ("ortholoc", "university-1652", "sues-200", "denseuav", "gta-uav"), SourceOptions
    ),
}
"""The options of built-in datasets by name, for a help that imports none of them."""


@dataclass(frozen=True)
class PrepareSettings:
    """Options of every dataset.

    `folder`, which appears when it is complete, is the benchmark folder to make; `root` is the data
    root, for protocols to start from and for what is kept between runs. Tiles and crops are written
    as files if they are wanted `on_disk`, else they are windows of the map; `copy` puts photos,
    maps and clouds into the folder; `replace` allows to replace one that is there. `note` takes
    sentences for the user. The benchmark does not depend on the `engine`.
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
        """Leave out what other processes cannot show."""
        flags = (self.tiles_on_disk, self.crops_on_disk, self.copy, self.replace)
        places = (self.folder.absolute(), self.root.absolute())
        return partial(PrepareSettings, *places, *flags), ()


@dataclass(frozen=True)
class TrackSummary:
    """A line on a scene's truth for a track, its queries, and how many photos are left out."""

    text: str
    count: int
    left_out: int = 0


@dataclass(frozen=True)
class SceneSummary:
    """Lines that `prepare` prints about a scene; `without_truth` says why a track has none."""

    photos: int
    facts: tuple[str, ...] = ()
    tracks: Mapping[str, TrackSummary] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    without_truth: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Prepared:
    """The result of `prepare`.

    `protocols` are names with their tracks; `summaries` are by scene.
    """

    folder: Path
    protocols: Mapping[str, str]
    summaries: Mapping[str, SceneSummary] = field(default_factory=dict)
