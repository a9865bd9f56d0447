"""Points in Morton order, and boxes around runs of them: what cannot be near is not looked at.

Sorted along a Morton curve, neighbours in space are neighbours in memory. The order serves speed
alone: no result depends on it.

Bounds are never above a distance that they bound, not even by a rounding: subtraction,
multiplication and addition of floating-point numbers are monotone, and a bound takes the same
steps as a distance. So "strictly below" is a safe test, without any tolerance.

References
----------
Morton, A computer oriented geodetic data base and a new technique in file sequencing, IBM, 1966.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats, Ints

__all__ = [
    "BoxTree",
    "bound_squared",
    "gap_squared",
    "gather",
    "morton_order",
    "squared_distance",
]

_RUN = 32
_FANOUT = 16
_PAIRS = 1 << 16
_CHUNK = 1 << 15
_SAMPLE = 1 << 14
_MOST_BITS = 21
_FURTHEST = 1e9
# Each step moves the upper half of every group of bits away, until two zeros follow each bit.
_SPREADING = (
    (32, 0x001F00000000FFFF),
    (16, 0x001F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)


def morton_order(points: Floats) -> Ints:
    """Return the permutation (N,) that sorts finite points (N, 3) along a Morton curve."""
    index_bits = max(len(points) - 1, 1).bit_length()
    bits = min(_MOST_BITS, (64 - index_bits) // 3)
    middle, width = _core(points)
    keys = np.empty(len(points), dtype=np.uint64)
    for start in range(0, len(points), _CHUNK):
        part = points[start : start + _CHUNK]
        numbers = np.arange(start, start + len(part), dtype=np.uint64)
        cells = _interleave(_cells(part, middle, width, bits))
        keys[start : start + len(part)] = cells << np.uint64(index_bits) | numbers
    keys.sort()
    keys &= np.uint64((1 << index_bits) - 1)
    return keys.view(np.int64)


def gather(points: Floats, order: Ints) -> Floats:
    """Return ``points[order]``, contiguous, whatever the layout of `points`."""
    picked = np.empty((len(order), points.shape[1]))
    for start in range(0, len(order), _CHUNK):
        picked[start : start + _CHUNK] = points[order[start : start + _CHUNK]]
    return picked


def _core(points: Floats) -> tuple[Floats, Floats]:
    """Where most points are: their median, and how far it is to most of them, by axis."""
    if len(points) == 0:
        return np.zeros(3), np.ones(3)
    sample = points[:: max(1, len(points) // _SAMPLE)] / 2.0  # halves: differences stay finite
    low, middle, high = np.quantile(sample, (0.1, 0.5, 0.9), axis=0)
    width = high - low
    return middle, np.where(width > 0.0, width, 1.0)


def _cells(points: Floats, middle: Floats, width: Floats, bits: int) -> NDArray[np.uint64]:
    """Cell (3, N) of each point along each axis, from 0 to 2^bits - 1."""
    with np.errstate(over="ignore"):
        away = (points / 2.0 - middle).T / width[:, None]
    away = np.clip(away, -_FURTHEST, _FURTHEST)
    share = away / (1.0 + np.abs(away)) * 0.5 + 0.5
    cells: NDArray[np.uint64] = np.minimum(share * 2.0**bits, 2.0**bits - 1.0).astype(np.uint64)
    return cells


def _interleave(cells: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """One integer (N,) of the bits of three: z y x z y x ..."""
    for shift, mask in _SPREADING:
        cells = (cells | cells << np.uint64(shift)) & np.uint64(mask)
    woven: NDArray[np.uint64] = cells[0] | cells[1] << np.uint64(1) | cells[2] << np.uint64(2)
    return woven


def squared_distance(points: Floats, others: Floats) -> Floats:
    """Squared distances (...) of points to partners (..., 3): ``(dx^2 + dy^2) + dz^2`` in order."""
    return _sum_of_squares(points - others)


def bound_squared(points: Floats, low: Floats, high: Floats) -> Floats:
    """Lower bound (...) of the squared distance from points (..., 3) to all that boxes can hold."""
    return gap_squared(points, points, low, high)


def gap_squared(low: Floats, high: Floats, others_low: Floats, others_high: Floats) -> Floats:
    """Lower bound (...) of the squared distance from all in one box to all in another."""
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
        """Lower `squared` (Q,), in place, to the squared distances of points (Q, 3) to the nearest.

        They are squared distances to some of the tree's points, or infinite.
        """
        top = len(self._levels) - 1
        count = len(self._levels[top][0])
        for start in range(0, len(points), _PAIRS // _FANOUT):
            rows = np.arange(start, min(start + _PAIRS // _FANOUT, len(points)))
            boxes = np.tile(np.arange(count), len(rows))
            self._descend(top, np.repeat(rows, count), boxes, points, squared)

    def _descend(
        self, level: int, rows: Ints, boxes: Ints, points: Floats, squared: Floats
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
