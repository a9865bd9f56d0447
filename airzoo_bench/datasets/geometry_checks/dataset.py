"""What is checked: cameras and poses of a scene, from a benchmark folder or from a pose file.

Of a folder, what its parts say of each other is measured too, as `prepare photos` does.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.manifest import SceneFile
from airzoo_bench.benchmark.queries import (
    CAMERA_COLUMNS,
    POSE_COLUMNS,
    SceneInputs,
    cameras_of,
    poses_of,
    read_queries,
)
from airzoo_bench.core.errors import BenchmarkError, UsageError
from airzoo_bench.core.files import MARK, data_root
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.datasets.cloud_checks import check_cloud
from airzoo_bench.datasets.map_facts import check_overlap
from airzoo_bench.datasets.photo_metadata import read_prior
from airzoo_bench.datasets.raster_checks import check_map, surveyed
from airzoo_bench.datasets.scene_facts import MeasuredScene, SceneFacts, scene_facts
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import LOCAL_CRS, describe_crs, same_plane
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import RasterInfo, open_info
from airzoo_bench.matching.truth import checked_dsm
from airzoo_bench.matching.truth import read_truth as read_matching_truth
from airzoo_bench.retrieval.truth import RetrievalTruth
from airzoo_bench.retrieval.truth import read_truth as read_retrieval_truth

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "PosedScene",
    "check_scene_entry",
    "folder_facts",
    "open_benchmark",
    "scene_from_poses",
    "scenes_of_benchmark",
]


@dataclass(frozen=True, eq=False)
class PosedScene:
    """The N photos of a scene, sorted by id.

    Attributes
    ----------
    name : str
    ids : tuple of str
    images : tuple of str
        File names, relative to `folder`.
    cameras : Cameras
    poses : Poses
        In `crs`.
    crs : str or None
        Projected CRS in metres; None where nobody has named it, or the frame is local.
    folder : Path
        Of the photos.
    plane_height_m : float or None
        Of the ground, where the dataset says.
    benchmark : Benchmark or None
        That the scene is of.
    """

    name: str
    ids: tuple[str, ...]
    images: tuple[str, ...]
    cameras: Cameras
    poses: Poses
    crs: str | None
    folder: Path
    plane_height_m: float | None = None
    benchmark: Benchmark | None = None

    @property
    def without_crs(self) -> str:
        """Why there is no CRS: scenes of benchmarks name it, unless they are local."""
        local = self.benchmark is not None
        return "their frame is local" if local else "the CRS of the poses is not known (--crs)"

    def facts(self) -> SceneFacts | None:
        """Compare the parts of the scene's folder; None for pose files and where maps are missing.

        Raises
        ------
        UserError
            See `folder_facts`.
        """
        return None if self.benchmark is None else folder_facts(self.benchmark, self.name)


def open_benchmark(place: Path) -> Benchmark:
    """Open a benchmark folder, named by its path or by its name in the data root."""
    named = data_root() / place
    passed_over = not (place / MARK).is_file() and (named / MARK).is_file()
    missing = not place.exists() and named.is_dir()
    return Benchmark.open(named if passed_over or missing else place)


def scenes_of_benchmark(benchmark: Benchmark, only: str | None = None) -> list[PosedScene]:
    """Read the scenes of a benchmark, or one of them: all photos, queries of a track or not."""
    scenes = [scene for scene in benchmark.file.scenes if only in (None, scene.id)]
    if not scenes:
        raise UsageError(
            f"there is no scene {only!r}",
            where=benchmark.folder,
            expected="one of " + ", ".join(scene.id for scene in benchmark.file.scenes),
        )
    return [_scene(benchmark, scene) for scene in scenes]


def scene_from_poses(
    poses: Path, images: Path, crs: str | None, progress: Progress = silent
) -> PosedScene:
    """Read a scene from a pose file and the folder of its photos, as `prepare photos` does."""
    from airzoo_bench.datasets.poses import read_poses
    from airzoo_bench.datasets.sources import photo_sizes

    photos = read_poses(poses, photo_sizes(images, progress))
    return PosedScene(
        images.resolve().name,
        photos.names,
        photos.names,
        photos.cameras,
        photos.poses,
        crs or photos.crs,
        images,
    )


def _scene(benchmark: Benchmark, scene: SceneFile) -> PosedScene:
    import pandas as pd

    nothing_left_out = pd.DataFrame({"id": []})
    numbers = (*CAMERA_COLUMNS, *POSE_COLUMNS)
    photos = read_queries(benchmark.scene_folder(scene.id), nothing_left_out, numbers)
    check_scene_entry(benchmark, scene, photos)
    return PosedScene(
        scene.id,
        tuple(photos["id"]),
        tuple(photos["image"]),
        cameras_of(photos),
        poses_of(photos),
        None if scene.crs == LOCAL_CRS else scene.crs,
        benchmark.resolve(scene.images),
        scene.plane_height_m,
        benchmark,
    )


_FIX = "put back what was changed, or prepare the benchmark again"
_ROUNDED_M = 2e-3  # altitudes are written to 1 mm


def check_scene_entry(benchmark: Benchmark, scene: SceneFile, photos: pd.DataFrame) -> None:
    """Check a scene's entry in benchmark.toml, which has no checksum, against files that have one.

    The ground plane is held against the photos' altitudes, the CRS against the surface model, and
    the surface model against its checksum, where these are there.

    Raises
    ------
    BenchmarkError
        They differ.
    """
    where = f"{benchmark.folder / 'benchmark.toml'}, scene {scene.id}"
    if "altitude_m" in photos and scene.plane_height_m is not None:
        off = np.abs(photos["z"] - photos["altitude_m"] - scene.plane_height_m)
        if (off > _ROUNDED_M).any():
            raise BenchmarkError(
                f"plane_height_m is {scene.plane_height_m:g}, and the photos' altitudes are above "
                f"{float((photos['z'] - photos['altitude_m']).median()):g} m",
                where=where,
                expected="the height that altitude_m in queries.csv is above",
                fix=_FIX,
            )
    dsm = benchmark.resolve(scene.dsm or "")
    if not scene.dsm or not dsm.is_file():
        return
    if scene.crs is None or not same_plane(scene.crs, open_info(dsm).crs):
        raise BenchmarkError(
            f"its CRS is {scene.crs}, that of the surface model {describe_crs(open_info(dsm).crs)}",
            where=where,
            expected="poses and surface model in one CRS",
            fix=_FIX,
        )
    if scene.dsm_sha256 is not None:
        checked_dsm(dsm, scene.dsm_sha256)


def folder_facts(benchmark: Benchmark, scene: str) -> SceneFacts | None:
    """Compare the parts of a prepared scene with each other, as `prepare photos` does."""
    import pandas as pd

    entry, home = benchmark.scene(scene), benchmark.scene_folder(scene)
    dom, dsm = (path and benchmark.resolve(path) for path in (entry.dom, entry.dsm))
    if not all(path.is_file() for path in (dom, dsm) if path):
        return None
    numbers = (*CAMERA_COLUMNS, *POSE_COLUMNS) if entry.crs else ()
    photos = read_queries(home, pd.DataFrame({"id": []}), numbers)
    info = check_map(dom) if dom else None
    inputs = SceneInputs(scene, photos, entry.crs, info, dsm or None, entry.plane_height_m)
    served = {track for track in benchmark.file.tracks if (home / track).is_dir()}
    retrieval = read_retrieval_truth(home, scene) if "retrieval" in served else None
    if retrieval is not None and entry.gallery is None and info is not None:
        _check_windows(retrieval, info)
    if info is not None and dsm:
        check_overlap(info, open_info(dsm))
    images = benchmark.resolve(entry.images)
    there = [name for name in photos["image"] if (images / name).is_file()]
    metadata = {name: read_prior(images / name) for name in there}
    cloud = benchmark.resolve(entry.cloud) if entry.cloud else None
    return scene_facts(
        MeasuredScene.of(inputs, metadata, surveyed(dsm) if dsm else None, images),
        retrieval,
        read_matching_truth(benchmark, scene) if "matching" in served else None,
        check_cloud(cloud, inputs) if cloud and cloud.is_file() else None,
    )


def _check_windows(truth: RetrievalTruth, dom: RasterInfo) -> None:
    ends = truth.tiles[["x", "y"]].to_numpy() + truth.tiles[["width", "height"]].to_numpy()
    if (ends > (dom.width, dom.height)).any():
        raise BenchmarkError(
            f"is {dom.width} x {dom.height} px, and tiles reach to {ends[:, 0].max()}, "
            f"{ends[:, 1].max()}",
            where=dom.path,
            expected="the map that the benchmark was prepared with",
            fix=_FIX,
        )
