"""Worlds and frames on disk: places, COLMAP models, and that what is there is not made again."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pandas as pd
import pycolmap
import pytest
import rasterio
from PIL import Image

from airzoo_bench.core.errors import UsageError
from airzoo_bench.datasets.mini.frames import (
    ECEF_COLUMNS,
    FrameList,
    frame_paths,
    read_depth,
    render_frames,
)
from airzoo_bench.datasets.mini.noise import seed_of
from airzoo_bench.datasets.mini.world import CRS, World, ensure_world, load_world, save_world
from airzoo_bench.engines.engine import Processes
from airzoo_bench.geometry.cameras import project
from airzoo_bench.geometry.crs import from_lonlat, geodetic_to_ecef, grid_convergence_deg, to_lonlat
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.poses import (
    Poses,
    angles_to_rotations,
    quaternion_to_matrix,
    world_to_camera,
)
from airzoo_bench.geometry.rasters import read_rgb
from tests.datasets.mini import support as small
from tests.datasets.mini.support import CORNER, REGION, camera

WEATHER = ("sunny", "rainy", "snowy", "foggy")
TIME = ("day", "night", "day", "sunset")


def frame_list(count: int = 4) -> FrameList:
    number = np.arange(count)
    rotation = angles_to_rotations(37.0 * number, -90.0 + 13.0 * number, 2.0, convergence_deg=0.4)
    centres = np.array([48.0, 48.0, 80.0]) + np.outer(number, (3.0, -2.0, 1.5)) + CORNER
    return FrameList(
        names=tuple(f"f{row:03d}" for row in range(count)),
        camera=camera(64, 48),
        poses=Poses.from_centres(rotation, centres),
        weather=WEATHER[:count],
        time_of_day=TIME[:count],
        seed=3,
    )


@cache
def stored_world() -> Path:
    folder = Path(mkdtemp()) / "world"
    save_world(folder, small.world())
    return folder


@cache
def rendered() -> Path:
    folder = Path(mkdtemp())
    assert render_frames(frame_list(), stored_world(), folder) == 4
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def test_what_is_saved_is_loaded_and_built_once(tmp_path: Path) -> None:
    built = []

    def build(name: str, seed: int) -> World:
        built.append((name, seed))
        return replace(small.world(), seed=seed)

    for seed in (7, 7, 8):
        loaded = load_world(ensure_world(REGION, seed, tmp_path, build))
        assert (loaded.region, loaded.seed) == (REGION, seed)
        for name, array in small.world().arrays.items():
            np.testing.assert_array_equal(loaded.arrays[name], array, strict=True)
    assert built == [("small", 7), ("small", 8)]
    save_world(tmp_path / "again", small.world())
    assert contents(tmp_path / "again") == contents(stored_world())


def test_other_programs_find_the_rasters_in_place() -> None:
    world, folder = small.world(), stored_world()
    for name, pixel in (("dom", 0.25), ("dsm", 0.5), ("satellite", 0.3)):
        with rasterio.open(folder / f"{name}.tif") as dataset:
            assert dataset.crs.to_epsg() == 4547
            assert tuple(dataset.bounds) == (401_000.0, 3_120_000.0, 401_096.0, 3_120_096.0)
            assert dataset.res == pytest.approx((pixel, pixel))
            assert dataset.nodata == (-9999.0 if name == "dsm" else None)
    assert np.array_equal(read_rgb(folder / "dom.tif"), world.dom)
    # The first row is the northernmost: its first pixel's centre is 0.25 m from the corner.
    field = HeightField.read(folder / "dsm.tif")
    assert field.sample((401_000.25, 3_120_095.75)) == world.dsm[0, 0]


def test_the_files_of_a_frame() -> None:
    frames, folder = frame_list(), rendered()
    assert {"frames.csv", "depth/f000.tif", "images/f000.jpg"} <= set(contents(folder))
    view = frames.camera, frames.poses.take(1), "rainy", "night", seed_of(frames.seed, "f001")
    true = small.renderer().render(*view)
    image, depth = frame_paths(folder, "f001")
    np.testing.assert_array_equal(read_depth(depth), true.depth)
    with Image.open(image) as photo:
        assert np.abs(np.asarray(photo, float) - true.rgb).mean() < 3.0


def test_places_and_angles_of_the_table() -> None:
    frames, table = frame_list(), pd.read_csv(rendered() / "frames.csv")
    assert tuple(table["name"]) == frames.names
    assert (tuple(table["weather"]), tuple(table["time_of_day"])) == (WEATHER, TIME)
    lonlat, place = table[["longitude", "latitude"]], table[["longitude", "latitude", "altitude"]]
    np.testing.assert_allclose(
        from_lonlat(CRS, lonlat.to_numpy()), frames.poses.centres[:, :2], atol=1e-6
    )
    turn = grid_convergence_deg(CRS, lonlat.to_numpy())
    rotation = angles_to_rotations(
        table["yaw"], table["pitch"], table["roll"], convergence_deg=turn
    )
    np.testing.assert_allclose(rotation, frames.poses.rotation, atol=1e-9)
    assert table[["fx", "cx"]].to_numpy()[0].tolist() == [frames.camera.focal[0, 0], 32.0]
    # ECEF poses see points where poses of the grid do, by PROJ alone; the grid's scale, 1.0001
    # here, is all that may differ: 1 cm in 100 m.
    ecef = table[[*ECEF_COLUMNS]].to_numpy()
    np.testing.assert_allclose(ecef[:, :3], geodetic_to_ecef(place.to_numpy()), atol=1e-6)
    points = np.array([[10.0, 20.0, 20.0], [80.0, 70.0, 25.0], [48.0, 90.0, 40.0]]) + CORNER
    there = geodetic_to_ecef(np.column_stack([to_lonlat(CRS, points[:, :2]), points[:, 2]]))
    poses = Poses.from_centres(quaternion_to_matrix(ecef[:, 3:]), ecef[:, :3])
    by_ecef = world_to_camera(poses, np.repeat(there[None], 4, axis=0))
    by_grid = world_to_camera(frames.poses, np.repeat(points[None], 4, axis=0))
    np.testing.assert_allclose(by_ecef, by_grid, atol=0.02)


def test_colmap_reads_the_model() -> None:
    frames, folder = frame_list(), rendered() / "colmap"
    model = pycolmap.Reconstruction(folder)
    offset = json.loads((folder / "offset.json").read_text())
    assert offset == {"crs": CRS, "offset": CORNER.tolist()}
    assert (len(model.cameras), len(model.images)) == (1, 4)
    for image in model.images.values():
        number = frames.names.index(Path(image.name).stem)
        centre = image.projection_center() + CORNER
        np.testing.assert_allclose(centre, frames.poses.centres[number], atol=1e-8)
        point = frames.poses.centres[number] + frames.poses.rotation[number].T @ (1.0, -2.0, 9.0)
        local = world_to_camera(frames.poses.take(number), point[None, None])
        ours = project(frames.camera, local)[0, 0]
        np.testing.assert_allclose(image.project_point(point - CORNER), ours, atol=1e-6)


def test_neither_jobs_nor_order_change_a_byte(tmp_path: Path) -> None:
    frames, columns = frame_list(), ("names", "weather", "time_of_day")
    render_frames(frames, stored_world(), tmp_path / "two", engine=Processes(2))
    assert contents(rendered()) == contents(tmp_path / "two")
    turned = {name: getattr(frames, name)[::-1] for name in columns}
    back = replace(frames, poses=frames.poses.take([3, 2, 1, 0]), **turned)
    render_frames(back, stored_world(), tmp_path / "back")
    for name, content in contents(rendered()).items():
        if "f00" in name:
            assert (tmp_path / "back" / name).read_bytes() == content


def test_only_what_is_missing_or_made_from_something_else_is_rendered(tmp_path: Path) -> None:
    frames = frame_list()
    shutil.copytree(rendered(), tmp_path / "f", dirs_exist_ok=True)
    assert render_frames(frames, stored_world(), tmp_path / "f") == 0
    (tmp_path / "f" / "depth" / "f000.tif").unlink()
    (tmp_path / "f" / "images" / "f002.jpg").write_bytes(b"")
    assert render_frames(frames, stored_world(), tmp_path / "f") == 2
    assert contents(tmp_path / "f") == contents(rendered())
    centres = frames.poses.centres.copy()
    centres[1, 0] += 1e-4
    save_world(tmp_path / "other", replace(small.world(), seed=1))
    changes = (
        (1, {"poses": Poses(rotation=frames.poses.rotation, centres=centres)}),
        (1, {"weather": ("sunny", "rainy", "sunny", "foggy")}),
        (4, {"seed": 4}),
        (4, {"camera": camera(64, 47)}),
    )
    for made, change in changes:
        shutil.copytree(rendered(), tmp_path / "f", dirs_exist_ok=True)
        assert render_frames(replace(frames, **change), stored_world(), tmp_path / "f") == made
    shutil.copytree(rendered(), tmp_path / "f", dirs_exist_ok=True)
    assert render_frames(frames, tmp_path / "other", tmp_path / "f") == 4


def test_an_unknown_weather_is_refused() -> None:
    with pytest.raises(UsageError, match="foggy"):
        replace(frame_list(1), weather=("hail",))
