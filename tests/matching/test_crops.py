from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from pyproj import CRS, Transformer
from rasterio import Affine
from scipy.spatial.transform import Rotation

from airzoo_bench.core.errors import RasterError
from airzoo_bench.geometry import blocks
from airzoo_bench.geometry.blocks import blocked_heights
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import RasterInfo, open_info, pixel_to_world
from airzoo_bench.geometry.rays import RayStatus
from airzoo_bench.matching import crops
from airzoo_bench.matching.crops import (
    CropStatus,
    CropWindows,
    crop_windows,
)
from airzoo_bench.matching.settings import Crop
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


def crop_rule(margin: float, max_range_m: float, missing: str = "nearest") -> Crop:
    return Crop.model_validate(
        {
            "margin": margin,
            "max_range_m": max_range_m,
            "missing_heights": missing,
            "nearest_of_px": 10_000,
        }
    )


grown_crop = partial(crop_rule, 0.1)
plain_crop = partial(crop_rule, 0.0)


def camera(fx: float, fy: float, distortion: Any = None) -> Cameras:
    """A camera of 600 x 400 pixels."""
    K = [[[fx, 0, 300], [0, fy, 200], [0, 0, 1]]]
    return Cameras.from_matrices(K, 600, 400, distortion)


def box(windows: CropWindows) -> list[tuple[int, int, int, int]]:
    return [tuple(window) for window in windows.windows.tolist()]


def cut(
    field: HeightField, rule: Crop, at: Any = (X, Y, 100.0), tilt: float = 0.0, f: float = 600.0
) -> CropWindows:
    """The crop of one photo on a map of 1000 m by 2000 m; rays are along (+-3, +-2, -6) / 7."""
    pose = Poses.from_centres(looking_down(tilt), [at])
    return crop_windows(
        camera(f, f), pose, map_of(500, 1000), field, crop=rule, plane_height_m=-20.0
    )


def test_nadir_by_hand() -> None:
    # 100 m up, 600 x 400 px at f = 1000: 60 m by 40 m about (X + 10, Y - 20).
    at = (X + 10, Y - 20, 100.0)
    # West side at X - 20: 480 m = 240 px from the map's corner; north side at Y: 1000 m.
    assert box(cut(level(), plain_crop(300.0), at, f=1000)) == [(240, 500, 30, 20)]
    # A tenth of 30 and 20 px on each side.
    assert box(cut(level(), grown_crop(300.0), at, f=1000)) == [(237, 498, 36, 24)]
    # A quarter of a metre to the east: outward to whole pixels.
    moved = (X + 10.25, Y - 20, 100.0)
    assert box(cut(level(), plain_crop(300.0), moved, f=1000)) == [(240, 500, 31, 20)]
    # On ground 50 m high the footprint is half as large: it is the DSM that counts.
    assert box(cut(level(50.0), plain_crop(300.0), at, f=1000)) == [(247, 505, 16, 10)]


def test_tilted_by_hand() -> None:
    # 45 degrees down to the north, corners at x/z = 1/2, y/z = 1/3; 100 m up. The far corners lie
    # 100 (1 + 1/3) / (1 - 1/3) = 200 m north, the near ones 50 m; the far side is 150 sqrt(2) m.
    windows = cut(level(), grown_crop(500.0), tilt=45)
    half, grown = 75 * np.sqrt(2), 0.1 * 150 * np.sqrt(2)
    left, right = np.floor((500 - half - grown) / 2), np.ceil((500 + half + grown) / 2)
    top, bottom = (1000 - 200 - 15) / 2, (1000 - 50 + 15) / 2
    assert box(windows) == [(left, np.floor(top), right - left, np.ceil(bottom) - np.floor(top))]
    assert windows.rays.tolist() == [[RayStatus.HIT] * 4]


def test_above_the_horizon_cut_at_the_range() -> None:
    # Level to the north: corners along (+-3, 6, +-2) / 7. The upper ones never come down: 700 m
    # out they are 300 m aside and 600 m north. The lower ones land after 350 m, half as far.
    windows = cut(level(), plain_crop(700.0), tilt=90)
    assert box(windows) == [(100, 200, 300, 150)]
    up, hit = RayStatus.NOT_DOWNWARD, RayStatus.HIT
    assert windows.rays.tolist() == [[up, up, hit, hit]]
    # At 175 m all are cut: 75 m aside, 150 m north; a box without height still has a pixel.
    assert box(cut(level(), plain_crop(175.0), tilt=90)) == [(212, 425, 76, 1)]


def holed(heights: Any, step: float = 4.0) -> HeightField:
    """Ground about (X, Y) whose pixels are `step` wide."""
    rows, columns = np.shape(heights)
    grid = Affine(step, 0, X - columns * step / 2, 0, -step, Y + rows * step / 2)
    return HeightField(np.array(heights, float), grid, "EPSG:32615")


