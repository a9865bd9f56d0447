"""Exact distances to nearest neighbours.

A distance here is ``sqrt((dx^2 + dy^2) + dz^2)`` in float64, each step rounded once, and the
nearest neighbour's is the least of them over all points: what trying all pairs gives, to the last
bit. No order of points, number of threads or cutting into blocks can change it.

The search is that of pykdtree, which prunes by bounds with rounding errors: of two neighbours that
are equally far but for the last bits it may return either. So it is asked for two. Where the
second is further by more than its bounds can err, the first is the nearest; where it is not, more
are asked for, and where these do not decide either, all that lie within a ball just as large.

Sorted along a Morton curve, neighbours in space are neighbours in memory. The order serves speed
alone: no result depends on it.

References
----------
Morton, A computer oriented geodetic data base and a new technique in file sequencing, IBM, 1966.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray
from pykdtree import kdtree
from scipy.spatial import KDTree

from airzoo_bench.geometry.arrays import Bools, Floats, Ints

__all__ = [
    "NeighbourSearch",
    "gather",
    "morton_order",
    "mutual_distances",
]

_LEAF = 16
_CHUNK, _SORTING_CHUNK = 1 << 17, 1 << 15
# A bound gathers less than 8 roundings (2^-53 each) a level of the tree; this covers more than
# 1,000 levels. A level halves a side of a box, so that no cloud whose coordinates differ by less
# than a hundred orders of magnitude has as many.
_SLACK = 1e-12
# Roundings are not relative among denormal numbers.
_LEAST = 1e-290
_MORE = 9  # a point in the middle of a cube of a grid has eight nearest neighbours
_BALL = 1.0 + 1e-9  # SciPy's roundings are far smaller
_COPIES, _COPIES_SHARE = 64, 0.01
_MIXERS = tuple(map(np.uint64, (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9)))
_SAMPLE = 1 << 14
_MOST_BITS = 21  # of a coordinate's cell: three such numbers fit into 64 bits
_FURTHEST = 1e9
# Each step moves the upper half of every group of bits away, until two zeros follow each bit.
_SPREADING = (
    (32, 0x001F00000000FFFF),
    (16, 0x001F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)


def mutual_distances(first: Floats, second: Floats, *, jobs: int) -> tuple[Floats, Floats]:
    """Distance of each point to the nearest of the other cloud, both ways: (N,) and (M,)."""
    _check(first)
    _check(second)
    if len(first) == 0 or len(second) == 0:
        return np.full(len(first), np.inf), np.full(len(second), np.inf)
    orders = morton_order(first), morton_order(second)
    return (
        _distances(first, orders[0], second, orders[1], jobs),
        _distances(second, orders[1], first, orders[0], jobs),
    )


def _check(points: Floats) -> None:
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"points of shape {points.shape}, expected (N, 3)")
    for start in range(0, len(points), _CHUNK):
        if not np.isfinite(points[start : start + _CHUNK]).all():
            raise ValueError("points that are not finite")


def _distances(
    points: Floats, order: Ints, others: Floats, others_order: Ints, jobs: int
) -> Floats:
    search = NeighbourSearch(gather(others, others_order))
    found = np.empty(len(points))
    for start in range(0, len(points), _CHUNK):
        rows = order[start : start + _CHUNK]
        found[rows] = search.squared(points[rows], jobs=jobs)
    return np.sqrt(found, out=found)


class NeighbourSearch:
    """Points made ready to be searched.

    Parameters
    ----------
    points : (M, 3) array
        At least one, finite; along a Morton curve, or the search is slow.
    """

    def __init__(self, points: Floats) -> None:
        self._points = _without_copies(points)
        self._tree = kdtree.KDTree(self._points, leafsize=_LEAF)

    def squared(self, points: Floats, *, jobs: int) -> Floats:
        """Squared distance (N,) of each of points (N, 3), best in Morton order, to the nearest."""
        found = np.empty(len(points))
        with _openmp_threads(jobs):
            for start in range(0, len(points), _CHUNK):
                found[start : start + _CHUNK] = self._nearest(points[start : start + _CHUNK])
        return found

    def _nearest(self, points: Floats) -> Floats:
        squared, unsure = self._ask(points, 2)
        if unsure.any():
            rows = np.flatnonzero(unsure)
            squared[rows] = self._resolve_ties(points[rows])
        return squared

    def _resolve_ties(self, points: Floats) -> Floats:
        squared, unsure = self._ask(points, _MORE)
        for row in np.flatnonzero(unsure):
            radius = _BALL * np.sqrt(max(squared[row], _LEAST))
            near = self._points[self._balls.query_ball_point(points[row], radius)]
            squared[row] = _squared_distance(points[row], near).min(initial=squared[row])
        return squared

    def _ask(self, points: Floats, count: int) -> tuple[Floats, Bools]:
        """Least squared distance to some points of the tree, and whether another may be less."""
        near, index = self._tree.query(points, k=count, sqr_dists=True)
        # Where there are fewer, the index is beyond the last: any point does in its place.
        index = np.minimum(index, len(self._points) - 1)
        squared = _squared_distance(points, self._points[index[:, 0]])
        with np.errstate(over="ignore"):
            unsure = near[:, -1] <= near[:, 0] * (1.0 + _SLACK) + _LEAST
        unsure &= squared > 0.0
        for column in range(1, count if count > 2 else 0):
            another = _squared_distance(points, self._points[index[:, column]])
            np.minimum(squared, another, out=squared)
        return squared, unsure

    @cached_property
    def _balls(self) -> KDTree:
        return KDTree(self._points)


def _squared_distance(points: Floats, others: Floats) -> Floats:
    """Squared distances (...) of points to partners (..., 3): ``(dx^2 + dy^2) + dz^2`` in order."""
    with np.errstate(over="ignore", under="ignore"):
        x, y, z = np.moveaxis(points - others, -1, 0)
        total: Floats = (x * x + y * y) + z * z
    return total


def _without_copies(points: Floats) -> Floats:
    """Drop copies of points where there are many, or many of one, which no tree can part."""
    bits = np.ascontiguousarray(points).view(np.uint64)
    mixed = bits[:, 0] * _MIXERS[0] + bits[:, 1] * _MIXERS[1] + bits[:, 2] * _MIXERS[2]
    mixed.sort()
    copies = np.count_nonzero(mixed[1:] == mixed[:-1])
    many_of_one = np.any(mixed[_COPIES:] == mixed[:-_COPIES])
    if copies < _COPIES_SHARE * len(points) and not many_of_one:
        return points
    order = np.lexsort(points.T)
    ordered = points[order]
    is_new = np.concatenate(([True], (ordered[1:] != ordered[:-1]).any(axis=1)))
    return points[np.sort(order[is_new])]


def morton_order(points: Floats) -> Ints:
    """Return the permutation (N,) that sorts finite points (N, 3) along a Morton curve."""
    index_bits = max(len(points) - 1, 1).bit_length()
    bits = min(_MOST_BITS, (64 - index_bits) // 3)
    middle, width = _core(points)
    keys = np.empty(len(points), dtype=np.uint64)
    for start in range(0, len(points), _SORTING_CHUNK):
        part = points[start : start + _SORTING_CHUNK]
        numbers = np.arange(start, start + len(part), dtype=np.uint64)
        cells = _cells(part, middle, width, bits)
        keys[start : start + len(part)] = cells << np.uint64(index_bits) | numbers
    keys.sort()
    keys &= np.uint64((1 << index_bits) - 1)
    return keys.view(np.int64)


def gather(points: Floats, order: Ints) -> Floats:
    """Return ``points[order]``, contiguous, whatever the layout of `points`."""
    picked = np.empty((len(order), points.shape[1]))
    for start in range(0, len(order), _SORTING_CHUNK):
        picked[start : start + _SORTING_CHUNK] = points[order[start : start + _SORTING_CHUNK]]
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
    """Return the number (N,) of each point's cell along the curve; far cells are larger."""
    with np.errstate(over="ignore"):
        away = (points / 2.0 - middle).T / width[:, None]
    away = np.clip(away, -_FURTHEST, _FURTHEST)
    share = away / (1.0 + np.abs(away)) * 0.5 + 0.5
    cells = np.minimum(share * 2.0**bits, 2.0**bits - 1.0).astype(np.uint64)
    for shift, mask in _SPREADING:
        cells = (cells | cells << np.uint64(shift)) & np.uint64(mask)
    woven: NDArray[np.uint64] = cells[0] | cells[1] << np.uint64(1) | cells[2] << np.uint64(2)
    return woven


@contextmanager
def _openmp_threads(jobs: int) -> Iterator[None]:
    """Limit the threads of pykdtree, which has no argument for them and takes all."""
    library = _openmp()
    if library is None:
        yield
        return
    before = library.omp_get_max_threads()
    library.omp_set_num_threads(jobs)
    try:
        yield
    finally:
        library.omp_set_num_threads(before)


@cache
def _openmp() -> ctypes.CDLL | None:
    """Return pykdtree's own OpenMP, or None where it is built without, or hides it (Windows)."""
    library = ctypes.CDLL(kdtree.__file__)
    return library if hasattr(library, "omp_set_num_threads") else None
