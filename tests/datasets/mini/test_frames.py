"""Worlds and frames on disk: places, tables, and that what is there is not made again."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import rasterio
from PIL import Image

from airzoo_bench.datasets.mini import renderer as photos
from airzoo_bench.datasets.mini.noise import seed_of
from airzoo_bench.datasets.mini.world import CRS, ensure_world, load_world, save_world
from airzoo_bench.geometry.crs import from_lonlat, grid_convergence_deg
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.poses import Poses, angles_to_rotations
from airzoo_bench.geometry.rasters import read_rgb
from tests.datasets.mini.conftest import CORNER, REGION, renderer, small_world
from tests.engines.work import Scattered

NUMBER = np.arange(4)
ROTATION = angles_to_rotations(37.0 * NUMBER, -90.0 + 13.0 * NUMBER, 2.0, convergence_deg=0.4)
CENTRES = np.array([48.0, 48.0, 80.0]) + np.outer(NUMBER, (3.0, -2.0, 1.5)) + CORNER
FRAMES = photos.FrameList(
    names=("f0", "f1", "f2", "f3"),
    camera=photos.default_camera(64, 48),
    poses=Poses.from_centres(ROTATION, CENTRES),
    weather=("sunny", "rainy", "snowy", "foggy"),
    time_of_day=("day", "night", "day", "sunset"),
    seed=3,
)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("mini") / "world"
    save_world(folder, small_world())
    return folder


@pytest.fixture(scope="module")
def rendered(world: Path) -> Path:
    assert photos.render_frames(FRAMES, world, world.parent / "frames") == 4
    return world.parent / "frames"


def contents(folder: Path) -> dict[str, bytes]:
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def test_what_is_saved_is_loaded_and_built_once(tmp_path: Path, world: Path) -> None:
    worlds = {seed: replace(small_world(), seed=seed) for seed in (0, 8)}
    for seed in (0, 0, 8):  # the second time there is nothing to build from
        loaded = load_world(ensure_world(REGION, seed, tmp_path, lambda _, seed: worlds.pop(seed)))
        assert (loaded.region, loaded.seed) == (REGION, seed)
        for name, array in small_world().arrays.items():
            np.testing.assert_array_equal(loaded.arrays[name], array, strict=True)
    assert contents(tmp_path / "mini-worlds" / "small-0") == contents(world)


def test_other_programs_find_the_rasters_in_place(world: Path) -> None:
    for name, pixel in (("dom", 0.25), ("dsm", 0.5), ("satellite", 0.3)):
        with rasterio.open(world / f"{name}.tif") as dataset:
            assert dataset.crs.to_epsg() == 4547
            assert tuple(dataset.bounds) == (401_000.0, 3_120_000.0, 401_096.0, 3_120_096.0)
            assert dataset.res == pytest.approx((pixel, pixel))
    assert np.array_equal(read_rgb(world / "dom.tif"), small_world().dom)
    # The first row is the northernmost: its first pixel's centre is 0.25 m from the corner.
    field = HeightField.read(world / "dsm.tif")
    assert field.sample((401_000.25, 3_120_095.75)) == small_world().dsm[0, 0]


def test_photo_depth_and_table_of_frames(rendered: Path) -> None:
    view = FRAMES.camera, FRAMES.poses.take(1), "rainy", "night", seed_of(FRAMES.seed, "f1")
    (rgb, true), (image, depth) = renderer().render(*view), photos.frame_paths(rendered, "f1")
    np.testing.assert_array_equal(photos.read_depth(depth), true)
    with Image.open(image) as photo:
        assert np.abs(np.asarray(photo, float) - rgb).mean() < 3.0
    table = pd.read_csv(rendered / "frames.csv")
    for name, column in (("name", "names"), ("weather",) * 2, ("time_of_day",) * 2):
        assert tuple(table[name]) == getattr(FRAMES, column)
    assert table[["fx", "cx"]].to_numpy()[0].tolist() == [FRAMES.camera.focal[0, 0], 32.0]
    lonlat = table[["longitude", "latitude"]].to_numpy()
    there = np.column_stack([from_lonlat(CRS, lonlat), table["altitude"]])
    np.testing.assert_allclose(there, CENTRES, atol=1e-6)
    angles = (table[name] for name in ("yaw", "pitch", "roll"))
    rotation = angles_to_rotations(*angles, convergence_deg=grid_convergence_deg(CRS, lonlat))
    np.testing.assert_allclose(rotation, ROTATION, atol=1e-9)


def test_neither_jobs_nor_order_change_a_byte(tmp_path: Path, world: Path, rendered: Path) -> None:
    turned = {name: getattr(FRAMES, name)[::-1] for name in ("names", "weather", "time_of_day")}
    back = replace(FRAMES, poses=FRAMES.poses.take([3, 2, 1, 0]), **turned)
    photos.render_frames(back, world, tmp_path, Scattered())
    for folder in ("images", "depth"):
        assert contents(rendered / folder) == contents(tmp_path / folder)


def test_only_what_is_missing_or_made_from_something_else_is_rendered(
    tmp_path: Path, world: Path, rendered: Path
) -> None:
    shutil.copytree(rendered, tmp_path / "f")
    assert photos.render_frames(FRAMES, world, tmp_path / "f") == 0
    (tmp_path / "f" / "depth" / "f0.tif").unlink()
    (tmp_path / "f" / "images" / "f2.jpg").write_bytes(b"")
    assert photos.render_frames(FRAMES, world, tmp_path / "f") == 2
    assert contents(tmp_path / "f") == contents(rendered)
    moved = CENTRES + 1e-4 * (NUMBER == 1)[:, None]
    save_world(tmp_path / "other", replace(small_world(), seed=1))
    for made, change, home in (
        (1, {"poses": replace(FRAMES.poses, centres=moved)}, world),
        (4, {"seed": 4}, world),
        (4, {}, tmp_path / "other"),
    ):
        shutil.copytree(rendered, tmp_path / "f", dirs_exist_ok=True)
        assert photos.render_frames(replace(FRAMES, **change), home, tmp_path / "f") == made
