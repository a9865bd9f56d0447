from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from rasterio import Affine

from airzoo_bench.core.errors import RasterError
from airzoo_bench.geometry import rays
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.march import first_in_cell
from airzoo_bench.geometry.rasters import pixel_to_world
from airzoo_bench.geometry.rays import RayStatus, intersect_heightfield, intersect_plane

from .support import quick, seeds

NAN = np.nan
UTM = np.array((576661.0, 5188212.0))


def names(status: np.ndarray) -> list[str]:
    return [RayStatus(value).name for value in status.ravel()]


def field_of(heights: object, pixel: float = 1.0, crs: object = "EPSG:32615") -> HeightField:
    """Heights with the first pixel in the south west: x grows with columns, y with rows."""
    return HeightField(np.array(heights, float), Affine(pixel, 0, 0, 0, pixel, 0), crs)


def cast(origin: object, direction: object, field: HeightField, max_range: float = 1e4):
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


@quick
@given(seeds)
def test_first_crossing_agrees_with_a_fine_march(seed: int) -> None:
    rng = np.random.default_rng(seed)
    heights = rng.uniform(0, 6, rng.integers(4, 12, 2))
    heights[rng.random(heights.shape) < rng.choice([0.0, 0.3, 0.7])] = NAN
    field = field_of(heights, pixel=0.7)
    size = 0.7 * np.array(heights.shape[::-1])
    origins = np.column_stack((rng.uniform(0, 1, (20, 2)) * size, rng.uniform(6.1, 12, 20)))
    directions = rng.normal(size=(20, 3, 3)) * (1, 1, 0.6)
    directions[..., 2] = -np.abs(directions[..., 2])
    hits = intersect_heightfield(origins, directions, field, 1e3)

    unit = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    length = np.arange(0.0, 25.0, 2e-3)
    for camera, ray in np.ndindex(20, 3):
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


def test_a_wall_seen_obliquely() -> None:
    # Ground 0, a wall of 10 m one pixel wide at x = 20.5 (pixel 20); pixels of 1 m. Its face
    # rises linearly from x = 19.5 to 20.5. A ray along x from (0.5, z 30) that falls 30 m in
    # 30 m: z = 30.5 - x. On the face h = 10 (x - 19.5): 30.5 - x = 10 x - 195, x = 20.5.
    heights = np.zeros((40, 60))
    heights[:, 20] = 10.0
    field = field_of(heights)
    hit = cast((0.5, 20.2, 30.0), (1, 0, -1), field)
    np.testing.assert_allclose(hit.points[0, 0], (20.5, 20.2, 10.0), rtol=0, atol=1e-12)
    # From 0.5 m lower: z = 30 - x = 10 x - 195, x = 225 / 11.
    hit = cast((0.5, 20.2, 29.5), (1, 0, -1), field)
    np.testing.assert_allclose(hit.points[0, 0, ::2], (225 / 11, 105 / 11), rtol=0, atol=1e-12)
    # Seen obliquely in plan as well, along (1, 1): the same fall a metre of x, the same x.
    hit = cast((0.5, 5.2, 29.5), (1, 1, -1), field)
    x = 225 / 11
    np.testing.assert_allclose(hit.points[0, 0], (x, x + 4.7, 30 - x), rtol=0, atol=1e-12)
    # A ray that grazes the crest 1 mm below: 2 mm of path in the wall, and it must be met.
    # z = 10.0215 - 0.001 x: at x = 20.5 it is 10.001, above; 2 mm lower it is 9.999, below.
    over = cast((0.5, 20.2, 10.021), (1, 0, -0.001), field)
    assert names(over.status) == ["OFF_RASTER"]
    into = cast((0.5, 20.2, 10.019), (1, 0, -0.001), field)
    assert names(into.status) == ["HIT"]
    assert into.points[0, 0, 0] == pytest.approx(20.5, abs=2e-4)


def test_the_edge_between_level_and_bilinear_ground() -> None:
    # Row 0 is at 0 m, row 1 at 10 m; the first two columns are missing. At y = 0.9 the cell of the
    # gap takes row 0's height, 0 m; from x = 2.5 on it is bilinear: 0.4 of the way up, 4 m. A ray
    # at 3 m meets the step.
    heights = np.array([[NAN, NAN, 0, 0, 0, 0], [NAN, NAN, 10, 10, 10, 10]])
    hit = cast((1.6, 0.9, 3.0), (1, 0, -1e-6), field_of(heights))
    np.testing.assert_allclose(hit.points[0, 0], (2.5, 0.9, 3.0), rtol=0, atol=1e-5)


def test_the_border_strip_beside_a_gap() -> None:
    # (1.95, 1.4) is level with the centre (1.5, 1.4), 0.9 px from the height at (1.5, 0.5).
    field = field_of([[5, 5], [NAN, NAN]])
    hit = cast((1.95, 1.4, 9), (0, 0, -1), field)
    assert hit.points[0, 0].tolist() == [1.95, 1.4, 5.0]
    assert field.sample((1.95, 1.4)) == 5.0


