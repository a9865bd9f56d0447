"""What is checked: cameras and poses of a scene, from a benchmark folder or from a pose file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

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
from airzoo_bench.datasets.clouds import check_cloud
from airzoo_bench.datasets.content import photo_sizes, surveyed
from airzoo_bench.datasets.facts import Cameras3D, SceneFacts, scene_facts
from airzoo_bench.datasets.metadata import read_prior
from airzoo_bench.datasets.poses import read_poses
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import LOCAL_CRS, describe_crs, same_plane
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.matching.truth import checked_dsm
from airzoo_bench.matching.truth import read_truth as read_matching_truth
from airzoo_bench.retrieval.truth import read_truth as read_retrieval_truth

__all__ = [
    "PosedScene",
    "folder_facts",
    "open_benchmark",
    "scene_from_poses",
    "scenes_of_benchmark",
]

_ROUNDED_M = 2e-3  # altitudes are written to 1 mm


@dataclass(frozen=True, eq=False)
class PosedScene:
    """The N photos of a scene, sorted by id.

    `images` are relative to `folder`; `crs` is None where nobody has named it, or it is local.
    """

    name: str
    ids: tuple[str, ...]
    images: tuple[str, ...]
    cameras: Cameras
    poses: Poses
    crs: str | None
    folder: Path
    plane_height_m: float | None = None
    facts: SceneFacts | None = None


def open_benchmark(place: Path) -> Benchmark:
    """Open a benchmark folder, named by its path or by its name in the data root."""
    named = data_root() / place
    passed_over = not (place / MARK).is_file() and (named / MARK).is_file()
    missing = not place.exists() and named.is_dir()
    return Benchmark.open(named if passed_over or missing else place)


def scenes_of_benchmark(
    benchmark: Benchmark, only: str | None = None, *, measured: bool = False
) -> list[PosedScene]:
    """Read the scenes of a benchmark, or one of them: all photos, queries of a track or not."""
    scenes = [scene for scene in benchmark.file.scenes if only in (None, scene.id)]
    if not scenes:
        raise UsageError(
            f"there is no scene {only!r}",
            where=benchmark.folder,
            expected="one of " + ", ".join(scene.id for scene in benchmark.file.scenes),
        )
    return [_scene(benchmark, scene, measured) for scene in scenes]


def _scene(benchmark: Benchmark, scene: SceneFile, measured: bool) -> PosedScene:
    numbers = (*CAMERA_COLUMNS, *POSE_COLUMNS)
    photos = read_queries(benchmark.scene_folder(scene.id), pd.DataFrame({"id": []}), numbers)
    _check_entry(benchmark, scene, photos)
    return PosedScene(
        scene.id,
        tuple(photos["id"]),
        tuple(photos["image"]),
        cameras_of(photos),
        poses_of(photos),
        None if scene.crs == LOCAL_CRS else scene.crs,
        benchmark.resolve(scene.images),
        scene.plane_height_m,
        folder_facts(benchmark, scene.id) if measured else None,
    )


def scene_from_poses(
    poses: Path, images: Path, crs: str | None, progress: Progress = silent
) -> PosedScene:
    """Read a scene from a pose file and the folder of its photos, as `prepare photos` does."""
    photos = read_poses(poses, photo_sizes(images, progress))
    name, crs = images.resolve().name, crs or photos.crs
    return PosedScene(name, photos.names, photos.names, photos.cameras, photos.poses, crs, images)


def _check_entry(benchmark: Benchmark, scene: SceneFile, photos: pd.DataFrame) -> None:
    """Check a scene's entry in benchmark.toml, which has no checksum, against files that do."""
    said, dsm = "", benchmark.resolve(scene.dsm or "")
    if "altitude_m" in photos and scene.plane_height_m is not None:
        off = np.abs(photos["z"] - photos["altitude_m"] - scene.plane_height_m)
        if (off > _ROUNDED_M).any():
            said = (
                f"plane_height_m is {scene.plane_height_m:g}, the photos' altitudes are of another"
            )
    if scene.dsm and dsm.is_file():
        crs = open_info(dsm).crs
        if scene.crs is None or not same_plane(scene.crs, crs):
            said = f"its CRS is {scene.crs}, that of the surface model {describe_crs(crs)}"
        if scene.dsm_sha256 is not None:
            checked_dsm(dsm, scene.dsm_sha256)
    if said:
        raise BenchmarkError(
            said,
            where=f"{benchmark.folder / 'benchmark.toml'}, scene {scene.id}",
            fix="put back what was changed, or prepare the benchmark again",
        )


def folder_facts(benchmark: Benchmark, scene: str) -> SceneFacts | None:
    """Compare the parts of a prepared scene with each other; None where maps are missing."""
    entry, home = benchmark.scene(scene), benchmark.scene_folder(scene)
    dom, dsm, cloud = (
        path and benchmark.resolve(path) for path in (entry.dom, entry.dsm, entry.cloud)
    )
    if not entry.crs or not all(path.is_file() for path in (dom, dsm) if path):
        return None
    photos = read_queries(home, pd.DataFrame({"id": []}), (*CAMERA_COLUMNS, *POSE_COLUMNS))
    info = open_info(dom) if dom else None
    inputs = SceneInputs(scene, photos, entry.crs, info, dsm or None, entry.plane_height_m)
    served = {track for track in benchmark.file.tracks if (home / track).is_dir()}
    images = benchmark.resolve(entry.images)
    there = [name for name in photos["image"] if (images / name).is_file()]
    metadata = {name: read_prior(images / name) for name in there}
    return scene_facts(
        inputs,
        metadata,
        surveyed(dsm) if dsm else None,
        Cameras3D.measure(inputs, metadata),
        read_retrieval_truth(home, scene) if "retrieval" in served else None,
        read_matching_truth(benchmark, scene) if "matching" in served else None,
        check_cloud(cloud, inputs) if cloud and cloud.is_file() else None,
    )
