"""The demo's region, made by AirZoo-Mini's own code: ``python -m tests.demo_region FOLDER``.

`airzoo_bench/demo/` holds what this writes; a slow test makes it again and compares.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pandas as pd
import rasterio
from numpy.typing import NDArray

from airzoo_bench.benchmark.queries import SceneInputs, photo_table
from airzoo_bench.datasets.content import SceneContent
from airzoo_bench.datasets.folder import write_benchmark
from airzoo_bench.datasets.mini.frames import IMAGE_SUFFIX, FrameList, render_frames
from airzoo_bench.datasets.mini.prepare import SURVEY, Photos, mini_photos, seen_surface
from airzoo_bench.datasets.mini.priors import noisy_priors
from airzoo_bench.datasets.mini.rendering.renderer import default_camera
from airzoo_bench.datasets.mini.world.build import build_world
from airzoo_bench.datasets.mini.world.model import CRS, World
from airzoo_bench.datasets.settings import PrepareSettings
from airzoo_bench.datasets.truths import BenchmarkProtocols, build_truths
from airzoo_bench.geometry.heightfield import median_height
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.reconstruction.prepared import grid_origin
from airzoo_bench.reconstruction.voxels import VoxelGrid

NAME = "airzoo-demo"
SEED = 0
ROLL_PHOTOS = 8
EDGE_M = 45.0  # of the region, which the maps leave out on each side
VOXEL_M = 0.5


def make(folder: Path) -> None:
    """Write the benchmark folder, with photos, maps and cloud in it."""
    world = build_world("city", SEED)
    photos = _photos(world)
    tracks = ("retrieval", "matching", "reconstruction")
    protocols = BenchmarkProtocols.named([f"{NAME}-{track}" for track in tracks], Path())
    with tempfile.TemporaryDirectory() as temporary:
        home = Path(temporary)
        render_frames(photos.frames, lambda: world, home)
        files = _maps(world, home) | {"images": home / "images", "cloud": home / "cloud.laz"}
        grid = VoxelGrid(VOXEL_M, grid_origin(VOXEL_M))
        cloud = seen_surface(photos, home, grid, lambda rows, *_: rows)
        _write_cloud(files["cloud"], cloud.points)
        inputs = _inputs(photos, files)
        surveyed = inputs.photos["sequence"] == SURVEY
        truths = build_truths(inputs, protocols, files["cloud"], surveyed)
        settings = PrepareSettings(folder, home, copy=True, replace=True)
        write_benchmark([SceneContent(inputs, truths, files)], protocols, settings)


def _photos(world: World) -> Photos:
    """Return the survey and some photos of the barrel roll, all by a small camera."""
    whole = mini_photos(world.region, world.dsm, SEED)
    frames, surveyed = whole.frames, whole.sequence.count(SURVEY)
    middle = np.array([world.region.west, world.region.south]) + world.region.side_m / 2
    away_m = np.abs(frames.poses.centres[surveyed:, :2] - middle).max(axis=1)
    roll = surveyed + np.sort(np.argsort(away_m, kind="stable")[:ROLL_PHOTOS])
    rows = [*range(surveyed), *roll.tolist()]
    small = FrameList(
        names=tuple(frames.names[row] for row in rows),
        camera=default_camera(320, 240),
        poses=frames.poses.take(np.array(rows)),
        weather=tuple(frames.weather[row] for row in rows),
        time_of_day=tuple(frames.time_of_day[row] for row in rows),
        seed=frames.seed,
    )
    return Photos(small, tuple(whole.sequence[row] for row in rows))


def _maps(world: World, home: Path) -> dict[str, Path]:
    rasters = {"dom": world.dom, "dsm": np.round(world.dsm, 2), "gallery": world.satellite}
    for name, pixels in rasters.items():
        _write(home / f"{name}.tif", pixels, world)
    return {name: home / f"{name}.tif" for name in rasters}


def _write(path: Path, pixels: NDArray[Any], world: World) -> None:
    """Write the middle of a raster of the region."""
    region, heights = world.region, pixels.ndim == 2
    step = region.side_m / pixels.shape[1]
    edge = round(EDGE_M / step)
    pixels = pixels[edge:-edge, edge:-edge]
    bands = pixels[None] if heights else np.moveaxis(pixels, -1, 0)
    count, height, width = bands.shape
    west, north = region.west + EDGE_M, region.north - EDGE_M
    place = rasterio.Affine(step, 0.0, west, 0.0, -step, north)
    packed: dict[str, Any] = {"compress": "JPEG", "photometric": "YCBCR", "jpeg_quality": 85}
    if heights:
        packed = {"compress": "DEFLATE", "predictor": 3, "zlevel": 9}
    profile: dict[str, Any] = {"driver": "GTiff", "crs": CRS, "transform": place, "tiled": True}
    profile |= {"count": count, "height": height, "width": width, "dtype": pixels.dtype.name}
    with rasterio.open(path, "w", **profile, **packed) as dataset:
        dataset.write(bands)


def _write_cloud(path: Path, points: NDArray[np.float64]) -> None:
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.offsets, header.scales = np.floor(points.min(axis=0)), np.full(3, 0.001)
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = points.T
    cloud.write(path)


def _inputs(photos: Photos, files: dict[str, Path]) -> SceneInputs:
    frames = photos.frames
    images = tuple(f"{name}{IMAGE_SUFFIX}" for name in frames.names)
    plane = median_height(files["dsm"])
    ids = [f"city/{name}" for name in frames.names]
    priors = noisy_priors(ids, frames.poses, SEED)
    cameras = frames.camera.take(np.zeros(len(frames), dtype=np.int64))
    table = photo_table("city", images, cameras, frames.poses, priors, plane)
    conditions = pd.DataFrame(
        {"weather": frames.weather, "time_of_day": frames.time_of_day, "sequence": photos.sequence},
        index=ids,
    )
    dom, gallery = open_info(files["dom"]), open_info(files["gallery"])
    table = table.join(conditions, on="id")
    return SceneInputs("city", table, CRS, dom, files["dsm"], plane, gallery=gallery)


if __name__ == "__main__":
    make(Path(sys.argv[1]))
