"""Exact distances from every point of a cloud to the nearest one of another, both ways.

A distance is ``sqrt((dx^2 + dy^2) + dz^2)`` in float64, each step rounded once, and the nearest
neighbour's is the least of all: what trying all pairs gives, to the last bit, for any order of the
points, number of threads and size of blocks.

pykdtree searches. Its bounds round, so that of two neighbours that are equally far but for the last
bits it may return either. It is asked for two: where the second is farther by more than the bounds
can err, the first is the nearest. Elsewhere it is asked for more, and where these do not decide
either, all points in a ball of that radius are tried.

Points are sorted along a Morton curve (Morton, A computer oriented geodetic data base and a new
technique in file sequencing, IBM, 1966), which makes neighbours in space neighbours in memory.
Clouds that exceed memory are mapped from temporary files and cut into slabs across their longest
axis. A slab is searched for those points only to whose nearest neighbour it may be near enough.
"""

from __future__ import annotations

import ctypes
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import IO

import numpy as np
from numpy.typing import NDArray
from pykdtree import kdtree
from scipy.spatial import KDTree

from airzoo_bench.core.errors import BenchmarkError, UserError
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.formats.clouds.cloud import CloudSource
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.reconstruction.clouds import concatenated, finite_pieces

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
_MOST_SLABS = 1 << 12
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


@dataclass(frozen=True, eq=False)
class CloudDistances:
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
    """Measure clouds both ways: in memory up to `block_points` each, else on disk in slabs."""
    on_disk = max(prediction.count, truth.count) > block_points
    with ExitStack() as stack:
        clouds = [
            _mapped(cloud, stack.enter_context(tempfile.TemporaryFile()))
            if on_disk
            else concatenated(finite_pieces(cloud, block_points))
            for cloud in (prediction, truth)
        ]
        if not len(clouds[1]):
            raise BenchmarkError(
                "the true cloud holds no finite point",
                expected="at least one point, after cropping too",
                fix="check the benchmark's cloud and the protocol's crop",
            )
        found = mutual_distances(*clouds, jobs=jobs, block_points=block_points, progress=progress)
        return CloudDistances(*found)