def test_without_any_height_cut_at_the_range() -> None:
    nothing = HeightField(np.full((9, 9), NAN), Affine(250, 0, X - 1000, 0, -250, Y + 1000), 32615)
    windows = cut(nothing, plain_crop(350.0))
    assert box(windows) == [(175, 450, 150, 100)]
    assert windows.rays.tolist() == [[RayStatus.OFF_RASTER] * 4]


def test_a_hole_meets_the_nearest_height() -> None:
    # Ground at 40 m with a lake of 200 m about (X, Y): 60 m down, 60 m by 40 m; cut, the whole map.
    heights = np.full((200, 200), 40.0)
    heights[75:125, 75:125] = NAN
    assert box(cut(holed(heights), plain_crop(700.0))) == [(235, 490, 30, 20)]
    # The plane of -20 m by name: 120 m down; and cut, as version 1 had it.
    assert box(cut(holed(heights), plain_crop(700.0, "plane"))) == [(220, 480, 60, 40)]
    assert box(cut(holed(heights), plain_crop(700.0, "cut"))) == [(100, 400, 300, 200)]
    # The nearest height of the point found counts, not that of the camera's place: 60 m up there.
    heights[100:, :] = 60.0
    heights[74:125, 74:125] = NAN
    windows = cut(holed(heights), plain_crop(700.0))
    assert box(windows) == [(235, 490, 30, 17)]


def test_past_the_edge_meets_the_nearest_height() -> None:
    afar = HeightField(np.full((9, 9), 10.0), Affine(1, 0, X + 900, 0, -1, Y), 32615)
    assert box(cut(afar, plain_crop(350.0))) == [(227, 485, 46, 30)]
    # Farther than the range it is cut all the same, and a camera below the ground sees none.
    assert box(cut(afar, plain_crop(100.0))) == [(228, 485, 44, 30)]
    assert box(cut(afar, plain_crop(350.0), (X, Y, 5.0))) == [(175, 450, 150, 100)]


def test_an_oblique_ray_ends_on_the_lake_and_not_on_its_far_shore() -> None:
    # 45 degrees to the north over a lake from 20 m before the camera to 1,500 m behind it: far
    # corners meet the level of the lake at 200 m; going on, they would meet the shore underground.
    heights = np.zeros((1000, 400))
    heights[125:495] = NAN
    heights[:125] = 400.0
    heights[-1, -1] = -5000.0
    field = holed(heights)
    found = cut(field, plain_crop(3000.0), tilt=45.0)
    assert found.windows[0][1] == 1000 / 2 - 200 / 2
    cutting = cut(field, plain_crop(3000.0, "cut"), tilt=45.0)
    assert cutting.rays[0, 0] == RayStatus.HIT
    assert cutting.windows[0][1] < 10


@settings(quick, max_examples=20)
@given(seeds)
def test_holes_as_if_they_had_been_filled(seed: int) -> None:
    # The oracle: SciPy fills each hole by its nearest height, NumPy pads the edge.
    from scipy.ndimage import distance_transform_edt

    rng = np.random.default_rng(seed)
    steps = np.kron(rng.uniform(0, 3, (6, 6)), np.ones((10, 10)))
    missing = rng.random((12, 12)) < 0.4
    heights = np.where(np.kron(missing, np.ones((5, 5), bool)), NAN, steps)
    nearest = distance_transform_edt(np.isnan(heights), return_distances=False, return_indices=True)
    filled = np.pad(heights[tuple(nearest)], 60, mode="edge")
    at = (X + rng.uniform(-60, 60), Y + rng.uniform(-60, 60), 100.0)
    tilt = rng.uniform(0, 20)
    found = cut(holed(heights), plain_crop(700.0), at, tilt).windows[0]
    whole = cut(holed(filled), plain_crop(700.0), at, tilt).windows[0]
    # Heights differ by 3 m at most, rays are 60 degrees off nadir at most: 5 m, in pixels of 2 m.
    np.testing.assert_allclose(found, whole, atol=6)


def test_cut_to_the_map_and_off_it() -> None:
    at = [(X - 490, Y + 995, 100.0), (X - 531, Y, 100.0), (X + 490, Y - 190, 100.0)]
    poses = Poses.from_centres(np.tile(looking_down(0), (3, 1, 1)), at)
    K = np.tile(camera(1000, 1000).matrices, (3, 1, 1))
    windows = crop_windows(
        Cameras.from_matrices(K, 600, 400),
        poses,
        map_of(500, 600),
        level(),
        crop=plain_crop(300.0),
        plane_height_m=0.0,
    )
    assert box(windows) == [(0, 0, 20, 13), (0, 0, 0, 0), (480, 585, 20, 15)]
    assert windows.status.tolist() == [CropStatus.CROPPED, CropStatus.OFF_MAP, CropStatus.CROPPED]


