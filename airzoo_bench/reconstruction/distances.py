"""Exact distances from every point of a cloud to the nearest one of another, both ways.

A distance is ``sqrt((dx^2 + dy^2) + dz^2)`` in float64, each step rounded once, and the nearest
neighbour's is the least of all: what trying all pairs gives, to the last bit, for any order of the
points, number of threads and cutting into slabs.

pykdtree searches. It prunes by bounds with rounding errors, so that of two neighbours that are
equally far but for the last bits it may return either. So it is asked for two: where the second is
farther by more than the bounds can err, the first is the nearest. Where it is not, more are asked
for, and where these do not decide either, all points in a ball just as large.

Points are sorted along a Morton curve (Morton, A computer oriented geodetic data base and a new
technique in file sequencing, IBM, 1966), which makes neighbours in space neighbours in memory.

Clouds that exceed memory are written to disk in slabs, cut across the axis along which they are
longest. A slab's points are compared with the other cloud's points of the same slab, which bounds
their distances, and then with each slab that lies nearer than these bounds.
"""

from __future__ import annotations

import ctypes
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, cached_property, partial
from itertools import pairwise
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray
from pykdtree import kdtree
from scipy.spatial import KDTree

from airzoo_bench.core.errors import BenchmarkError, UserError
from airzoo_bench.core.files import temporary_folder
from airzoo_bench.core.progress import Progress, shown, silent
from airzoo_bench.formats.clouds.cloud import CloudSource
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.reconstruction.clouds import concatenated, finite_pieces

_LEAF = 16
_CHUNK, _SORTING_CHUNK = 1 << 17, 1 << 15
# A bound gathers less than 8 roundings (2^-53 each) a level of the tree; this covers more than
# 1,000 levels. A level halves a side of a box, so that no cloud whose coordinates differ by less
# than a hundred orders of magnitude has as many.
_SLACK = 1e-12
_LEAST = 1e-290  # roundings are not relative among denormal numbers
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
_PIECE = 1 << 18
_MOST_SLABS = 1 << 12
_BYTES_ON_DISK = 48  # of a point: as it came, and by slabs


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
    """Measure clouds both ways: in memory up to `block_points` each, else on disk."""
    if max(prediction.count, truth.count) > block_points:
        return block_distances(
            prediction, truth, block_points=block_points, jobs=jobs, progress=progress
        )
    clouds = [concatenated(finite_pieces(cloud, block_points)) for cloud in (prediction, truth)]
    _require_truth(clouds[1])
    measure = partial(mutual_distances, *clouds, jobs=jobs)
    return CloudDistances(*shown(measure, "distances", progress))


def _require_truth(points: Floats) -> None:
    if not len(points):
        raise BenchmarkError(
            "the true cloud holds no finite point",
            expected="at least one point, after cropping too",
            fix="check the benchmark's cloud and the protocol's crop",
        )


def mutual_distances(first: Floats, second: Floats, *, jobs: int) -> tuple[Floats, Floats]:
    """Return the distance of each point to the nearest of the other cloud: (N,) and (M,)."""
    clouds = first, second
    for points in clouds:
        if points.ndim != 2 or points.shape[1] != 3:
            raise ValueError(f"points of shape {points.shape}, expected (N, 3)")
        if not all(np.isfinite(part).all() for part in _chunks(points)):
            raise ValueError("points that are not finite")
    if not len(first) or not len(second):
        return np.full(len(first), np.inf), np.full(len(second), np.inf)
    orders = morton_order(first), morton_order(second)
    found = []
    for here, there in ((0, 1), (1, 0)):
        search = NeighbourSearch(gather(clouds[there], orders[there]))
        distances = np.empty(len(clouds[here]))
        for rows in _chunks(orders[here]):
            distances[rows] = search.squared(clouds[here][rows], jobs=jobs)
        found.append(np.sqrt(distances, out=distances))
    return found[0], found[1]


def _chunks(rows: NDArray[np.generic]) -> Iterator[NDArray[np.generic]]:
    return (rows[start : start + _CHUNK] for start in range(0, len(rows), _CHUNK))


