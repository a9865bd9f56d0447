"""Footprints, worked by hand."""

from __future__ import annotations

import numpy as np
import pytest
from pyproj import Transformer
from rasterio.transform import Affine

from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.retrieval.positives import Footprints, cast_footprints

CRS = "EPSG:32650"
EAST, NORTH = 500_000.0, 3_000_000.0
NADIR = np.diag([1.0, -1.0, -1.0])  # x east, y south, z down
# 800 x 600 px, f = 400: the half angles' tangents are 1 and 0.75.
CAMERA = Cameras.from_matrices(np.array([[[400, 0, 400], [0, 400, 300], [0, 0, 1.0]]]), 800, 600)


def cast(
    rotation: np.ndarray, height: float = 150.0, ground: float | HeightField = 50.0, **how: float
) -> Footprints:
    poses = Poses.from_centres(rotation[None], np.array([[EAST, NORTH, height]]))
    return cast_footprints(CAMERA, poses, CRS, ground, inset=1 / 16, max_range_m=1000.0, **how)


def metres(lonlat: np.ndarray) -> np.ndarray:
    back = Transformer.from_crs("EPSG:4326", CRS, always_xy=True)
    return np.stack(back.transform(lonlat[..., 0], lonlat[..., 1]), axis=-1) - [EAST, NORTH]


def test_nadir() -> None:
    # Anchors at u = 50, 750 and v = 37.5, 562.5: tangents -+350/400 = 0.875, -+262.5/400 = 0.65625.
    # From 100 m above the plane they lie 87.5 m to the sides and 65.625 m up and down.
    found = cast(NADIR)
    corners = [[-87.5, 65.625], [87.5, 65.625], [87.5, -65.625], [-87.5, -65.625]]
    np.testing.assert_allclose(metres(found.lonlat[0]), corners, atol=2e-4)
    np.testing.assert_allclose(metres(found.centres), [[0, 0]], atol=2e-4)
    # The ground is at 50 m west of the camera and at 100 m east of it: half the distance, half the
    # offset (43.75 and 32.8125 m).
    heights = np.full((400, 400), 50.0)
    heights[:, 200:] = 100.0
    surface = HeightField(heights, Affine(1, 0, EAST - 200, 0, -1, NORTH + 200), CRS)
    corners[1:3] = [43.75, 32.8125], [43.75, -32.8125]
    np.testing.assert_allclose(metres(cast(NADIR, ground=surface).lonlat[0]), corners, atol=2e-4)


def test_a_camera_at_the_horizon_sees_ground_below_only() -> None:
    # Looking north: x east, y down, z north. The upper anchors look up; the lower ones have a
    # tangent of 0.65625 down, so from 100 m they meet the plane 100 / 0.65625 = 152.38 m north.
    found = cast(np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], float))
    north = 100 / 0.65625
    lower = [[north * 0.875, north], [-north * 0.875, north]]
    np.testing.assert_allclose(metres(found.lonlat[0, 2:]), lower, atol=3e-4)
    np.testing.assert_allclose(metres(found.centres[0]), [0, north], atol=3e-4)
    assert np.isnan(found.lonlat[0, :2]).all()
    assert found.missed_rays.tolist() == [2]


# Looks at the sky; is below the plane; is beyond the range.
@pytest.mark.parametrize(("rotation", "height"), [(np.eye(3), 150), (NADIR, 20), (NADIR, 5000)])
def test_no_ground_point_at_all(rotation: np.ndarray, height: float) -> None:
    found = cast(rotation, height)
    assert found.missed_rays.tolist() == [4]
    assert np.isnan(found.centres).all()


def test_points_stand_on_the_grid_that_boxes_stand_on() -> None:
    # Kept to 1e-9 degrees, as boxes are: a point on a tile's border is on it on every machine.
    tilted = NADIR @ np.array([[1, 0, 0], [0, 0.96, -0.28], [0, 0.28, 0.96]])
    plain = cast(tilted)
    for lon in (117.0, 477.0):  # as it is; a turn on
        moved = cast(tilted, about_lon=lon)
        for part, same in ((moved.lonlat, plain.lonlat), (moved.centres, plain.centres)):
            np.testing.assert_array_equal(part, np.round(part, 9))
            turns = (part - same)[..., 0] / 360
            np.testing.assert_allclose(turns, np.full_like(turns, lon // 400), atol=1e-11)