def test_a_corner_without_a_ray_does_not_count() -> None:
    pose = Poses.from_centres(looking_down(0), [(X, Y, 100.0)])
    # A barrel that folds back before the corners.
    lens = [[-0.9, 0.0, 0.0, 0.0]]
    windows = crop_windows(
        camera(400, 400, lens),
        pose,
        map_of(500, 600),
        level(),
        crop=grown_crop(300.0),
        plane_height_m=0.0,
    )
    assert windows.status.tolist() == [CropStatus.NO_RAY]
    assert windows.rays.tolist() == [[RayStatus.NO_RAY] * 4]
    # Moved aside, two corners remain.
    K = [[[400, 0, 90], [0, 400, 200], [0, 0, 1]]]
    aside = Cameras.from_matrices(K, 600, 400, [[-0.4, 0, 0, 0]])
    windows = crop_windows(
        aside, pose, map_of(500, 600), level(), crop=grown_crop(300.0), plane_height_m=0.0
    )
    assert (windows.rays == RayStatus.NO_RAY).tolist() == [[False, True, True, False]]
    assert windows.status.tolist() == [CropStatus.CROPPED]


def test_map_in_degrees() -> None:
    pose = Poses.from_centres(looking_down(0), [(X, Y, 100.0)])
    to_degrees = Transformer.from_crs(32615, 4326, always_xy=True)
    west, north = to_degrees.transform(X - 200, Y + 200)
    step = 5e-6
    dom = map_of(2000, 2000, Affine(step, 0, west, 0, -step, north), 4326)
    windows = crop_windows(
        camera(600, 600), pose, dom, level(), crop=plain_crop(300.0), plane_height_m=0.0
    )
    lon, lat = to_degrees.transform(
        [X - 50, X + 50, X + 50, X - 50], np.add(Y, [33.33333333] * 2 + [-33.33333333] * 2)
    )
    column, row = (np.array(lon) - west) / step, (north - np.array(lat)) / step
    x, y, width, height = windows.windows[0]
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
        expected = crop_windows(
            cameras, poses, dom, field, crop=grown_crop(250.0), plane_height_m=0.0
        )
        # Blocks and slots so small that they are used up again and again.
        patch.setattr(blocks, "_SIDE", 8)
        patch.setattr(blocks, "_SLOTS", 5)
        patch.setattr(blocks, "_SCAN_PIXELS", 600)
        patch.setattr(crops, "_CAMERAS", 5)
        windows = crop_windows(
            cameras, poses, dom, path, crop=grown_crop(250.0), plane_height_m=0.0
        )
        with blocked_heights(path) as lazy:
            xy = rng.uniform((X - 2, Y - 47), (X + 57, Y + 2), (300, 2))
            assert lazy.sample(xy).tobytes() == field.sample(xy).tobytes()
            assert lazy.height_range == field.height_range
    assert box(windows) == box(expected)
    assert windows.rays.tobytes() == expected.rays.tobytes()
    assert (windows.windows[:, 0] + windows.windows[:, 2] <= dom.width).all()
    assert ((windows.windows[:, 2] > 0) == (windows.status == CropStatus.CROPPED)).all()


def test_dsm_in_degrees_is_refused(tmp_path: Path) -> None:
    path = write_tif(
        tmp_path / "d.tif",
        np.zeros((4, 4), np.float32),
        crs="EPSG:4326",
        transform=Affine(1e-5, 0, 113, 0, -1e-5, 28),
    )
    pose = Poses.from_centres(looking_down(0), [(X, Y, 100.0)])
    with pytest.raises(RasterError, match="not in metres"):
        crop_windows(
            camera(600, 600), pose, map_of(9, 9), path, crop=grown_crop(100.0), plane_height_m=0.0
        )


def test_real_photos_find_their_place(brighton: Path) -> None:
    scene = json.loads((brighton / "poses.json").read_text())
    images = [scene["images"][name] for name in sorted(scene["images"])]
    poses = Poses.from_centres([i["R_w2c"] for i in images], [i["center_utm"] for i in images])
    K = np.tile(scene["K"], (len(images), 1, 1))
    lens = np.tile(scene["dist_k1k2p1p2"], (len(images), 1))
    cameras = Cameras.from_matrices(K, 4000, 2250, lens)
    dom = open_info(brighton / "dom_10cm.tif")
    windows = crop_windows(
        cameras, poses, dom, brighton / "dsm_10cm.tif", crop=grown_crop(60.0), plane_height_m=0.0
    )
    assert (windows.status == CropStatus.CROPPED).all()
    # Nearly nadir: the place below the camera is in the crop, where it is in the map.
    below = np.linalg.solve(
        np.array([[dom.transform.a, 0], [0, dom.transform.e]]),
        (poses.centres[:, :2] - pixel_to_world(dom.transform, (0.0, 0.0))).T,
    ).T
    on_map = ((below > 0) & (below < (dom.width, dom.height))).all(axis=1)
    low = windows.windows[:, :2]
    high = low + windows.windows[:, 2:]
    assert on_map.sum() >= 10
    assert ((below >= low) & (below <= high)).all(axis=1)[on_map].all()
