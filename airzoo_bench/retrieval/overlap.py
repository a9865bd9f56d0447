"""Areas of footprints, of tiles and of what they share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["box_areas", "intersection_areas", "polygon_areas", "untangled"]

Floats = NDArray[np.float64]


def box_areas(boxes: Floats) -> Floats:
    """Area of boxes (n, 4), each x_min, y_min, x_max, y_max."""
    area: Floats = (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])
    return area


def polygon_areas(polygons: Floats) -> Floats:
    """Area of simple polygons (n, V, 2) by the shoelace formula, whichever way round."""
    x, y = np.moveaxis(polygons - polygons[:, :1], 2, 0)
    twice = x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y
    area: Floats = np.abs(twice.sum(axis=1)) / 2
    return area


def untangled(polygons: Floats) -> Floats:
    """Replace quadrilaterals that cross themselves with their convex hull.

    The two sides that cross are the diagonals of the hull, so that swapping two corners gives it.
    Quadrilaterals that do not cross themselves, convex or not, stay as they are.

    Parameters
    ----------
    polygons : (n, 4, 2) array
        Corners in order.

    Returns
    -------
    (n, 4, 2) array
    """
    a, b, c, d = np.moveaxis(polygons, 1, 0)
    order = np.broadcast_to(np.arange(4), (len(polygons), 4)).copy()
    order[_cross(a, b, c, d)] = 0, 2, 1, 3
    order[_cross(b, c, d, a)] = 0, 1, 3, 2
    return np.take_along_axis(polygons, order[:, :, None], axis=1)


def intersection_areas(polygons: Floats, boxes: Floats) -> Floats:
    """Area common to each simple polygon and its box.

    The area under each side of the polygon, cut to the box in x and clamped to it in y, summed
    round the polygon (Green's theorem): exact also for polygons that are not convex, without
    constructing the common polygon.

    Parameters
    ----------
    polygons : (n, V, 2) array
        Corners in order, either way round, without self-crossing.
    boxes : (n, 4) array
        x_min, y_min, x_max, y_max.

    Returns
    -------
    (n,) array
    """
    local = polygons - boxes[:, None, :2]  # near 0, so that no digits are lost to the offset
    width, height = (boxes[:, 2:] - boxes[:, :2]).T[:, :, None]
    xa, ya = np.moveaxis(local, 2, 0)
    xb, yb = np.roll(xa, -1, axis=1), np.roll(ya, -1, axis=1)
    start, stop = np.clip(xa, 0, width), np.clip(xb, 0, width)
    y_start = ya + (yb - ya) * _share(start - xa, xb - xa)
    y_stop = ya + (yb - ya) * _share(stop - xa, xb - xa)
    under = (stop - start) * _clamped_mean(y_start, y_stop, height)
    area: Floats = np.abs(under.sum(axis=1))
    return area


def _clamped_mean(ya: Floats, yb: Floats, height: Floats) -> Floats:
    """Mean of clamp(y, 0, height) while y goes from `ya` to `yb` evenly."""
    first, last = np.clip(ya, 0, height), np.clip(yb, 0, height)
    enters, leaves = _share(first - ya, yb - ya), _share(last - ya, yb - ya)
    # A level side has no share: `last` equals `first` and stands for the whole of it.
    middle = (leaves - enters) * (first + last) / 2
    mean: Floats = enters * first + middle + (1 - leaves) * last
    return mean


def _share(part: Floats, whole: Floats) -> Floats:
    """Give part / whole, cut to [0, 1]; 0 where the whole is 0."""
    share = np.divide(part, whole, out=np.zeros_like(part), where=whole != 0)
    return np.clip(share, 0, 1)


def _cross(a: Floats, b: Floats, c: Floats, d: Floats) -> NDArray[np.bool_]:
    """Whether the segments a-b and c-d cross, each (n, 2); touching is not crossing."""
    splits_cd = _turn(a, b, c) * _turn(a, b, d) < 0
    splits_ab = _turn(c, d, a) * _turn(c, d, b) < 0
    both: NDArray[np.bool_] = splits_cd & splits_ab
    return both


def _turn(a: Floats, b: Floats, c: Floats) -> Floats:
    ab, ac = b - a, c - a
    sign: Floats = np.sign(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])
    return sign
