"""First crossing of a ray with the surface of one cell, in closed form.

A cell has four corners, in the order of `heightfield.CORNERS`; positions in it run from (0, 0) to
(1, 1). The ray runs from `start` to `start + way` while u goes from 0 to 1, at height z + u drop.
"""

from __future__ import annotations

import numpy as np

from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.heightfield import CORNERS

__all__ = ["first_in_cell"]

# A root at the edge of a cell may be rounded out of it, and the next cell may have no height.
_ROUNDING = 1e-12


def first_in_cell(heights: Floats, start: Floats, way: Floats, z: Floats, drop: Floats) -> Floats:
    """Smallest u in [0, 1] at which the ray is on the surface or below.

    Parameters
    ----------
    heights : (P, 4) array
        Of the cell's corners; NaN where there is none.
    start, way : (P, 2) array
        Start of the ray in the cell and its way through it, in cells.
    z, drop : (P,) array
        drop <= 0.

    Returns
    -------
    (P,) array
        NaN where there is no crossing, or no height.
    """
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
    """Each corner with a height rules where it is the nearest, within a pixel: a convex region.

    The ray's stay in it, and below its height, is an interval of u; the first of the four counts.
    """
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
