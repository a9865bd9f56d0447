"""Exact distances from every point of a cloud to the nearest one of another, both ways.

A distance is ``sqrt((dx^2 + dy^2) + dz^2)`` in float64, each step rounded once, and the nearest
neighbour's is the least of all: the result of trying all pairs, to the last bit, for any order of
the points and number of threads, in memory or on disk.

pykdtree searches. Its bounds round, so that of two neighbours that are equally far up to the last
bits it may return either. It is asked for two: where the second is farther by more than the bounds
can err, the first is the nearest. Elsewhere it is asked for more, and where these do not decide
either, all points in a ball of that radius are tried.

Points are sorted along a Morton curve (Morton, A computer oriented geodetic data base and a new
technique in file sequencing, IBM, 1966), which makes neighbours in space neighbours in memory, or
in the temporary file from which clouds that exceed memory are mapped.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pykdtree import kdtree
from scipy.spatial import KDTree

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.progress import Progress, silent, with_progress
from airzoo_bench.formats.clouds.cloud import CloudSource
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.reconstruction.clouds import finite_pieces, gather_points

_LEAF = 16
_CHUNK, _SORTING_CHUNK, _PIECE = 1 << 17, 1 << 15, 1 << 18
# A bound gathers less than 8 roundings (2^-53 each) a level of the tree; this covers more than
# 1,000 levels. A level halves a side of a box, so that no cloud whose coordinates differ by less
# than a hundred orders of magnitude has as many.
_SLACK = 1e-12
_LEAST = 1e-290  # roundings are not relative among denormal numbers
_MORE = 9  # a point in the middle of a cube of a grid has eight nearest neighbours
_BALL = 1.0 + 1e-9  # SciPy's roundings are far smaller
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


class CloudDistances(NamedTuple):
    """Nearest distances of finite points, in their order, infinite where nothing is predicted."""

    to_truth: Floats
    to_prediction: Floats


def cloud_distances(
    prediction: CloudSource,
    truth: CloudSource,
    *,
    block_points: int,
    jobs: int,
    progress: Progress = silent,
) -> CloudDistances:
    """Measure clouds both ways, mapped from disk where either has more than `block_points`."""
    on_disk = max(prediction.count, truth.count) > block_points
    clouds = [
        gather_points(finite_pieces(cloud, min(block_points, _PIECE)), on_disk=on_disk)
        for cloud in (prediction, truth)
    ]
    if not len(clouds[1]):
        expected = "at least one point, after cropping too"
        raise BenchmarkError("the true cloud holds no finite point", expected=expected)
    measure = partial(mutual_distances, *clouds, jobs=jobs, on_disk=on_disk)
    return CloudDistances(*with_progress(measure, "distances", progress))


def mutual_distances(
    first: Floats, second: Floats, *, jobs: int, on_disk: bool = False
) -> tuple[Floats, Floats]:
    """Return the distance of each finite point to the nearest of the other: (N,) and (M,)."""
    clouds = first, second
    if not len(first) or not len(second):
        return np.full(len(first), np.inf), np.full(len(second), np.inf)
    orders = morton_order(first), morton_order(second)

    def search_from(here: int) -> Floats:
        search = NeighbourSearch(sort_points(clouds[1 - here], orders[1 - here], on_disk=on_disk))
        distances = np.empty(len(clouds[here]))
        for rows in _chunks(orders[here]):
            distances[rows] = np.sqrt(search.squared(clouds[here][rows], jobs=jobs))
        return distances

    return search_from(0), search_from(1)


def sort_points(points: Floats, order: Ints, *, on_disk: bool) -> Floats:
    """Return points in an order, without copies behind each other, which no tree can part."""

    def pieces() -> Iterator[Floats]:
        last = np.full((1, 3), np.nan)
        for rows in _chunks(order):
            part = points[rows]
            is_new = (part != np.concatenate((last, part[:-1]))).any(axis=1)
            last = part[-1:]
            yield part[is_new]

    if on_disk:
        return gather_points(pieces(), on_disk=True)
    found, count = np.empty((len(order), 3)), 0
    for piece in pieces():
        found[count : count + len(piece)] = piece
        count += len(piece)
    return found[:count]


def _chunks(rows: NDArray[np.generic]) -> Iterator[NDArray[np.generic]]:
    return (rows[start : start + _CHUNK] for start in range(0, len(rows), _CHUNK))


def _squared_length(offsets: Floats) -> Floats:
    with np.errstate(over="ignore", under="ignore"):
        x, y, z = np.moveaxis(offsets, -1, 0)
        total: Floats = (x * x + y * y) + z * z
    return total


class NeighbourSearch:
    """A search for the nearest of points (M, 3): at least one, finite, best in Morton order."""

    def __init__(self, points: Floats) -> None:
        self._points = points
        self._tree = kdtree.KDTree(self._points, leafsize=_LEAF)
        self._balls: Any = None

    def squared(self, points: Floats, *, jobs: int) -> Floats:
        """Return the squared distance (N,) of each of points (N, 3) to the nearest."""
        with _openmp_threads(jobs):
            squared, unsure = self._ask(points, 2)
            rows = np.flatnonzero(unsure)
            if len(rows):
                squared[rows] = self._resolve_ties(points[rows])
        return squared

    def _resolve_ties(self, points: Floats) -> Floats:
        squared, unsure = self._ask(points, _MORE)
        if unsure.any() and self._balls is None:
            self._balls = KDTree(self._points)
        for row in np.flatnonzero(unsure):
            radius = _BALL * np.sqrt(max(squared[row], _LEAST))
            near = self._points[self._balls.query_ball_point(points[row], radius)]
            squared[row] = _squared_length(points[row] - near).min(initial=squared[row])
        return squared

    def _ask(self, points: Floats, count: int) -> tuple[Floats, Bools]:
        """Return the least squared distance to some points, and whether another may be less."""
        near, index = self._tree.query(points, k=count, sqr_dists=True)
        # Where there are fewer, the index is beyond the last: any point does in its place.
        index = np.minimum(index, len(self._points) - 1)
        squared = _squared_length(points - self._points[index[:, 0]])
        with np.errstate(over="ignore"):
            unsure = near[:, -1] <= near[:, 0] * (1.0 + _SLACK) + _LEAST
        unsure &= squared > 0.0
        for column in range(1, count if count > 2 else 0):
            another = _squared_length(points - self._points[index[:, column]])
            np.minimum(squared, another, out=squared)
        return squared, unsure


@contextmanager
def _openmp_threads(jobs: int) -> Iterator[None]:
    """Limit the threads of pykdtree, which takes all, where its OpenMP can be found."""
    library = ctypes.CDLL(kdtree.__file__)
    limited = hasattr(library, "omp_set_num_threads")
    before = library.omp_get_max_threads() if limited else 0
    if limited:
        library.omp_set_num_threads(jobs)
    try:
        yield
    finally:
        if limited:
            library.omp_set_num_threads(before)


def morton_order(points: Floats) -> Ints:
    """Return the permutation (N,) that sorts finite points (N, 3) along a Morton curve."""
    index_bits = max(len(points) - 1, 1).bit_length()
    bits = min(_MOST_BITS, (64 - index_bits) // 3)
    # Cells are counted from the median, in widths of most of the points; halves stay finite.
    sample = points[:: max(1, len(points) // _SAMPLE)] / 2.0
    low, middle, high = np.quantile(sample, (0.1, 0.5, 0.9), axis=0)
    width = np.where(high > low, high - low, 1.0)
    keys = np.empty(len(points), dtype=np.uint64)
    for start in range(0, len(points), _SORTING_CHUNK):
        cells = _cells(points[start : start + _SORTING_CHUNK], middle, width, bits)
        numbers = np.arange(start, start + len(cells), dtype=np.uint64)
        keys[start : start + len(cells)] = cells << np.uint64(index_bits) | numbers
    keys.sort()
    keys &= np.uint64((1 << index_bits) - 1)
    return keys.view(np.int64)


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
