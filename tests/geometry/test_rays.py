from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from rasterio import Affine

from airzoo_bench.geometry.cameras import Cameras, back_project
from airzoo_bench.geometry.heightfield import HeightField, blocked_heights
from airzoo_bench.geometry.poses import Poses, rays_to_world
from airzoo_bench.geometry.rasters import pixel_to_world
from airzoo_bench.geometry.rays import (
    NearestHeights,
    RayHits,
    RayStatus,
    intersect_heightfield,
    intersect_plane,
)

from .support import looking_down, quick, seeds, write_tif

NAN = np.nan
UTM = np.array((576661.0, 5188212.0))


def names(status: np.ndarray) -> list[str]:
    return [RayStatus(value).name for value in status.ravel()]


def test_tilted_camera_worked_by_hand() -> None:
    # 100 m above ground, looking north 45 degrees down; f = 100 px, image 200 x 200 px.
    K = [[[100, 0, 100], [0, 100, 100], [0, 0, 1]]]
    camera = Cameras.from_matrices(K, 200, 200)
    pose = Poses.from_centres(looking_down(45.0), [[0, 0, 100]])
    # The axis meets the ground 100 m north. The pixel 50 px below it looks atan(1/2) lower:
    # tan of its angle from the vertical is (1 - 1/2) / (1 + 1/2) = 1/3, 33.333 m north.
    # The pixel 50 px right of the axis has (x, y, z) = (0.5, 0, 1), z along (0, 1, -1) / sqrt 2:
    # 100 m down take 100 sqrt 2 of z, which is 70.711 m to the east, 100 m north.
    # The pixel 100 px above the axis looks 45 degrees up from it: to the horizon.
    pixels = np.array([[[100, 100], [100, 150], [150, 100], [100, 0]]], float)
    directions = rays_to_world(pose, back_project(camera, pixels))
    points, valid, status = intersect_plane(pose.centres, directions, 0.0, 1e4)
    expected = [(0, 100, 0), (0, 100 / 3, 0), (50 * np.sqrt(2), 100, 0)]
    np.testing.assert_allclose(points[0, :3], expected, rtol=0, atol=1e-10)
    assert valid.tolist() == [[True, True, True, False]]
    # The horizon by rounding is a hair up or down: no ground point either way.
    assert names(status)[:3] == ["HIT"] * 3
    assert names(status)[3] in ("NOT_DOWNWARD", "BEYOND_RANGE")
    assert np.isnan(points[0, 3]).all()


def test_reasons_on_the_plane() -> None:
    down, level, up, away = (0, 0, -2), (1, 0, 0), (0, 1, 1), (3, 0, -4)
    directions = np.tile(
        np.array([(down, level, up, away, (NAN, 0, -1), (0, 0, 0))], float), (3, 1, 1)
    )
    origins = np.array([(0, 0, 40), (0, 0, 10), (0, 0, 7)], float)
    # Plane at 10: 30 m below the first; the slanted ray 5/4 * 30 = 37.5 m, right at the range.
    hits = intersect_plane(origins, directions, 10.0, 37.5)
    common = ["NOT_DOWNWARD", "NOT_DOWNWARD"]
    assert names(hits.status[0]) == ["HIT", *common, "HIT", "NO_RAY", "NO_RAY"]
    for below in (1, 2):
        assert names(hits.status[below]) == ["BEHIND", *common, "BEHIND", "NO_RAY", "NO_RAY"]
    assert hits.points[0, 3].tolist() == [22.5, 0, 10]
    assert np.isnan(hits.points[~hits.valid]).all()
    shorter = intersect_plane(origins, directions, (10.0, 9.0, 0.0), 37.49)
    assert names(shorter.status[:, 3]) == ["BEYOND_RANGE", "HIT", "HIT"]
    assert shorter.points[:, 0, 2].tolist() == [10, 9, 0]


def field_of(heights: object, pixel: float = 1.0) -> HeightField:
    """Heights with the first pixel in the south west: x grows with columns, y with rows."""
    return HeightField(np.array(heights, float), Affine(pixel, 0, 0, 0, pixel, 0), "EPSG:32615")


def cast(origin: object, direction: object, field: HeightField, max_range: float = 1e4) -> RayHits:
    shape = np.reshape(np.array(direction, float), (1, -1, 3))
    return intersect_heightfield(np.array([origin], float), shape, field, max_range)


