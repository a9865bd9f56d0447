"""Exact distances to nearest neighbours.

A distance here is ``sqrt((dx^2 + dy^2) + dz^2)`` in float64, each step rounded once, and the
nearest neighbour's is the least of them over all points: what trying all pairs gives, to the last
bit. No order of points, number of threads or cutting into blocks can change it.

The search is that of pykdtree, which prunes by bounds with rounding errors: of two neighbours that
are equally far but for the last bits it may return either. So it is asked for two. Where the
second is further by more than its bounds can err, the first is the nearest; where it is not, more
are asked for, and where these do not decide either, bounds without errors do (`boxes`).
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import numpy as np
from numpy.typing import NDArray
from pykdtree import kdtree

from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.reconstruction.distances.boxes import (
    BoxTree,
    gather,
    morton_order,
    squared_distance,
)

__all__ = ["NeighbourSearch", "mutual_distances"]

_LEAF = 16
_CHUNK = 1 << 17
# A bound gathers less than 8 roundings (2^-53 each) a level of the tree; this covers more than
# 1,000 levels. A level halves a side of a box, so that no cloud whose coordinates differ by less
# than a hundred orders of magnitude has as many.
_SLACK = 1e-12
# Roundings are not relative among denormal numbers.
_LEAST = 1e-290
_MORE = 9  # a point in the middle of a cube of a grid has eight nearest neighbours
_COPIES, _COPIES_SHARE = 64, 0.01
_MIXERS = tuple(map(np.uint64, (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9)))

Hashes = NDArray[np.uint64]


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
        self._boxes: BoxTree | None = None

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
        if unsure.any():
            self._boxes = self._boxes or BoxTree(self._points)
            rows = np.flatnonzero(unsure)
            least = squared[rows]
            self._boxes.improve(points[rows], least)
            squared[rows] = least
        return squared

    def _ask(self, points: Floats, count: int) -> tuple[Floats, Bools]:
        """Least squared distance to some points of the tree, and whether another may be less."""
        near, index = self._tree.query(points, k=count, sqr_dists=True)
        # Where there are fewer, the index is beyond the last: any point does in its place.
        index = np.minimum(index, len(self._points) - 1)
        squared = squared_distance(points, self._points[index[:, 0]])
        with np.errstate(over="ignore"):
            unsure = near[:, -1] <= near[:, 0] * (1.0 + _SLACK) + _LEAST
        unsure &= squared > 0.0
        for column in range(1, count if count > 2 else 0):
            another = squared_distance(points, self._points[index[:, column]])
            np.minimum(squared, another, out=squared)
        return squared, unsure


def _distances(
    points: Floats, order: Ints, others: Floats, others_order: Ints, jobs: int
) -> Floats:
    search = NeighbourSearch(gather(others, others_order))
    found = np.empty(len(points))
    for start in range(0, len(points), _CHUNK):
        rows = order[start : start + _CHUNK]
        found[rows] = search.squared(points[rows], jobs=jobs)
    return np.sqrt(found, out=found)


def _check(points: Floats) -> None:
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"points of shape {points.shape}, expected (N, 3)")
    for start in range(0, len(points), _CHUNK):
        if not np.isfinite(points[start : start + _CHUNK]).all():
            raise ValueError("points that are not finite")


def _without_copies(points: Floats) -> Floats:
    """Drop copies of points where there are many, or many of one."""
    ordered = _hashes(points)
    ordered.sort()
    copies = np.count_nonzero(ordered[1:] == ordered[:-1])
    many_of_one = np.any(ordered[_COPIES:] == ordered[:-_COPIES])
    if copies < _COPIES_SHARE * len(points) and not many_of_one:
        return points
    hashes = _hashes(points)
    order = np.argsort(hashes, kind="stable")
    same = hashes[order[1:]] == hashes[order[:-1]]
    later, earlier = order[1:][same], order[:-1][same]
    kept = np.ones(len(points), dtype=np.bool_)
    kept[later[(points[later] == points[earlier]).all(axis=1)]] = False
    return points[kept]


def _hashes(points: Floats) -> Hashes:
    hashes = np.empty(len(points), dtype=np.uint64)
    for start in range(0, len(points), _CHUNK):
        bits = np.ascontiguousarray(points[start : start + _CHUNK]).view(np.uint64)
        mixed = np.zeros(len(bits), dtype=np.uint64)
        for axis, mixer in enumerate(_MIXERS):
            mixed = (mixed ^ bits[:, axis]) * mixer
            mixed ^= mixed >> np.uint64(32)
        hashes[start : start + len(bits)] = mixed
    return hashes


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
