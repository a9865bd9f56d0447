from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from pyproj import CRS, Transformer
from rasterio import Affine
from scipy.spatial.transform import Rotation

from airzoo_bench.errors import RasterError
from airzoo_bench.geometry import blocks
from airzoo_bench.geometry.blocks import blocked_heights
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.grids import pixel_to_world
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import RasterInfo, open_info
from airzoo_bench.geometry.rays import RayStatus
from airzoo_bench.matching import crops
from airzoo_bench.matching.crops import (
    CropStatus,
    CropWindows,
    crop_to_map,
    crop_windows,
    map_to_crop,
)
from tests.geometry.support import looking_down, quick, seeds, write_tif

NAN = np.nan
X, Y = 576000.0, 5188000.0
# 2 m pixels; the map's corner lies 500 m west and 1000 m north of (X, Y).
GRID = Affine(2.0, 0.0, X - 500, 0.0, -2.0, Y + 1000)


def map_of(width: int, height: int, grid: Affine = GRID, crs: object = 32615) -> RasterInfo:
    known = CRS.from_user_input(crs)
    return RasterInfo(Path("dom.tif"), width, height, grid, known, None, 3, "uint8")


def level(height: float = 0.0) -> HeightField:
    """Ground of 4 km by 4 km about (X, Y)."""
    grid = Affine(20.0, 0.0, X - 2000, 0.0, -20.0, Y + 2000)
    return HeightField(np.full((200, 200), height), grid, "EPSG:32615")


def camera(fx: float, fy: float, distortion: Any = None) -> Cameras:
    """A camera of 600 x 400 pixels."""
    K = [[[fx, 0, 300], [0, fy, 200], [0, 0, 1]]]
    return Cameras.from_matrices(K, 600, 400, distortion)


def box(windows: CropWindows) -> list[tuple[int, int, int, int]]:
    return [windows.window(row) for row in range(len(windows))]


def test_nadir_by_hand() -> None:
    # 100 m up, 600 x 400 px at f = 1000: 60 m by 40 m about (X + 10, Y - 20).
    pose = Poses.from_centres(looking_down(0), [(X + 10, Y - 20, 100.0)])
    windows = crop_windows(
        camera(1000, 1000), pose, map_of(500, 600), level(), margin=0.0, max_range_m=300.0
    )
    # West side at X - 20: 480 m = 240 px from the map's corner; north side at Y: 1000 m.
    assert box(windows) == [(240, 500, 30, 20)]
    grown = crop_windows(
        camera(1000, 1000), pose, map_of(500, 600), level(), margin=0.1, max_range_m=300.0
    )
    # A tenth of 30 and 20 px on each side.
    assert box(grown) == [(237, 498, 36, 24)]
    # A quarter of a metre to the east: outward to whole pixels.
    moved = Poses.from_centres(looking_down(0), [(X + 10.25, Y - 20, 100.0)])
    outward = crop_windows(
        camera(1000, 1000), moved, map_of(500, 600), level(), margin=0.0, max_range_m=300.0
    )
    assert box(outward) == [(240, 500, 31, 20)]
    # On ground 50 m high the footprint is half as large: it is the DSM that counts.
    high = crop_windows(
        camera(1000, 1000), pose, map_of(500, 600), level(50.0), margin=0.0, max_range_m=300.0
    )
    assert box(high) == [(247, 505, 16, 10)]


def test_tilted_by_hand() -> None:
    # 45 degrees down to the north, corners at x/z = 1/2, y/z = 1/3; 100 m up. The far corners lie
    # 100 (1 + 1/3) / (1 - 1/3) = 200 m north, the near ones 50 m; the far side is 150 sqrt(2) m.
    pose = Poses.from_centres(looking_down(45), [(X, Y, 100.0)])
    windows = crop_windows(
        camera(600, 600), pose, map_of(500, 600), level(), margin=0.1, max_range_m=500.0
    )
    half, grown = 75 * np.sqrt(2), 0.1 * 150 * np.sqrt(2)
    left, right = np.floor((500 - half - grown) / 2), np.ceil((500 + half + grown) / 2)
    top, bottom = (1000 - 200 - 15) / 2, (1000 - 50 + 15) / 2
    assert box(windows) == [(left, np.floor(top), right - left, np.ceil(bottom) - np.floor(top))]
    assert windows.rays.tolist() == [[RayStatus.HIT] * 4]