@quick
@given(seeds)
def test_on_a_level_or_sloping_dsm_the_hit_is_that_of_the_plane(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = rng.uniform(0, 2 * np.pi)
    a, b = 0.5 * np.cos(turn), 0.5 * np.sin(turn)
    transform = Affine(a, b, *UTM[:1], b, -a, UTM[1])
    slope = rng.uniform(-0.1, 0.1, 2)
    row, column = np.indices((400, 400))
    # The plane z = slope . (pixel - 0.5) at continuous pixels, exact under bilinear sampling.
    field = HeightField((column - 200) * slope[0] + (row - 200) * slope[1], transform, "EPSG:32615")
    foot = pixel_to_world(transform, rng.uniform(180, 220, (4, 2)))
    origins = np.column_stack((foot, rng.uniform(30, 60, 4)))
    directions = rng.uniform((-0.15, -0.15, -1), (0.15, 0.15, -0.8), (4, 25, 3))
    hits = intersect_heightfield(origins, directions, field, 1e4)
    assert hits.valid.all()
    tilted = field.sample(hits.points[..., :2])
    np.testing.assert_allclose(hits.points[..., 2], tilted, rtol=0, atol=1e-7)
    cross = np.cross(hits.points - origins[:, None], directions)
    np.testing.assert_allclose(cross, 0.0, atol=1e-6)

    level = HeightField(np.full((400, 400), -3.25), transform, "EPSG:32615")
    hits = intersect_heightfield(origins, directions, level, 1e4)
    plane = intersect_plane(origins, directions, -3.25, 1e4)
    np.testing.assert_allclose(hits.points, plane.points, rtol=0, atol=1e-7)
    assert np.array_equal(hits.status, plane.status)


def test_a_saddle_that_falls_before_it_rises_into_the_ray() -> None:
    # Along the diagonal of the cell the surface is -2 u + 4 u^2, so the ray, from 1 to 0.5, is
    # 1 + 1.5 u - 4 u^2 above it: nothing at u = (1.5 + sqrt(18.25)) / 8.
    u = (1.5 + np.sqrt(18.25)) / 8
    hits = cast((0.5, 0.5, 1.0), (1.0, 1.0, -0.5), field_of([[0.0, -1.0], [-1.0, 2.0]]))
    assert hits.points[0, 0] == pytest.approx((0.5 + u, 0.5 + u, 1.0 - 0.5 * u), abs=1e-12)


@settings(quick, max_examples=8)
@given(seeds)
def test_first_crossing_agrees_with_a_fine_march(seed: int) -> None:
    rng = np.random.default_rng(seed)
    heights = rng.uniform(0, 6, rng.integers(4, 12, 2))
    heights[rng.random(heights.shape) < rng.choice([0.0, 0.3, 0.7])] = NAN
    field = field_of(heights, pixel=0.7)
    size = 0.7 * np.array(heights.shape[::-1])
    origins = np.column_stack((rng.uniform(0, 1, (9, 2)) * size, rng.uniform(6.1, 12, 9)))
    directions = rng.normal(size=(9, 3, 3)) * (1, 1, 0.6)
    directions[..., 2] = -np.abs(directions[..., 2])
    hits = intersect_heightfield(origins, directions, field, 1e3)

    unit = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    length = np.arange(0.0, 25.0, 2e-3)
    for camera, ray in np.ndindex(9, 3):
        path = origins[camera] + length[:, None] * unit[camera, ray]
        gap = path[:, 2] - field.sample(path[:, :2])
        below = np.flatnonzero((gap <= 0) & (path[:, 2] > np.nanmin(heights)))
        if hits.valid[camera, ray]:
            found = np.linalg.norm(hits.points[camera, ray] - origins[camera])
            # Never later than the fine march, and above the surface all the way there.
            assert not below.size or found <= length[below[0]] + 1e-9
            assert not (gap[length < found - 1e-9] < -1e-9).any()
            # Earlier than the march only by less than its step, but for a corner it cut.
            around = hits.points[camera, ray] + np.outer(np.linspace(0, 1e-6, 9), unit[camera, ray])
            assert np.nanmin(around[:, 2] - field.sample(around[:, :2])) <= 1e-9
        else:
            assert not below.size


FLAT = field_of(np.full((20, 30), 5.0))
STEP = field_of(np.where(np.arange(30) < 20, np.full((20, 30), 5.0), 0.0))
DOWN = (0, 0, -1)
REASONS = [
    ((15, 10, 50), DOWN, FLAT, 1e4, "HIT"),
    ((15, 10, 50), (1, 0, 0), FLAT, 1e4, "NOT_DOWNWARD"),
    ((15, 10, 50), (NAN, 0, 0), FLAT, 1e4, "NO_RAY"),
    # On the surface, under it, and outside the raster below all of it.
    *(((x, 10, z), DOWN, FLAT, 1e4, "BEHIND") for x, z in ((15, 5), (15, 4), (-50, 4))),
    # 45 m down to the surface: just in range, and just not.
    ((15, 10, 50), DOWN, FLAT, 45.0, "HIT"),
    ((15, 10, 50), DOWN, FLAT, 44.9, "BEYOND_RANGE"),
    # Beside the raster; past it at 45 m height; stopped by the range before it is past.
    ((-1, 10, 50), DOWN, FLAT, 1e4, "OFF_RASTER"),
    ((15, 10, 50), (1, 0, -0.1), FLAT, 1e4, "OFF_RASTER"),
    ((15, 10, 50), (1, 0, -0.1), FLAT, 5.0, "BEYOND_RANGE"),
    # From outside, over the border below the surface: under ground before. The border is 14.1 m
    # along the ray, the lowest height 17.0 m: the range is not what ends it.
    ((-10, 10, 12), (1, 0, -1), STEP, 1e4, "OFF_RASTER"),
    ((-10, 10, 12), (1, 0, -1), STEP, 16.0, "OFF_RASTER"),
    ((-10, 10, 12), (1, 0, -1), STEP, 14.0, "BEYOND_RANGE"),
    # A ray that passes by the raster is off it, however short the range.
    ((-100, 10, 500), (1, 1, -1), FLAT, 5.0, "OFF_RASTER"),
]


@pytest.mark.parametrize(("origin", "direction", "field", "far", "reason"), REASONS)
def test_reasons_on_the_dsm(
    origin: object, direction: object, field: HeightField, far: float, reason: str
) -> None:
    assert names(cast(origin, direction, field, far).status) == [reason]


def test_over_the_border_of_the_dsm() -> None:
    # The last half pixel is level: the border itself is still on the raster.
    cases = ((-10, 10, 20), (1, 0, -1), (5, 10, 5)), ((29.9, 10, 50), DOWN, (29.9, 10, 5))
    for origin, direction, point in cases:
        np.testing.assert_allclose(cast(origin, direction, FLAT).points[0, 0], point, atol=1e-12)


def test_gaps_in_the_dsm() -> None:
    # Ground 0 up to pixel 9, none from 10 to 19, ground 3 from pixel 20 on.
    heights = np.zeros((20, 40))
    heights[:, 10:20] = NAN
    heights[:, 20:] = 3.0
    field = field_of(heights)
    # Through the gap to the far ground: z = 20 - (x - 5) = 3 at x = 22.
    clear = cast((5, 10.2, 20), (1, 0, -1), field)
    np.testing.assert_allclose(clear.points[0, 0], (22, 10.2, 3), atol=1e-12)
    # z = 15 - (x - 5) is 3 at x = 17, in the gap. The far ground reaches a pixel out of its
    # first centre, to x = 20.5 - 1 (a pixel away to the side less: sqrt(1 - 0.3^2) for y 10.2,
    # 0.3 px off the row's centre; the row below is farther).
    sunk = cast((5, 10.2, 15), (1, 0, -1), field)
    x = 20.5 - np.sqrt(1 - 0.3**2)
    np.testing.assert_allclose(sunk.points[0, 0], (x, 10.2, 20 - x), atol=1e-12)
    assert np.isnan(field.sample((x - 1e-9, 10.2)))
    assert field.sample((x + 1e-9, 10.2)) == 3.0
    # Straight down into the gap, and a raster without any height.
    empty = field_of(np.full((20, 20), NAN))
    for surface in (field, empty):
        assert names(cast((15, 10, 20), DOWN, surface).status) == ["OFF_RASTER"]


@pytest.mark.parametrize("most_px", [10_000, 500, 7])
def test_the_nearest_height_by_brute_force(most_px: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    heights = rng.normal(size=(40, 50)).astype(np.float32)
    heights[rng.random(heights.shape) < 0.7] = NAN
    path = write_tif(tmp_path / "dsm.tif", heights)
    step = next(k for k in range(1, 60) if -(-40 // k) * -(-50 // k) <= most_px)
    rows, columns = np.mgrid[min(step // 2, 39) : 40 : step, min(step // 2, 49) : 50 : step]
    known = ~np.isnan(heights[rows, columns])
    rows, columns = rows[known], columns[known]
    pixels = rng.uniform(-30, 80, (200, 2))
    # Corners of four pixels, equally near to all: the first in row-major order counts.
    pixels[:50] = rng.integers(1, 39, (50, 2))
    away = (pixels[:, :1] - columns - 0.5) ** 2 + (pixels[:, 1:] - rows - 0.5) ** 2
    first = np.argmin(away, axis=1)
    wanted = heights[rows[first], columns[first]] if len(rows) else np.full(200, NAN)
    field = HeightField.read(path)
    xy = pixel_to_world(field.transform, pixels)
    with blocked_heights(path) as lazy:
        for one in (field, lazy):
            np.testing.assert_array_equal(NearestHeights(one, most_px)(xy), wanted)
    assert np.isnan(NearestHeights(field, most_px)(np.array([[NAN, 0.0]]))).all()
