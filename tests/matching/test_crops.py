from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from pyproj import Transformer
from rasterio import Affine

from airzoo_bench.core.errors import RasterError
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import open_info, pixel_to_world
from airzoo_bench.geometry.rays import RayStatus
from airzoo_bench.matching.crops import (
    CropStatus,
    crop_windows,
)
from tests.geometry.support import looking_down, write_tif
from tests.matching.crop_support import (
    X,
    Y,
    box,
    camera,
    cut,
    grown_crop,
    level,
    map_of,
    plain_crop,
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