def test_above_the_horizon_cut_at_the_range() -> None:
    # Level to the north: corners along (+-3, 6, +-2) / 7. The upper ones never come down: 700 m
    # out they are 300 m aside and 600 m north. The lower ones land after 350 m, half as far.
    pose = Poses.from_centres(looking_down(90), [(X, Y, 100.0)])
    windows = crop_windows(
        camera(600, 600), pose, map_of(500, 600), level(), margin=0.0, max_range_m=700.0
    )
    assert box(windows) == [(100, 200, 300, 150)]
    up, hit = RayStatus.NOT_DOWNWARD, RayStatus.HIT
    assert windows.rays.tolist() == [[up, up, hit, hit]]
    # At 175 m all are cut: 75 m aside, 150 m north; a box without height still has a pixel.
    short = crop_windows(
        camera(600, 600), pose, map_of(500, 600), level(), margin=0.0, max_range_m=175.0
    )
    assert box(short) == [(212, 425, 76, 1)]


def test_without_height_cut_at_the_range() -> None:
    pose = Poses.from_centres(looking_down(0), [(X, Y, 100.0)])
    nothing = HeightField(np.full((9, 9), NAN), Affine(250, 0, X - 1000, 0, -250, Y + 1000), 32615)
    # Rays along (+-3, +-2, -6) / 7.
    windows = crop_windows(
        camera(600, 600), pose, map_of(500, 1000), nothing, margin=0.0, max_range_m=350.0
    )
    assert box(windows) == [(175, 450, 150, 100)]
    assert windows.rays.tolist() == [[RayStatus.OFF_RASTER] * 4]
    # Off the raster likewise.
    afar = HeightField(np.zeros((9, 9)), Affine(1, 0, X + 900, 0, -1, Y), 32615)
    assert box(
        crop_windows(camera(600, 600), pose, map_of(500, 1000), afar, margin=0.0, max_range_m=350.0)
    ) == [(175, 450, 150, 100)]


def test_cut_to_the_map_and_off_it() -> None:
    at = [(X - 490, Y + 995, 100.0), (X - 531, Y, 100.0), (X + 490, Y - 190, 100.0)]
    poses = Poses.from_centres(np.tile(looking_down(0), (3, 1, 1)), at)
    K = np.tile(camera(1000, 1000).matrices, (3, 1, 1))
    windows = crop_windows(
        Cameras.from_matrices(K, 600, 400),
        poses,
        map_of(500, 600),
        level(),
        margin=0.0,
        max_range_m=300.0,
    )
    assert box(windows) == [(0, 0, 20, 13), (0, 0, 0, 0), (480, 585, 20, 15)]
    assert windows.status.tolist() == [CropStatus.CROPPED, CropStatus.OFF_MAP, CropStatus.CROPPED]


def test_a_corner_without_a_ray_does_not_count() -> None:
    pose = Poses.from_centres(looking_down(0), [(X, Y, 100.0)])
    # A barrel that folds back before the corners.
    lens = [[-0.9, 0.0, 0.0, 0.0]]
    windows = crop_windows(
        camera(400, 400, lens), pose, map_of(500, 600), level(), margin=0.1, max_range_m=300.0
    )
    assert windows.status.tolist() == [CropStatus.NO_RAY]
    assert windows.rays.tolist() == [[RayStatus.NO_RAY] * 4]
    # Moved aside, two corners remain.
    K = [[[400, 0, 90], [0, 400, 200], [0, 0, 1]]]
    aside = Cameras.from_matrices(K, 600, 400, [[-0.4, 0, 0, 0]])
    windows = crop_windows(aside, pose, map_of(500, 600), level(), margin=0.1, max_range_m=300.0)
    assert (windows.rays == RayStatus.NO_RAY).tolist() == [[False, True, True, False]]
    assert windows.status.tolist() == [CropStatus.CROPPED]


def test_map_in_degrees() -> None:
    pose = Poses.from_centres(looking_down(0), [(X, Y, 100.0)])
    to_degrees = Transformer.from_crs(32615, 4326, always_xy=True)
    west, north = to_degrees.transform(X - 200, Y + 200)
    step = 5e-6
    dom = map_of(2000, 2000, Affine(step, 0, west, 0, -step, north), 4326)
    windows = crop_windows(camera(600, 600), pose, dom, level(), margin=0.0, max_range_m=300.0)
    lon, lat = to_degrees.transform(
        [X - 50, X + 50, X + 50, X - 50], np.add(Y, [33.33333333] * 2 + [-33.33333333] * 2)
    )
    column, row = (np.array(lon) - west) / step, (north - np.array(lat)) / step
    x, y, width, height = windows.window(0)
    assert (x, y) == (np.floor(column.min()), np.floor(row.min()))
    assert (x + width, y + height) == (np.ceil(column.max()), np.ceil(row.max()))


