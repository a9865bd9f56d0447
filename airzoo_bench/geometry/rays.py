"""Rays met with the ground: a horizontal plane, or the surface of a DSM.

World coordinates are metres with z up. Distances are measured along the ray from the camera centre.

Over a height field rays go from cell to cell, all at once (Amanatides and Woo, 1987). Cells are
those of the grid of pixel centres: between four neighbours, and half of one along the border. In
each cell a ray is met with the surface in closed form, so that no wall is stepped over, and the
point is exact to rounding. A cell has four corners, in the order of `heightfield.CORNERS`;
positions in it run from (0, 0) to (1, 1). There the ray runs from `start` to `start + way` while u
goes from 0 to 1, at height z + u drop.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.heightfield import CORNERS, HeightField
from airzoo_bench.geometry.rasters import pixel_to_world, steps_to_pixels, world_to_pixel

_BLOCK = 1 << 16
# The march begins this far above the highest height and ends this far below the lowest, so that
# rounding does not leave out the height itself (a level DSM has only one).
_MARGIN_M = 1e-3
# A root at the edge of a cell may be rounded out of it, and the next cell may have no height.
_ROUNDING = 1e-12
# Rounding of a hit on the surface; one further below it has gone through a hole.
_SUNK_M = 1e-3
_TIE_M = 1e-6


class RayStatus(IntEnum):
    """Outcomes of a ray, by their names in reports.

    NO_RAY: the ray or its origin is not finite, since its pixel lies beyond the range of the lens
    model.
    """

    HIT = 0
    NOT_DOWNWARD = 1
    BEHIND = 2
    BEYOND_RANGE = 3
    OFF_RASTER = 4
    NO_RAY = 5


class RayHits(NamedTuple):
    """Points (N, M, 3) where rays meet the ground, NaN without; whether they do; a RayStatus."""

    points: Floats
    valid: Bools
    status: NDArray[np.uint8]


def intersect_plane(
    origins: Floats, directions: Floats, z0: ArrayLike, max_range_m: float
) -> RayHits:
    """Meet rays from origins (N, 3), in directions (N, M, 3), with planes z = z0, scalar or (N,).

    NOT_DOWNWARD: the ray is level or goes up. BEHIND: it goes down from a centre on the plane or
    below. BEYOND_RANGE: it is longer than `max_range_m`; the range itself is still a hit.
    """
    plane = np.asarray(z0, dtype=np.float64).reshape(-1, 1)
    unit, status = _prepare_rays(origins, directions)
    above = origins[:, 2:] - plane
    going = status == RayStatus.HIT
    with np.errstate(over="ignore"):
        length = above / np.where(going, -unit[..., 2], np.nan)
    status[going & (above <= 0.0)] = RayStatus.BEHIND
    status[np.equal(status, RayStatus.HIT) & ~(length <= max_range_m)] = RayStatus.BEYOND_RANGE
    hits = _hits(origins, unit, length, status)
    # The plane's own height, not what rounding leaves of it.
    hits.points[..., 2] = np.where(hits.valid, plane, np.nan)
    return hits


def intersect_heightfield(
    origins: Floats, directions: Floats, field: HeightField, max_range_m: float
) -> RayHits:
    """Meet rays with the surface of a DSM in a projected CRS: the first crossing from above.

    Where the DSM has no height the march goes on. When the ray has sunk into the ground across such
    a gap, the crossing is the first place beyond it where the surface is above the ray; the point
    is the ray's there, hence below the surface.

    NOT_DOWNWARD: the ray is level or goes up. BEHIND: the centre is on the surface or below, or
    below all of it. BEYOND_RANGE: `max_range_m` is reached above the surface. OFF_RASTER: the
    ray leaves the raster above the surface, enters it below, never meets it, or sinks below the
    lowest height where the DSM has none.
    """
    unit, status = _prepare_rays(origins, directions)
    length = np.full(status.shape, np.nan)
    low, _ = field.height_range
    on_raster = field.sample(origins[:, :2])
    below = (origins[:, 2] <= low) | (origins[:, 2] <= on_raster)
    status[(status == RayStatus.HIT) & below[:, None]] = RayStatus.BEHIND
    cameras, rays = np.nonzero(status == RayStatus.HIT)
    for start in range(0, len(cameras), _BLOCK):  # to bound memory
        camera, ray = cameras[start : start + _BLOCK], rays[start : start + _BLOCK]
        found, cut = _first_crossings(origins[camera], unit[camera, ray], field, max_range_m)
        length[camera, ray] = found
        missed = np.where(cut, RayStatus.BEYOND_RANGE, RayStatus.OFF_RASTER)
        status[camera, ray] = np.where(np.isnan(found), missed, RayStatus.HIT)
    return _hits(origins, unit, length, status)


def _prepare_rays(origins: Floats, directions: Floats) -> tuple[Floats, NDArray[np.uint8]]:
    """Return unit directions, and a status: NO_RAY, NOT_DOWNWARD, or HIT for those to go on."""
    x, y, z = np.moveaxis(directions, -1, 0)
    norm = np.sqrt(x * x + y * y + z * z)
    usable = np.isfinite(norm) & (norm > 0.0) & np.isfinite(origins).all(axis=-1, keepdims=True)
    unit = directions / np.where(usable, norm, np.nan)[..., None]
    downward = np.where(unit[..., 2] < 0.0, RayStatus.HIT, RayStatus.NOT_DOWNWARD)
    return unit, np.where(usable, downward, RayStatus.NO_RAY).astype(np.uint8)


def _hits(origins: Floats, unit: Floats, length: Floats, status: NDArray[np.uint8]) -> RayHits:
    valid = status == RayStatus.HIT
    points = origins[:, None] + np.where(valid, length, np.nan)[..., None] * unit
    return RayHits(points, valid, status)


@dataclass(frozen=True, eq=False)
class _Walk:
    """Rays under way: at length s from its origin a ray is at grid + s step, height z + s sink."""

    row: Ints
    grid: Floats
    step: Floats
    z: Floats
    sink: Floats
    length: Floats
    end: Floats
    cell: Ints

    def keep(self, mask: Bools) -> _Walk:
        return _Walk(*(values[mask] for values in vars(self).values()))

    def at(self, length: Floats) -> Floats:
        moved: Floats = self.grid + length[:, None] * self.step
        return moved


def _first_crossings(
    origins: Floats, unit: Floats, field: HeightField, max_range_m: float
) -> tuple[Floats, Bools]:
    """Return lengths along rays to their first crossings of the surface; whether the range cut."""
    found = np.full(len(origins), np.nan)
    walk, cut = _start_walks(origins, unit, field, max_range_m)
    while walk.row.size:
        # The lengths at which rays meet the next column and row of pixel centres.
        line = walk.cell + (walk.step > 0.0)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            border = (line - walk.grid) / walk.step
        border = np.where(walk.step == 0.0, np.inf, border)
        until = np.maximum(np.minimum(border.min(axis=-1), walk.end), walk.length)
        share = _meet(walk, until, field)
        hit = ~np.isnan(share)
        found[walk.row[hit]] = (walk.length + share * (until - walk.length))[hit]
        turn = np.where(border <= until[:, None], np.sign(walk.step), 0).astype(np.int64)
        cell = walk.cell + turn
        moved = _Walk(walk.row, walk.grid, walk.step, walk.z, walk.sink, until, walk.end, cell)
        walk = moved.keep(~hit & (until < walk.end))
    return found, cut


def _start_walks(
    origins: Floats, unit: Floats, field: HeightField, max_range_m: float
) -> tuple[_Walk, Bools]:
    """Put the rays where they come over the raster and below its highest height."""
    low, high = field.height_range
    size = np.array(field.heights.shape[::-1])
    z, sink = origins[:, 2], unit[:, 2]
    pixel = world_to_pixel(field.transform, origins[:, :2])
    step = steps_to_pixels(field.transform, *unit.T[:2])
    enter, leave = _over_raster(pixel, step, size)
    with np.errstate(over="ignore"):
        begin = np.maximum(enter, (high + _MARGIN_M - z) / sink)
        last = np.minimum(leave, (low - _MARGIN_M - z) / sink)
    end = np.minimum(last, max_range_m)
    # Rays that come over the raster's border already below its surface.
    there = np.where(np.isfinite(enter), enter, 0.0)
    height = field.sample_pixels(np.clip(pixel + there[:, None] * step, 0.0, size))
    below = (there > 0.0) & (z + there * sink <= height)
    going = (begin <= end) & ~below
    cut = (max_range_m < last) & (enter <= leave) & ~(below & (enter <= max_range_m))
    row = np.flatnonzero(going)
    grid = pixel[going] - 0.5
    here = grid + begin[going, None] * step[going]
    cell = np.clip(np.floor(here), -1, size - 1).astype(np.int64)
    walk = _Walk(row, grid, step[going], z[going], sink[going], begin[going], end[going], cell)
    return walk, cut


def _over_raster(pixel: Floats, step: Floats, size: Ints) -> tuple[Floats, Floats]:
    """Return lengths at which rays enter and leave the raster; enter > leave where they miss."""
    still = step == 0.0
    inside = (pixel >= 0.0) & (pixel <= size)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        one, other = -pixel / step, (size - pixel) / step
    near = np.where(still, np.where(inside, -np.inf, np.inf), np.minimum(one, other))
    far = np.where(still, np.where(inside, np.inf, -np.inf), np.maximum(one, other))
    return np.maximum(near.max(axis=-1), 0.0), far.min(axis=-1)


def _meet(walk: _Walk, until: Floats, field: HeightField) -> Floats:
    """Return the share of its way through the cell at which each ray meets the surface, or NaN."""
    last = np.array(field.heights.shape[::-1]) - 1.0
    # Along the border the surface is level: the point is moved to the outermost pixel centres.
    start = np.clip(walk.at(walk.length), 0.0, last) - walk.cell
    way = np.clip(walk.at(until), 0.0, last) - walk.cell - start
    heights = field.corner_heights(walk.cell)
    z, drop = walk.z + walk.length * walk.sink, (until - walk.length) * walk.sink
    known = ~np.isnan(heights)
    whole, first = known.all(axis=-1), np.full(len(heights), np.nan)
    part = known.any(axis=-1) & ~whole
    for pick, meet in ((whole, _first_on_bilinear), (part, _first_on_nearest)):
        if pick.any():
            first[pick] = meet(heights[pick], start[pick], way[pick], z[pick], drop[pick])
    return first


def _first_on_bilinear(
    heights: Floats, start: Floats, way: Floats, z: Floats, drop: Floats
) -> Floats:
    """Return the smallest u in [0, 1] at which the ray is on the surface or below; NaN without.

    It is the first root from above of c0 + c1 u + c2 u^2, the ray minus the surface.
    """
    h00, h10, h01, h11 = heights.T
    (a, b), (da, db) = start.T, way.T
    slope_a, slope_b, twist = h10 - h00, h01 - h00, (h11 - h01) - (h10 - h00)
    c0 = z - (h00 + a * slope_a + b * slope_b + a * b * twist)
    c1 = drop - (da * slope_a + db * slope_b + (a * db + b * da) * twist)
    c2 = -da * db * twist
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(c1 * c1 - 4.0 * c2 * c0)
        # The same root twice, each form without cancellation on its side.
        u = np.where(c1 <= 0.0, 2.0 * c0 / (root - c1), (c1 + root) / (-2.0 * c2))
    u = np.where((u >= 0.0) & (u <= 1.0 + _ROUNDING), np.minimum(u, 1.0), np.nan)
    return np.where(c0 <= 0.0, 0.0, u)


def _first_on_nearest(
    heights: Floats, start: Floats, way: Floats, z: Floats, drop: Floats
) -> Floats:
    """Return the first u at which the ray is below the nearest corner, within a pixel of it."""
    known = ~np.isnan(heights)
    first = np.full(len(heights), np.inf)
    for index, corner in enumerate(CORNERS):
        low, high = _in_disc(start - corner, way)
        low, high = _clip(low, high, drop, heights[:, index] - z)
        for other in range(4):
            apart = CORNERS[other] - corner
            # |p - corner|^2 <= |p - other|^2, written as a bound on p.
            slope = 2.0 * (way * apart).sum(axis=-1)
            bound = (apart * apart).sum() - 2.0 * ((start - corner) * apart).sum(axis=-1)
            matters = known[:, other]
            low, high = _clip(low, high, np.where(matters, slope, 0.0), np.where(matters, bound, 0))
        first = np.where(known[:, index] & (low <= high), np.minimum(first, low), first)
    return np.where(np.isfinite(first), first, np.nan)


def _in_disc(start: Floats, way: Floats) -> tuple[Floats, Floats]:
    """Return the interval of u in [0, 1] where |start + u way| <= 1; low > high without."""
    quadratic = (way * way).sum(axis=-1)
    half = (start * way).sum(axis=-1)
    constant = (start * start).sum(axis=-1) - 1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(half * half - quadratic * constant)
        low, high = (-half - root) / quadratic, (-half + root) / quadratic
    still = quadratic == 0.0
    inside: Bools = constant <= 0.0
    low = np.where(still, np.where(inside, 0.0, np.inf), low)
    high = np.where(still, np.where(inside, 1.0, -np.inf), high)
    return np.fmax(low, np.where(np.isnan(low), np.inf, 0.0)), np.fmin(high, 1.0)


def _clip(low: Floats, high: Floats, slope: Floats, bound: Floats) -> tuple[Floats, Floats]:
    """Narrow the interval to where slope u <= bound; NaN bounds leave nothing."""
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = bound / slope
    high = np.where(slope > 0.0, np.minimum(high, turn), high)
    low = np.where(slope < 0.0, np.maximum(low, turn), low)
    empty = (slope == 0.0) & ~(bound >= 0.0)
    return np.where(empty, np.inf, low), high


class NearestHeights:
    """Finds the height of the valid pixel nearest to places (..., 2).

    It looks at every k-th pixel of every k-th row, beginning with k // 2, where k is the least
    whole number that leaves at most `most_px`. Of those that are equally near, to a micrometre, the
    first in row-major order counts. NaN where no such pixel has a height.
    """

    def __init__(self, field: HeightField, most_px: int) -> None:
        self.field, self.most_px = field, most_px

    def __call__(self, places: Floats) -> Floats:
        """Return the heights (...)."""
        tree, origin, heights = self._pixels
        known = np.isfinite(places).all(axis=-1)
        found = np.full(places.shape[:-1], np.nan)
        if heights.size and known.any():
            near, _ = tree.query(places[known] - origin)
            # The second radius is for places beyond 1e8 m, where a micrometre is rounded away.
            reach = np.maximum(near + _TIE_M, near * (1.0 + 1e-14))
            tied = tree.query_ball_point(places[known] - origin, reach)
            found[known] = heights[[min(rows) for rows in tied]]
        return found

    @cached_property
    def _pixels(self) -> tuple[Any, Floats, Floats]:
        # Made when the first ray asks: of a model without holes none does.
        (rows, columns), step = self.field.heights.shape, 1
        while -(-rows // step) * -(-columns // step) > self.most_px:
            step += 1
        first = (min(step // 2, columns - 1), columns, step), (min(step // 2, rows - 1), rows, step)
        across, down = np.meshgrid(*(np.arange(*one) for one in first))
        heights = self.field.heights_at(across.ravel(), down.ravel())
        there = ~np.isnan(heights)
        pixels = np.stack((across.ravel()[there], down.ravel()[there]), axis=-1) + 0.5
        xy = pixel_to_world(self.field.transform, pixels)
        origin = xy.min(axis=0, initial=np.inf)
        return cKDTree(xy - origin), origin, heights[there]


def meet_missing(
    origins: Floats,
    unit: Floats,
    hits: RayHits,
    field: HeightField,
    height_at: NearestHeights,
    max_range_m: float,
) -> Floats:
    """Return the points of `hits`, and those where rays come down where the DSM has no height.

    Such a ray is met with a level plane: first at `height_at` of the camera's place, then at that
    of the point so found. NaN for all other rays: those that do not go down, begin below the
    ground, or come to their range above a surface that is there.
    """
    points = hits.points.copy()
    # Missed, cut, or met underground.
    missed = np.isin(hits.status, (RayStatus.OFF_RASTER, RayStatus.BEYOND_RANGE))
    under = hits.points[..., 2] < field.sample(hits.points[..., :2]) - _SUNK_M
    camera, ray = np.nonzero(missed | under)
    origin, direction = origins[camera], unit[camera, ray]
    first = _on_plane(origin, direction, height_at(origin[:, :2]))
    second = _on_plane(origin, direction, height_at(first[:, :2]))
    length = np.linalg.norm(second - origin, axis=-1)
    cut = hits.status[camera, ray] == RayStatus.BEYOND_RANGE
    # Above a surface that is there, the range is what ended the ray.
    lost = ~(length <= max_range_m) | (cut & ~np.isnan(field.sample(second[:, :2])))
    sunk = hits.valid[camera, ray]
    lost |= sunk & ~(length < np.linalg.norm(points[camera, ray] - origin, axis=-1))
    points[camera[~lost], ray[~lost]] = second[~lost]
    return points


def _on_plane(origin: Floats, direction: Floats, height: Floats) -> Floats:
    """Return points (P, 3) where rays that go down meet level planes; NaN from below."""
    with np.errstate(over="ignore", invalid="ignore"):
        length = (height - origin[:, 2]) / direction[:, 2]
        points = origin + length[:, None] * direction
    return np.where((length > 0.0)[:, None], points, np.nan)
