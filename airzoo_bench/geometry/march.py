"""Follow rays over a height field from cell to cell.

Cells are those of the grid of pixel centres: between four neighbours, and half of one along the
border. The walk is that of Amanatides and Woo (1987), all rays at once; in each cell the ray is met
with the surface in closed form.

A cell has four corners, in the order of `heightfield.CORNERS`; positions in it run from (0, 0) to
(1, 1). There the ray runs from `start` to `start + way` while u goes from 0 to 1, at height
z + u drop.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.heightfield import CORNERS, HeightField
from airzoo_bench.geometry.rasters import world_to_pixel, world_to_pixel_steps

__all__ = ["first_crossings", "first_in_cell"]

# The march begins this far above the highest height and ends this far below the lowest, so that
# rounding does not leave out the height itself (a level DSM has only one).
_MARGIN_M = 1e-3
# A root at the edge of a cell may be rounded out of it, and the next cell may have no height.
_ROUNDING = 1e-12


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
        return _Walk(*(getattr(self, item.name)[mask] for item in fields(self)))

    def at(self, length: Floats) -> Floats:
        moved: Floats = self.grid + length[:, None] * self.step
        return moved


def first_crossings(
    origins: Floats, unit: Floats, field: HeightField, max_range_m: float
) -> tuple[Floats, Bools]:
    """Length along each ray to its first crossing of the surface."""
    found = np.full(len(origins), np.nan)
    walk, cut = _started(origins, unit, field, max_range_m)
    while walk.row.size:
        border = _next_border(walk)
        until = np.maximum(np.minimum(border.min(axis=-1), walk.end), walk.length)
        share = _meet(walk, until, field)
        hit = ~np.isnan(share)
        found[walk.row[hit]] = (walk.length + share * (until - walk.length))[hit]
        cell = walk.cell + np.where(border <= until[:, None], np.sign(walk.step), 0).astype(
            np.int64
        )
        moved = _Walk(walk.row, walk.grid, walk.step, walk.z, walk.sink, until, walk.end, cell)
        walk = moved.keep(~hit & (until < walk.end))
    return found, cut


def _started(
    origins: Floats, unit: Floats, field: HeightField, max_range_m: float
) -> tuple[_Walk, Bools]:
    """Put the rays where they come over the raster and below its highest height."""
    low, high = field.height_range
    size = np.array(field.heights.shape[::-1])
    z, sink = origins[:, 2], unit[:, 2]
    pixel = world_to_pixel(field.transform, origins[:, :2])
    step = world_to_pixel_steps(field.transform, unit[:, :2])
    enter, leave = _over_raster(pixel, step, size)
    with np.errstate(over="ignore"):
        begin = np.maximum(enter, (high + _MARGIN_M - z) / sink)
        last = np.minimum(leave, (low - _MARGIN_M - z) / sink)
    end = np.minimum(last, max_range_m)
    below = _enters_below(field, pixel, step, z, sink, enter)
    going = (begin <= end) & ~below
    cut = (max_range_m < last) & (enter <= leave) & ~(below & (enter <= max_range_m))
    row = np.flatnonzero(going)
    grid = pixel[going] - 0.5
    here = grid + begin[going, None] * step[going]
    cell = np.clip(np.floor(here), -1, size - 1).astype(np.int64)
    walk = _Walk(row, grid, step[going], z[going], sink[going], begin[going], end[going], cell)
    return walk, cut


def _over_raster(pixel: Floats, step: Floats, size: Ints) -> tuple[Floats, Floats]:
    """Lengths (P,) at which rays enter and leave the raster; enter > leave for those that miss."""
    still = step == 0.0
    inside = (pixel >= 0.0) & (pixel <= size)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        one, other = -pixel / step, (size - pixel) / step
    near = np.where(still, np.where(inside, -np.inf, np.inf), np.minimum(one, other))
    far = np.where(still, np.where(inside, np.inf, -np.inf), np.maximum(one, other))
    return np.maximum(near.max(axis=-1), 0.0), far.min(axis=-1)


def _enters_below(
    field: HeightField, pixel: Floats, step: Floats, z: Floats, sink: Floats, enter: Floats
) -> Bools:
    """Tell rays that come over the raster's border already below its surface."""
    size = np.array(field.heights.shape[::-1])
    there = np.where(np.isfinite(enter), enter, 0.0)
    height = field.sample_pixels(np.clip(pixel + there[:, None] * step, 0.0, size))
    return (there > 0.0) & (z + there * sink <= height)


def _next_border(walk: _Walk) -> Floats:
    """Lengths (P, 2) at which rays meet the next column and row of pixel centres."""
    line = walk.cell + (walk.step > 0.0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        border = (line - walk.grid) / walk.step
    return np.where(walk.step == 0.0, np.inf, border)


def _meet(walk: _Walk, until: Floats, field: HeightField) -> Floats:
    """Share of the way through its cell at which each ray meets the surface; NaN where not."""
    last = np.array(field.heights.shape[::-1]) - 1.0
    # Along the border the surface is level: the point is moved to the outermost pixel centres.
    enter = np.clip(walk.at(walk.length), 0.0, last) - walk.cell
    leave = np.clip(walk.at(until), 0.0, last) - walk.cell
    heights = field.corner_heights(walk.cell)
    z = walk.z + walk.length * walk.sink
    return first_in_cell(heights, enter, leave - enter, z, (until - walk.length) * walk.sink)


def first_in_cell(heights: Floats, start: Floats, way: Floats, z: Floats, drop: Floats) -> Floats:
    """Smallest u in [0, 1] at which the ray is on the surface or below."""
    known = ~np.isnan(heights)
    whole = known.all(axis=-1)
    part = known.any(axis=-1) & ~whole
    first = np.full(len(heights), np.nan)
    for pick, meet in ((whole, _first_on_bilinear), (part, _first_on_nearest)):
        if pick.any():
            first[pick] = meet(heights[pick], start[pick], way[pick], z[pick], drop[pick])
    return first


def _first_on_bilinear(
    heights: Floats, start: Floats, way: Floats, z: Floats, drop: Floats
) -> Floats:
    """Ray minus surface is c0 + c1 u + c2 u^2 along the ray; its first root from above."""
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
    """Each corner with a height rules where it is the nearest, within a pixel: a convex region."""
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
    """Interval of u in [0, 1] where |start + u way| <= 1; low > high where there is none."""
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