class NeighbourSearch:
    """A search for the nearest of points (M, 3): at least one, finite, best in Morton order."""

    def __init__(self, points: Floats) -> None:
        self._points = _without_copies(points)
        self._tree = kdtree.KDTree(self._points, leafsize=_LEAF)

    def squared(self, points: Floats, *, jobs: int) -> Floats:
        """Return the squared distance (N,) of each of points (N, 3) to the nearest."""
        found = np.empty(len(points))
        with _openmp_threads(jobs):
            for start in range(0, len(points), _CHUNK):
                part = points[start : start + _CHUNK]
                squared, unsure = self._ask(part, 2)
                rows = np.flatnonzero(unsure)
                if len(rows):
                    squared[rows] = self._resolve_ties(part[rows])
                found[start : start + _CHUNK] = squared
        return found

    def _resolve_ties(self, points: Floats) -> Floats:
        squared, unsure = self._ask(points, _MORE)
        for row in np.flatnonzero(unsure):
            radius = _BALL * np.sqrt(max(squared[row], _LEAST))
            near = self._points[self._balls.query_ball_point(points[row], radius)]
            squared[row] = _squared_distance(points[row], near).min(initial=squared[row])
        return squared

    def _ask(self, points: Floats, count: int) -> tuple[Floats, Bools]:
        """Return the least squared distance to some points, and whether another may be less."""
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


def _core(points: Floats) -> tuple[Floats, Floats]:
    """Return the median of points, and the width of most of them, by axis."""
    if not len(points):
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


def gather(points: Floats, order: Ints) -> Floats:
    """Return ``points[order]``, contiguous, whatever the layout of `points`."""
    picked = np.empty((len(order), points.shape[1]))
    for start in range(0, len(order), _SORTING_CHUNK):
        picked[start : start + _SORTING_CHUNK] = points[order[start : start + _SORTING_CHUNK]]
    return picked


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


# --- clouds that exceed memory ---


def block_distances(
    prediction: CloudSource,
    truth: CloudSource,
    *,
    block_points: int,
    jobs: int,
    progress: Progress = silent,
) -> CloudDistances:
    """Measure clouds on disk, with the distances and slabs of `block_points` in memory."""
    with temporary_folder(Path(tempfile.gettempdir()), "airzoo-clouds") as folder:
        names = (folder / "prediction", folder / "truth")
        spilled = [_spill(*pair) for pair in zip((prediction, truth), names, strict=True)]
        _require_truth(spilled[1])
        if not len(spilled[0]):
            return CloudDistances(np.zeros(0), np.full(len(spilled[1]), np.inf))
        axis, cuts = _cuts(spilled, block_points)
        sides = [_Slabs.write(*pair, axis, cuts) for pair in zip(spilled, names, strict=True)]
        found = []
        for side, others in (sides, reversed(sides)):
            distances = np.empty(len(side.order))
            distances[side.order] = np.sqrt(_slab_distances(side, others, jobs, progress))
            found.append(distances)
    return CloudDistances(found[0], found[1])


def _spill(cloud: CloudSource, path: Path) -> Floats:
    """Write the finite points of a cloud to disk as they come, and map them."""
    raw = path.with_suffix(".raw")
    with raw.open("wb") as stream:
        for piece in finite_pieces(cloud, _PIECE):
            _write(stream, piece)
        count = stream.tell() // 24
    return np.memmap(raw, np.float64, "r", shape=(count, 3)) if count else np.zeros((0, 3))


def _write(stream: IO[bytes], points: Floats) -> None:
    try:
        stream.write(np.ascontiguousarray(points).data)
        stream.flush()
    except OSError as error:
        raise UserError(
            f"clouds cannot be kept on disk: {error.strerror or error}",
            where=tempfile.gettempdir(),
            expected=f"{_BYTES_ON_DISK} bytes of room for each point of both clouds",
            fix="make room, or set TMPDIR (TEMP on Windows) to another folder",
        ) from error


