"""Folders of frames: what is in them, and that rendering goes on where it ended."""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest
import rasterio
from PIL import Image

from airzoo_bench.datasets.mini.frames import (
    FrameList,
    frame_paths,
    read_depth,
    render_frames,
)
from airzoo_bench.datasets.mini.noise import seed_of
from airzoo_bench.datasets.mini.renderer import Renderer
from airzoo_bench.datasets.mini.world import CRS, save_world, world_key
from airzoo_bench.engines.engine import Processes
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras, project
from airzoo_bench.geometry.crs import from_lonlat, geodetic_to_ecef, grid_convergence_deg, to_lonlat
from airzoo_bench.geometry.poses import (
    Poses,
    angles_to_rotations,
    quaternion_to_matrix,
    world_to_camera,
)
from tests.datasets.mini.small_world import small_world
from tests.datasets.mini.views import CORNER, LENS, camera

WEATHER = ("sunny", "rainy", "snowy", "foggy", "cloudy", "sunny")
TIME = ("day", "night", "day", "sunset", "day", "sunset")


def frame_list(count: int = 4, lens: Cameras | None = None) -> FrameList:
    turn = np.arange(count) * 37.0
    rotation = angles_to_rotations(turn, -90.0 + 13.0 * np.arange(count), 2.0, convergence_deg=0.4)
    centres = np.array([48.0, 48.0, 80.0]) + np.outer(np.arange(count), (3.0, -2.0, 1.5)) + CORNER
    return FrameList(
        names=tuple(f"f{number:03d}" for number in range(count)),
        camera=camera(64, 48) if lens is None else lens,
        poses=Poses.from_centres(rotation, centres),
        weather=WEATHER[:count],
        time_of_day=TIME[:count],
        seed=3,
    )


@cache
def stored_world() -> Path:
    folder = Path(mkdtemp()) / "world"
    save_world(folder, small_world())
    return folder


@cache
def rendered() -> Path:
    folder = Path(mkdtemp())
    assert render_frames(frame_list(), stored_world(), folder) == 4
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_the_files_of_a_frame() -> None:
    frames, folder = frame_list(), rendered()
    tables = ["colmap/cameras.txt", "colmap/images.txt", "colmap/offset.json"]
    tables += ["colmap/points3D.txt", "depth/f000.tif", "frames.csv", "images/f000.jpg"]
    assert set(tables) <= set(contents(folder))
    assert len(contents(folder)) == 5 + 2 * 4
    seed = seed_of(frames.seed, "f001")
    true = Renderer(small_world()).render(
        frames.camera, frames.poses.take(1), "rainy", "night", seed
    )
    image, depth = frame_paths(folder, "f001")
    np.testing.assert_array_equal(read_depth(depth), true.depth)
    with pytest.warns(rasterio.errors.NotGeoreferencedWarning):
        raster = rasterio.open(depth)
    with raster:
        assert raster.dtypes == ("float32",)
        assert raster.compression.name == "deflate"
        np.testing.assert_array_equal(raster.read(1), true.depth)
    with Image.open(image) as photo:
        assert np.abs(np.asarray(photo, float) - true.rgb).mean() < 3.0