def _mapped(cloud: CloudSource, stream: IO[bytes]) -> Floats:
    """Write the finite points of a cloud to a file and map them."""
    try:
        for piece in finite_pieces(cloud, _PIECE):
            stream.write(np.ascontiguousarray(piece).data)
        stream.flush()
    except OSError as error:
        raise UserError(
            f"clouds cannot be kept on disk: {error.strerror or error}",
            where=tempfile.gettempdir(),
            expected="24 bytes of room for each point of both clouds",
            fix="make room, or set TMPDIR (TEMP on Windows) to another folder",
        ) from error
    shape = (stream.tell() // 24, 3)
    return np.memmap(stream, np.float64, "r", shape=shape) if shape[0] else np.zeros(shape)


def mutual_distances(
    first: Floats,
    second: Floats,
    *,
    jobs: int,
    block_points: int | None = None,
    progress: Progress = silent,
) -> tuple[Floats, Floats]:
    """Return the distance of each point to the nearest of the other cloud: (N,) and (M,).

    The clouds (N, 3) and (M, 3) may be mapped from disk; they are cut into slabs where either has
    more than `block_points`.
    """
    clouds = first, second
    for points in clouds:
        if points.ndim != 2 or points.shape[1] != 3:
            raise ValueError(f"points of shape {points.shape}, expected (N, 3)")
        if not all(np.isfinite(part).all() for part in _chunks(points)):
            raise ValueError("points that are not finite")
    found = np.full(len(first), np.inf), np.full(len(second), np.inf)
    if not len(first) or not len(second):
        return found
    slabs = _cut(clouds, block_points or max(map(len, clouds)))
    # The first search, of a few points from all over, bounds all distances.
    steps = [(0, slab) for slab in slabs[1]] + [(1, slab) for slab in slabs[0]]
    for here, slab in progress(steps, "distances", len(steps)):
        _lower(found[here], clouds[here], slabs[here], clouds[1 - here], slab, jobs)
    return np.sqrt(found[0], out=found[0]), np.sqrt(found[1], out=found[1])


def _chunks(rows: NDArray[np.generic]) -> Iterator[NDArray[np.generic]]:
    return (rows[start : start + _CHUNK] for start in range(0, len(rows), _CHUNK))


# --- slabs ---


@dataclass(frozen=True, eq=False)
class _Slab:
    """Rows of a cloud along a Morton curve, and the smallest box that holds their points."""

    rows: Ints
    low: Floats
    high: Floats

    @classmethod
    def along_curve(cls, points: Floats, rows: Ints | None = None) -> _Slab:
        """Sort all points, or those of some rows."""
        own = points if rows is None else points[rows]
        order = morton_order(own)
        return cls(order if rows is None else rows[order], np.min(own, axis=0), np.max(own, axis=0))


def _cut(clouds: tuple[Floats, Floats], block_points: int) -> list[list[_Slab]]:
    """Cut clouds across their longest axis into slabs of about `block_points` of both.

    Before the slabs of a cloud stands a sample of it: what is near to it bounds all distances.
    """
    if max(map(len, clouds)) <= block_points:
        return [[_Slab.along_curve(points)] for points in clouds]
    steps = [max(1, len(points) // _SAMPLE) for points in clouds]
    sample = np.concatenate([points[::step] for points, step in zip(clouds, steps, strict=True)])
    low, high = np.quantile(sample, (0.05, 0.95), axis=0)
    axis = int(np.argmax(high - low))
    count = min(-(-sum(map(len, clouds)) // block_points), _MOST_SLABS)
    borders = np.quantile(sample[:, axis], np.arange(1, count) / count)
    slabs = []
    for points, step in zip(clouds, steps, strict=True):
        numbers = np.searchsorted(borders, points[:, axis], side="right").astype(np.uint16)
        order = np.argsort(numbers, kind="stable")  # by radix, which 16 bits allow
        parts = np.split(order, np.cumsum(np.bincount(numbers, minlength=count))[:-1])
        parts = [np.arange(0, len(points), step), *(part for part in parts if len(part))]
        slabs.append([_Slab.along_curve(points, part) for part in parts])
    return slabs


def _lower(
    squared: Floats, points: Floats, homes: list[_Slab], others: Floats, slab: _Slab, jobs: int
) -> None:
    """Lower the squared distances (N,) of points to what they are to a slab of the other cloud."""
    search = NeighbourSearch(others.take(slab.rows, axis=0))
    for home in homes[1:] or homes:
        bound = _gap_squared(home.low, home.high, slab.low, slab.high)
        if not bound < squared[home.rows].max():
            continue
        for rows in _chunks(home.rows):
            part = points[rows]
            if len(homes) > 1:
                reached = bound_squared(part, slab.low, slab.high) < squared[rows]
                rows, part = rows[reached], part[reached]
            if len(rows):
                squared[rows] = np.minimum(squared[rows], search.squared(part, jobs=jobs))


def bound_squared(points: Floats, low: Floats, high: Floats) -> Floats:
    """Return lower bounds (...) of squared distances from points (..., 3) to all in a box.

    None is above such a distance, not even by a rounding: subtraction, multiplication and addition
    of floating-point numbers are monotone, and a bound takes the steps of a distance.
    """
    return _gap_squared(points, points, low, high)


def _gap_squared(low: Floats, high: Floats, others_low: Floats, others_high: Floats) -> Floats:
    gap = np.maximum(np.maximum(others_low - high, low - others_high), 0.0)
    return _squared_length(gap)


def _squared_length(offsets: Floats) -> Floats:
    with np.errstate(over="ignore", under="ignore"):
        x, y, z = np.moveaxis(offsets, -1, 0)
        total: Floats = (x * x + y * y) + z * z
    return total


# --- the search ---


class NeighbourSearch:
    """A search for the nearest of points (M, 3): at least one, finite, best in Morton order."""

    def __init__(self, points: Floats) -> None:
        # Copies are neighbours along the curve; no tree can part many of one point.
        is_new = np.concatenate(([True], (points[1:] != points[:-1]).any(axis=1)))
        self._points = points if is_new.all() else points[is_new]
        self._tree = kdtree.KDTree(self._points, leafsize=_LEAF)

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

    @cached_property
    def _balls(self) -> KDTree:
        return KDTree(self._points)


@contextmanager
def _openmp_threads(jobs: int) -> Iterator[None]:
    """Limit the threads of pykdtree, which has no argument for them and takes all.

    Where it is built without OpenMP, or hides it (Windows), nothing is limited.
    """
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


# --- order ---


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
