"""Boxes around runs of points: what cannot be near need not be looked at.

Bounds are never above a distance that they bound, not even by a rounding: subtraction,
multiplication and addition of floating-point numbers are monotone, and a bound takes the same
steps as a distance. So "strictly below" is a safe test, without any tolerance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats

__all__ = ["BoxTree", "bound_squared", "gap_squared", "squared_distance"]

_RUN = 32
_FANOUT = 16
_PAIRS = 1 << 16

Rows = NDArray[np.intp]


def squared_distance(points: Floats, others: Floats) -> Floats:
    """Squared distances of points to their partners: ``(dx^2 + dy^2) + dz^2``, in this order.

    Parameters
    ----------
    points, others : (..., 3) arrays

    Returns
    -------
    (...) array
        Infinite where a square overflows.
    """
    return _sum_of_squares(points - others)


def bound_squared(points: Floats, low: Floats, high: Floats) -> Floats:
    """Lower bound of the squared distance from points to all that boxes can hold.

    Parameters
    ----------
    points, low, high : (..., 3) arrays
        Leading dimensions broadcast.

    Returns
    -------
    (...) array
        Never above `squared_distance` to a point of the box, to the last bit.
    """
    return gap_squared(points, points, low, high)


def gap_squared(low: Floats, high: Floats, others_low: Floats, others_high: Floats) -> Floats:
    """Lower bound of the squared distance from all in one box to all in another.

    Parameters
    ----------
    low, high, others_low, others_high : (..., 3) arrays
        Leading dimensions broadcast.

    Returns
    -------
    (...) array
        0 where the boxes meet.
    """
    return _sum_of_squares(np.maximum(np.maximum(others_low - high, low - others_high), 0.0))


def _sum_of_squares(difference: Floats) -> Floats:
    with np.errstate(over="ignore", under="ignore"):
        x, y, z = (difference[..., axis] for axis in range(3))
        total: Floats = (x * x + y * y) + z * z
    return total


class BoxTree:
    """Boxes around runs of consecutive points, boxes around runs of boxes, and so on.

    For few queries that need an answer without any tolerance; a k-d tree is faster for many.

    Parameters
    ----------
    points : (N, 3) array
        At least one, in an order that keeps neighbours together.
    """

    def __init__(self, points: Floats) -> None:
        self._points = points
        self._levels = [_boxes(points, points, _RUN)]
        while len(self._levels[-1][0]) > _FANOUT:
            self._levels.append(_boxes(*self._levels[-1], _FANOUT))

    def improve(self, points: Floats, squared: Floats) -> None:
        """Lower `squared`, in place, to the squared distance of the nearest point.

        Parameters
        ----------
        points : (Q, 3) array
        squared : (Q,) array
            Squared distances to some of the tree's points, or infinite.
        """
        top = len(self._levels) - 1
        count = len(self._levels[top][0])
        for start in range(0, len(points), _PAIRS // _FANOUT):
            rows = np.arange(start, min(start + _PAIRS // _FANOUT, len(points)))
            boxes = np.tile(np.arange(count), len(rows))
            self._descend(top, np.repeat(rows, count), boxes, points, squared)

    def _descend(
        self, level: int, rows: Rows, boxes: Rows, points: Floats, squared: Floats
    ) -> None:
        low, high = self._levels[level]
        reach = bound_squared(points[rows], low[boxes], high[boxes]) < squared[rows]
        rows, boxes = rows[reach], boxes[reach]
        fanout = _FANOUT if level else _RUN
        below = len(self._levels[level - 1][0]) if level else len(self._points)
        for start in range(0, len(rows), _PAIRS // fanout):
            part = slice(start, start + _PAIRS // fanout)
            children = (boxes[part, None] * fanout + np.arange(fanout)).ravel()
            parents = np.repeat(rows[part], fanout)
            there = children < below
            if level:
                self._descend(level - 1, parents[there], children[there], points, squared)
            else:
                found = squared_distance(points[parents[there]], self._points[children[there]])
                np.minimum.at(squared, parents[there], found)


def _boxes(low: Floats, high: Floats, run: int) -> tuple[Floats, Floats]:
    starts = np.arange(0, len(low), run)
    return np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)