def test_no_crossing_is_lost_to_rounding_at_the_edge_of_a_cell() -> None:
    rng = np.random.default_rng(0)
    heights = rng.uniform(0, 10, (200_000, 4))
    start, end = rng.uniform(0, 1, (2, 200_000, 2))
    a, b = end.T
    weights = np.stack(((1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b), axis=-1)
    z = rng.uniform(10, 30, 200_000)
    # Each ray leaves its cell on the surface, give or take the last digit.
    drop = (weights * heights).sum(axis=-1) - z
    share = first_in_cell(heights, start, end - start, z, drop)
    # All but the odd ray along a tangent, where a digit of the height is half the digits of u.
    assert np.isfinite(share).mean() > 0.999
    assert (share[np.isfinite(share)] <= 1.0).all()


def test_a_peak_between_two_steps_is_met() -> None:
    # One pixel of 10 m at (20, 20), its centre (20.5, 20.5). In the cell to its lower left
    # h = 10 a b with a, b from (19.5, 19.5). A level-ish ray cuts that cell's corner of the
    # peak along the diagonal a + b = 1.9: its top there is 10 * 0.95^2 = 9.025 m.
    heights = np.zeros((40, 40))
    heights[20, 20] = 10.0
    field = field_of(heights)
    start = np.array((19.5 + 1.9 - 0.95 + 10.0, 19.5 + 0.95 - 10.0))
    for z, expected in ((9.0251, "OFF_RASTER"), (9.0249, "HIT")):
        hit = cast((*start, z + 1e-6 * 10 * np.sqrt(2)), (-1, 1, -1e-6 * np.sqrt(2)), field)
        assert names(hit.status) == [expected]


def test_reasons_on_the_dsm() -> None:
    field = field_of(np.full((20, 30), 5.0))
    down = (0, 0, -1)
    assert names(cast((15, 10, 50), down, field).status) == ["HIT"]
    assert names(cast((15, 10, 50), (1, 0, 0), field).status) == ["NOT_DOWNWARD"]
    assert names(cast((15, 10, 50), (NAN, 0, 0), field).status) == ["NO_RAY"]
    # On the surface, under it, and outside the raster below all of it.
    for origin in ((15, 10, 5), (15, 10, 4), (-50, 10, 4)):
        assert names(cast(origin, down, field).status) == ["BEHIND"]
    # 45 m down to the surface: just in range, and just not.
    assert names(cast((15, 10, 50), down, field, 45.0).status) == ["HIT"]
    assert names(cast((15, 10, 50), down, field, 44.9).status) == ["BEYOND_RANGE"]
    # Beside the raster; past it at 45 m height; stopped by the range before it is past.
    assert names(cast((-1, 10, 50), down, field).status) == ["OFF_RASTER"]
    assert names(cast((15, 10, 50), (1, 0, -0.1), field).status) == ["OFF_RASTER"]
    assert names(cast((15, 10, 50), (1, 0, -0.1), field, 5.0).status) == ["BEYOND_RANGE"]
    # From outside: over the border above the surface, and below it (under ground before).
    inward = cast((-10, 10, 20), (1, 0, -1), field)
    np.testing.assert_allclose(inward.points[0, 0], (5, 10, 5), atol=1e-12)
    heights = np.full((20, 30), 5.0)
    heights[:, 20:] = 0.0
    assert names(cast((-10, 10, 12), (1, 0, -1), field_of(heights)).status) == ["OFF_RASTER"]
    # The border is 14.1 m along the ray, the lowest height 17.0 m: the range is not what ends it.
    assert names(cast((-10, 10, 12), (1, 0, -1), field_of(heights), 16.0).status) == ["OFF_RASTER"]
    assert names(cast((-10, 10, 12), (1, 0, -1), field_of(heights), 14.0).status) == [
        "BEYOND_RANGE"
    ]
    # A ray that passes by the raster is off it, however short the range.
    assert names(cast((-100, 10, 500), (1, 1, -1), field, 5.0).status) == ["OFF_RASTER"]
    # The last half pixel is level: the border itself is still on the raster.
    edge = cast((29.9, 10, 50), down, field)
    np.testing.assert_allclose(edge.points[0, 0], (29.9, 10, 5), atol=1e-12)


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
    assert names(cast((15, 10, 20), (0, 0, -1), field).status) == ["OFF_RASTER"]
    empty = field_of(np.full((4, 4), NAN))
    assert names(cast((2, 2, 20), (0, 0, -1), empty).status) == ["OFF_RASTER"]


def test_hits_do_not_depend_on_the_block(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(5)
    heights = np.where(rng.random((40, 40)) < 0.2, NAN, rng.uniform(0, 5, (40, 40)))
    origins = np.column_stack((rng.uniform(0, 40, (6, 2)), np.full(6, 20.0)))
    directions = rng.normal(size=(6, 9, 3)) - (0, 0, 1)
    whole = intersect_heightfield(origins, directions, field_of(heights), 1e3)
    monkeypatch.setattr(rays, "_BLOCK", 5)
    parts = intersect_heightfield(origins, directions, field_of(heights), 1e3)
    assert parts.points.tobytes() == whole.points.tobytes()
    assert parts.status.tobytes() == whole.status.tobytes()


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:2263"])
def test_a_dsm_in_degrees_or_feet_is_refused(crs: str) -> None:
    with pytest.raises(RasterError, match="not in metres"):
        cast((2, 2, 20), (0, 0, -1), field_of(np.zeros((4, 4)), crs=crs))
