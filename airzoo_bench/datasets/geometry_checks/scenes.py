"""Cameras and poses of a scene to be checked, from a benchmark folder or from a pose file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from airzoo_bench.benchmark.folder import Benchmark, SceneFile
from airzoo_bench.benchmark.queries import (
    CAMERA_COLUMNS,
    POSE_COLUMNS,
    SceneInputs,
    cameras_of,
    poses_of,
    read_queries,
)
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import MARK, data_root
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.datasets.clouds import check_cloud
from airzoo_bench.datasets.content import photo_sizes, surveyed
from airzoo_bench.datasets.facts import SceneFacts, measure_facts, measure_heights
from airzoo_bench.datasets.metadata import read_prior
from airzoo_bench.datasets.poses import read_poses
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import LOCAL_CRS
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.matching.truth import read_truth as read_matching_truth
from airzoo_bench.retrieval.truth import read_truth as read_retrieval_truth


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
    is_name = not (place / MARK).is_file() and (named / MARK).is_file()
    return Benchmark.open(named if is_name else place)


def scenes_of_benchmark(
    benchmark: Benchmark, only: str | None = None, *, measured: bool = False
) -> list[PosedScene]:
    """Read the scenes of a benchmark, or one; `measured` compares their parts with each other."""
    scenes = [scene for scene in benchmark.file.scenes if only in (None, scene.id)]
    if not scenes:
        known = "one of " + ", ".join(scene.id for scene in benchmark.file.scenes)
        raise UsageError(f"there is no scene {only!r}", where=benchmark.folder, expected=known)
    return [_read_scene(benchmark, scene, measured=measured) for scene in scenes]


def _read_scene(benchmark: Benchmark, scene: SceneFile, *, measured: bool) -> PosedScene:
    numbers = (*CAMERA_COLUMNS, *POSE_COLUMNS)
    photos = read_queries(benchmark.scene_folder(scene.id), pd.DataFrame({"id": []}), numbers)
    return PosedScene(
        scene.id,
        tuple(photos["id"]),
        tuple(photos["image"]),
        cameras_of(photos),
        poses_of(photos),
        None if scene.crs == LOCAL_CRS else scene.crs,
        benchmark.resolve(scene.images),
        scene.plane_height_m,
        _measure_facts(benchmark, scene, photos) if measured else None,
    )


def _measure_facts(
    benchmark: Benchmark, scene: SceneFile, photos: pd.DataFrame
) -> SceneFacts | None:
    """Compare the parts of a scene as `prepare` does; return None where its maps are missing."""
    home, images = benchmark.scene_folder(scene.id), benchmark.resolve(scene.images)
    dom, dsm, cloud = (
        None if path is None else benchmark.resolve(path)
        for path in (scene.dom, scene.dsm, scene.cloud)
    )
    if not scene.crs or not all(path.is_file() for path in (dom, dsm) if path is not None):
        return None
    info = None if dom is None else open_info(dom)
    inputs = SceneInputs(scene.id, photos, scene.crs, info, dsm, scene.plane_height_m)
    there = [name for name in photos["image"] if (images / name).is_file()]
    tracks = {track for track in benchmark.file.tracks if (home / track).is_dir()}
    return measure_facts(
        inputs,
        {name: read_prior(images / name) for name in there},
        measure_heights(inputs),
        None if dsm is None else surveyed(dsm),
        read_retrieval_truth(home, scene.id) if "retrieval" in tracks else None,
        read_matching_truth(benchmark, scene.id) if "matching" in tracks else None,
        check_cloud(cloud, inputs) if cloud is not None and cloud.is_file() else None,
    )


def scene_from_poses(
    poses: Path, images: Path, crs: str | None, progress: Progress = silent
) -> PosedScene:
    """Read a scene from a pose file and the folder of its photos, as `prepare photos` does."""
    photos = read_poses(poses, photo_sizes(images, progress))
    name, crs = images.resolve().name, crs or photos.crs
    return PosedScene(name, photos.names, photos.names, photos.cameras, photos.poses, crs, images)