def rough(rng: np.random.Generator, path: Path) -> Path:
    heights = rng.normal(0, 4, (90, 110)).cumsum(axis=0).astype(np.float32)
    heights[rng.random(heights.shape) < 0.2] = -9999
    return write_tif(path, heights, nodata=-9999, tiled=True, blockxsize=32, blockysize=16)


@settings(quick, max_examples=10)
@given(seeds)
def test_a_file_as_the_field_in_memory(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    rng = np.random.default_rng(seed)
    path = rough(rng, tmp_path_factory.mktemp("crops") / "dsm.tif")
    count = 12
    turns = Rotation.from_euler("xz", rng.uniform((100, -180), (180, 180), (count, 2)), True)
    centres = rng.uniform((X, Y - 45, 60), (X + 55, Y, 140), (count, 3))
    poses = Poses.from_centres(turns.as_matrix(), centres)
    K = np.tile(camera(500, 500).matrices, (count, 1, 1))
    cameras = Cameras.from_matrices(K, 600, 400)
    dom = open_info(path)
    field = HeightField.read(path)
    with pytest.MonkeyPatch.context() as patch:
        expected = crop_windows(cameras, poses, dom, field, margin=0.1, max_range_m=250.0)
        # Blocks and slots so small that they are used up again and again.
        patch.setattr(blocks, "_SIDE", 8)
        patch.setattr(blocks, "_SLOTS", 5)
        patch.setattr(blocks, "_SCAN_PIXELS", 600)
        patch.setattr(crops, "_CAMERAS", 5)
        windows = crop_windows(cameras, poses, dom, path, margin=0.1, max_range_m=250.0)
        with blocked_heights(path) as lazy:
            xy = rng.uniform((X - 2, Y - 47), (X + 57, Y + 2), (300, 2))
            assert lazy.sample(xy).tobytes() == field.sample(xy).tobytes()
            assert lazy.height_range == field.height_range
    assert box(windows) == box(expected)
    assert windows.rays.tobytes() == expected.rays.tobytes()
    assert (windows.x + windows.width <= dom.width).all()
    assert ((windows.width > 0) == (windows.status == CropStatus.CROPPED)).all()


def test_dsm_in_degrees_is_refused(tmp_path: Path) -> None:
    path = write_tif(
        tmp_path / "d.tif",
        np.zeros((4, 4), np.float32),
        crs="EPSG:4326",
        transform=Affine(1e-5, 0, 113, 0, -1e-5, 28),
    )
    pose = Poses.from_centres(looking_down(0), [(X, Y, 100.0)])
    with pytest.raises(RasterError, match="not in metres"):
        crop_windows(camera(600, 600), pose, map_of(9, 9), path, margin=0.1, max_range_m=100.0)


def test_pixels_of_crop_and_map() -> None:
    window = (40, 30, 10, 20)
    assert crop_to_map([(0.0, 0.0), (0.5, 19.5)], window).tolist() == [[40, 30], [40.5, 49.5]]
    assert map_to_crop(crop_to_map([2.25, 3.5], window), window).tolist() == [2.25, 3.5]


def test_real_photos_find_their_place(brighton: Path) -> None:
    scene = json.loads((brighton / "poses.json").read_text())
    images = [scene["images"][name] for name in sorted(scene["images"])]
    poses = Poses.from_centres([i["R_w2c"] for i in images], [i["center_utm"] for i in images])
    K = np.tile(scene["K"], (len(images), 1, 1))
    lens = np.tile(scene["dist_k1k2p1p2"], (len(images), 1))
    cameras = Cameras.from_matrices(K, 4000, 2250, lens)
    dom = open_info(brighton / "dom_10cm.tif")
    windows = crop_windows(
        cameras, poses, dom, brighton / "dsm_10cm.tif", margin=0.1, max_range_m=60.0
    )
    assert (windows.status == CropStatus.CROPPED).all()
    # Nearly nadir: the place below the camera is in the crop, where it is in the map.
    below = np.linalg.solve(
        np.array([[dom.transform.a, 0], [0, dom.transform.e]]),
        (poses.centres[:, :2] - pixel_to_world(dom.transform, (0.0, 0.0))).T,
    ).T
    on_map = ((below > 0) & (below < (dom.width, dom.height))).all(axis=1)
    low = np.stack((windows.x, windows.y), axis=-1)
    high = low + np.stack((windows.width, windows.height), axis=-1)
    assert on_map.sum() >= 10
    assert ((below >= low) & (below <= high)).all(axis=1)[on_map].all()
