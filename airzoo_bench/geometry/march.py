"""Follow rays over a height field from cell to cell.

Cells are those of the grid of pixel centres: between four neighbours, and half of one along the
border. The walk is that of Amanatides and Woo (1987), all rays at once; in each cell the ray is met
with the surface in closed form (`crossings`).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.crossings import first_in_cell
from airzoo_bench.geometry.grids import world_to_pixel, world_to_pixel_steps
from airzoo_bench.geometry.heightfield import HeightField

__all__ = ["first_crossings"]

# The march begins this far above the highest height and ends this far below the lowest, so that
# rounding does not leave out the height itself (a level DSM has only one).
_MARGIN_M = 1e-3


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
    """Length along each ray to its first crossing of the surface.

    Parameters
    ----------
    origins, unit : (P, 3) array
        Rays that go down, from above the surface, unit directions.
    field : HeightField
    max_range_m : float

    Returns
    -------
    length : (P,) array
        NaN where there is no crossing.
    cut : (P,) bool array
        True where the walk would have gone on beyond `max_range_m`.
    """
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
