"""The shipped demo: its command, and that AirZoo-Mini's code still makes its region.

``python -m tests.test_demo FOLDER`` writes what `airzoo_bench/demo/` holds.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pandas as pd
import pytest
import rasterio
from numpy.typing import NDArray
from PIL import Image

from airzoo_bench.benchmark.folder import find_benchmark
from airzoo_bench.datasets.content import SceneContent
from airzoo_bench.datasets.folder import write_benchmark
from airzoo_bench.datasets.mini.build import build_world
from airzoo_bench.datasets.mini.dataset import SURVEY, mini_photos, scene_inputs, seen_surface
from airzoo_bench.datasets.mini.renderer import FrameList, default_camera, render_frames
from airzoo_bench.datasets.mini.world import CRS, World, save_world
from airzoo_bench.datasets.settings import PrepareSettings
from airzoo_bench.datasets.truths import BenchmarkProtocols, build_truths
from tests.support import run_main, write_raster

NAME = "airzoo-demo"
SEED = 0
ROLL_PHOTOS = 8
EDGE_M = 45.0  # of the region, which the maps leave out on each side


def make(folder: Path) -> None:
    """Write the benchmark folder, with photos, maps and cloud in it."""
    world = build_world("city", SEED)
    photos = _photos(world)
    tracks = ("retrieval", "matching", "reconstruction")
    protocols = BenchmarkProtocols.find([f"{NAME}-{track}" for track in tracks], Path())
    with tempfile.TemporaryDirectory() as temporary:
        home = Path(temporary)
        save_world(home / "world", world)
        render_frames(photos, home / "world", home)
        files = _maps(world, home) | {"images": home / "images", "cloud": home / "cloud.laz"}
        _write_cloud(files["cloud"], seen_surface(photos, home).points)
        inputs = scene_inputs(world.region, photos, files, SEED)
        surveyed = inputs.photos["sequence"] == SURVEY
        content = SceneContent(
            inputs, build_truths(inputs, protocols, files["cloud"], surveyed), files
        )
        settings = PrepareSettings(folder, home, copy=True, replace=True)
        write_benchmark([content], protocols, settings)


def _photos(world: World) -> FrameList:
    """Return the survey and some photos of the barrel roll, all by a small camera."""
    whole = mini_photos(world.region, world.dsm, SEED)
    surveyed = whole.sequence.count(SURVEY)
    middle = np.array([world.region.west, world.region.south]) + world.region.side_m / 2
    away_m = np.abs(whole.poses.centres[surveyed:, :2] - middle).max(axis=1)
    roll = surveyed + np.sort(np.argsort(away_m, kind="stable")[:ROLL_PHOTOS])
    rows = [*range(surveyed), *roll.tolist()]
    columns = ("names", "weather", "time_of_day", "sequence")
    chosen = {name: tuple(getattr(whole, name)[row] for row in rows) for name in columns}
    small = default_camera(320, 240)
    return replace(whole, camera=small, poses=whole.poses.take(np.array(rows)), **chosen)


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
    west, north = region.west + EDGE_M, region.south + region.side_m - EDGE_M
    place = rasterio.Affine(step, 0.0, west, 0.0, -step, north)
    packed: dict[str, Any] = {"compress": "JPEG", "photometric": "YCBCR", "jpeg_quality": 85}
    if heights:
        packed = {"compress": "DEFLATE", "predictor": 3, "zlevel": 9}
    write_raster(path, bands, crs=CRS, transform=place, tiled=True, **packed)


def _write_cloud(path: Path, points: NDArray[np.float64]) -> None:
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.offsets, header.scales = np.floor(points.min(axis=0)), np.full(3, 0.001)
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = points.T
    cloud.write(path)


@pytest.mark.slow
def test_the_demo_keeps_its_predictions(tmp_path: Path) -> None:
    assert run_main("demo", "--out", tmp_path / "demo") == 0
    made = {path: path.stat().st_mtime_ns for path in (tmp_path / "demo").rglob("sift*.npz")}
    assert len(made) == 2
    assert run_main("demo", "--out", tmp_path / "demo") == 0
    assert made == {path: path.stat().st_mtime_ns for path in made}


@pytest.mark.slow
def test_the_shipped_region_is_what_airzoo_mini_makes(tmp_path: Path) -> None:
    made = tmp_path / "airzoo-demo"
    make(made)
    shipped = find_benchmark("airzoo-demo", tmp_path / "none").folder
    files = {path.relative_to(shipped) for path in shipped.rglob("*") if path.is_file()}
    assert files == {path.relative_to(made) for path in made.rglob("*") if path.is_file()}
    for file in files:
        if file.suffix == ".csv":
            pd.testing.assert_frame_equal(pd.read_csv(shipped / file), pd.read_csv(made / file))
        elif file.suffix == ".npz":
            with np.load(shipped / file) as old, np.load(made / file) as new:
                assert all(np.array_equal(old[key], new[key]) for key in {*old, *new})
        elif file.suffix == ".jpg":  # colours depend on the processor in their last digit
            old, new = (np.asarray(Image.open(home / file), float) for home in (shipped, made))
            assert np.abs(old - new).mean() < 0.5
        elif file.suffix in {".laz", ".parquet", ".tif", ".toml"}:
            assert (shipped / file).stat().st_size == (made / file).stat().st_size


if __name__ == "__main__":
    make(Path(sys.argv[1]))