def _cuts(clouds: list[Floats], slab_points: int) -> tuple[int, Floats]:
    """Return an axis, and the cuts across it between slabs of about `slab_points` points."""
    sample = np.concatenate([points[:: max(1, len(points) // _SAMPLE)] for points in clouds])
    low, high = np.quantile(sample, (0.05, 0.95), axis=0)
    axis = int(np.argmax(high - low))
    slabs = min(-(-sum(map(len, clouds)) // slab_points), _MOST_SLABS)
    return axis, np.quantile(sample[:, axis], np.arange(1, slabs) / slabs)


@dataclass(frozen=True, eq=False)
class _Slabs:
    """A cloud of N points on disk in S slabs, each along a Morton curve.

    `order` has the row in the source of each point, `starts` (S + 1,) where a slab begins, `low`
    and `high` (S, 3) its smallest box; an empty slab has none.
    """

    points: Floats
    order: Ints
    starts: Ints
    low: Floats
    high: Floats

    @classmethod
    def write(cls, source: Floats, path: Path, axis: int, cuts: Floats) -> _Slabs:
        """Write a cloud to disk by its slabs."""
        slabs = np.searchsorted(cuts, source[:, axis], side="right").astype(np.uint16)
        order = np.argsort(slabs, kind="stable")  # by radix, which 16 bits allow
        counts = np.bincount(slabs, minlength=len(cuts) + 1)
        starts = np.concatenate(([0], np.cumsum(counts)))
        low, high = np.full((len(counts), 3), np.inf), np.full((len(counts), 3), -np.inf)
        with path.open("wb") as stream:
            for slab, (first, stop) in enumerate(pairwise(starts)):
                own = source[order[first:stop]]
                curve = morton_order(own)
                order[first:stop] = order[first:stop][curve]
                low[slab] = own.min(axis=0, initial=np.inf)
                high[slab] = own.max(axis=0, initial=-np.inf)
                _write(stream, own[curve])
        points = np.memmap(path, np.float64, "r", shape=(len(order), 3))
        return cls(points, order, starts, low, high)

    def rows(self, slab: int) -> slice:
        """Return where the points of a slab lie."""
        return slice(int(self.starts[slab]), int(self.starts[slab + 1]))

    def search(self, slab: int) -> NeighbourSearch | None:
        """Return a search among the points of a slab, or None where it has none."""
        points = np.array(self.points[self.rows(slab)])
        return NeighbourSearch(points) if len(points) else None


def _slab_distances(side: _Slabs, others: _Slabs, jobs: int, progress: Progress) -> Floats:
    """Return the squared distance (N,) of each point on disk to the nearest of the other cloud."""
    squared = np.empty(len(side.order))
    count = len(side.starts) - 1
    some = NeighbourSearch(np.array(others.points[:: max(1, len(others.points) // _SAMPLE)]))
    for slab in progress(range(count), "slabs", count):
        rows, nearby = side.rows(slab), others.search(slab) or some
        squared[rows] = nearby.squared(np.array(side.points[rows]), jobs=jobs)
    for slab in progress(range(count), "beyond slabs", count):
        box = others.low[slab], others.high[slab]
        search: NeighbourSearch | None = None
        for home in range(count):
            rows = side.rows(home)
            bound = _gap_squared(side.low[home], side.high[home], *box)
            if home == slab or not bound < squared[rows].max(initial=0.0):
                continue
            points, own = np.array(side.points[rows]), squared[rows]
            reached = np.flatnonzero(bound_squared(points, *box) < own)
            if len(reached):
                search = search or others.search(slab) or some
                nearer = search.squared(points[reached], jobs=jobs)
                own[reached] = np.minimum(own[reached], nearer)
    return squared


def bound_squared(points: Floats, low: Floats, high: Floats) -> Floats:
    """Return lower bounds (...) of squared distances from points (..., 3) to all in a box.

    None is above such a distance, not even by a rounding: subtraction, multiplication and addition
    of floating-point numbers are monotone, and a bound takes the steps of a distance.
    """
    return _gap_squared(points, points, low, high)


def _gap_squared(low: Floats, high: Floats, others_low: Floats, others_high: Floats) -> Floats:
    gap = np.maximum(np.maximum(others_low - high, low - others_high), 0.0)
    with np.errstate(over="ignore", under="ignore"):
        x, y, z = np.moveaxis(gap, -1, 0)
        total: Floats = (x * x + y * y) + z * z
    return total