def _rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "frames.csv").open(encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def _numbers(row: dict[str, str], *names: str) -> Floats:
    return np.array([float(row[name]) for name in names])


def test_places_and_angles_of_the_table() -> None:
    frames = frame_list()
    for number, row in enumerate(_rows(rendered())):
        assert row["name"] == frames.names[number]
        assert (row["weather"], row["time_of_day"]) == (WEATHER[number], TIME[number])
        lonlat = _numbers(row, "longitude", "latitude")
        centre = np.append(from_lonlat(CRS, lonlat), float(row["altitude"]))
        np.testing.assert_allclose(centre, frames.poses.centres[number], atol=1e-6)
        turn = grid_convergence_deg(CRS, lonlat)
        angles = _numbers(row, "yaw", "pitch", "roll")
        rotation = angles_to_rotations(*angles, convergence_deg=turn)
        np.testing.assert_allclose(rotation, frames.poses.rotation[number], atol=1e-9)
        place = np.append(lonlat, float(row["altitude"]))
        ecef = _numbers(row, "ecef_x", "ecef_y", "ecef_z")
        np.testing.assert_allclose(ecef, geodetic_to_ecef(place), atol=1e-6)
        assert _numbers(row, "fx", "cx").tolist() == [frames.camera.focal[0, 0], 32.0]


def test_ecef_poses_see_points_where_grid_poses_do() -> None:
    """By PROJ alone; the grid's scale, 1.0001 here, is all that may differ: 1 cm in 100 m."""
    frames = frame_list()
    points = np.array([[10.0, 20.0, 20.0], [80.0, 70.0, 25.0], [48.0, 90.0, 40.0]]) + CORNER
    ecef = geodetic_to_ecef(np.column_stack([to_lonlat(CRS, points[:, :2]), points[:, 2]]))
    rows = _rows(rendered())
    quaternions = np.array([_numbers(r, "ecef_qw", "ecef_qx", "ecef_qy", "ecef_qz") for r in rows])
    centres = np.array([_numbers(row, "ecef_x", "ecef_y", "ecef_z") for row in rows])
    poses = Poses.from_centres(quaternion_to_matrix(quaternions), centres)
    by_ecef = world_to_camera(poses, np.repeat(ecef[None], 4, axis=0))
    by_grid = world_to_camera(frames.poses, np.repeat(points[None], 4, axis=0))
    np.testing.assert_allclose(by_ecef, by_grid, atol=0.02)


@pytest.mark.parametrize("lens", ["pinhole", "opencv", "full"])
def test_colmap_reads_the_model(tmp_path: Path, lens: str) -> None:
    import pycolmap

    straight = camera(64, 48)
    bent = {"opencv": LENS, "full": ((*LENS[0][:4], 0.01),)}
    cameras = straight
    if lens in bent:
        cameras = Cameras.from_matrices(straight.matrices, 64, 48, bent[lens])
    frames = frame_list(2, lens=cameras)
    render_frames(frames, stored_world(), tmp_path)
    model = pycolmap.Reconstruction(tmp_path / "colmap")
    offset = json.loads((tmp_path / "colmap" / "offset.json").read_text())
    assert offset == {"crs": CRS, "offset": CORNER.tolist()}
    assert len(model.cameras) == 1
    assert len(model.images) == 2
    for image in model.images.values():
        number = frames.names.index(Path(image.name).stem)
        centre = image.projection_center() + CORNER
        np.testing.assert_allclose(centre, frames.poses.centres[number], atol=1e-8)
        point = frames.poses.centres[number] + frames.poses.rotation[number].T @ (1.0, -2.0, 9.0)
        local = world_to_camera(frames.poses.take(number), point[None, None])
        ours = project(frames.camera, local)[0, 0]
        np.testing.assert_allclose(image.project_point(point - CORNER), ours, atol=1e-6)


def test_neither_jobs_nor_order_change_a_byte(tmp_path: Path) -> None:
    frames = frame_list()
    render_frames(frames, stored_world(), tmp_path / "two", engine=Processes(2))
    assert contents(rendered()) == contents(tmp_path / "two")
    turned = list(range(4))[::-1]
    reverse = FrameList(
        names=frames.names[::-1],
        camera=frames.camera,
        poses=frames.poses.take(turned),
        weather=frames.weather[::-1],
        time_of_day=frames.time_of_day[::-1],
        seed=frames.seed,
    )
    render_frames(reverse, stored_world(), tmp_path / "back")
    photos = [
        {name: data for name, data in contents(folder).items() if "f00" in name}
        for folder in (rendered(), tmp_path / "back")
    ]
    assert photos[0] == photos[1]


def test_only_what_is_missing_or_damaged_is_made_again(tmp_path: Path) -> None:
    frames = frame_list()
    shutil.copytree(rendered(), tmp_path, dirs_exist_ok=True)
    whole = contents(tmp_path)
    assert render_frames(frames, stored_world(), tmp_path) == 0
    (tmp_path / "depth" / "f000.tif").unlink()
    photo = tmp_path / "images" / "f001.jpg"
    photo.write_bytes(photo.read_bytes()[:-40])
    (tmp_path / "images" / "f002.jpg").write_bytes(b"")
    (tmp_path / "depth" / "f003.tif").write_bytes(b"not a TIFF")
    assert render_frames(frames, stored_world(), tmp_path) == 4
    assert contents(tmp_path) == whole


def test_what_a_frame_is_made_from_decides_whether_it_is_kept(tmp_path: Path) -> None:
    frames = frame_list(2)
    render_frames(frames, stored_world(), tmp_path)

    def again(changed: FrameList, world: Path | None = None) -> int:
        render_frames(frames, stored_world(), tmp_path)
        return render_frames(changed, world or stored_world(), tmp_path)

    centres = frames.poses.centres.copy()
    centres[1, 0] += 1e-4
    moved = Poses(rotation=frames.poses.rotation, centres=centres)
    assert again(replace(frames, poses=moved)) == 1
    assert again(replace(frames, weather=("sunny", "sunny"))) == 1
    assert again(replace(frames, seed=4)) == 2
    assert again(replace(frames, camera=camera(64, 48, bent=True))) == 2
    albedo = small_world().ground_albedo.copy()
    albedo[0, 0, 0] ^= 1
    save_world(tmp_path / "other", replace(small_world(), ground_albedo=albedo))
    assert world_key(tmp_path / "other") != world_key(stored_world())
    assert again(frames, tmp_path / "other") == 2
