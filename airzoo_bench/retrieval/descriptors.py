"""Descriptors: rows of files that need not fit into memory, and how similar they are.

Larger is more similar: q.g for `inner_product`, the same of normalised vectors for `cosine`, and
-|q - g|^2 / 2 for `l2`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.formats.arrays import as_floating
from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.retrieval.settings import Metric as Metric  # other rooms import it from here

Names = Sequence[object] | NDArray[Any]

_WINDOW = 1024  # rows that are read as one where some of them are needed
_BLOCK_BYTES = 1 << 26
_UNIT = 2.0**-53  # roundoff of float64
_FEW = 64  # rows at a time in float64
_LAMBDA = 10.0
_PIECE = 4096  # BLAS splits a longer dot product over threads, which changes its last digits
_LEAST_SQUARE = 1e-25  # below, squares summed in float32 have lost digits to underflow
_MOST_NORM = 1e18  # beyond, products overflow in float32
_FAULTS = (
    ("NaN or infinite descriptors", "finite numbers"),
    ("descriptors too large to rank", "norms up to 1e18"),
    ("descriptors of zero", "a direction, to take its cosine"),
)


@dataclass(frozen=True)
class _FileRows:
    """Rows that lie one after the other in a file."""

    path: Path
    offset: int
    dtype: np.dtype[Any]
    shape: tuple[int, int]

    def read(self, start: int, stop: int, buffer: NDArray[np.uint8] | None) -> NDArray[Any]:
        """Read rows that follow each other, into a buffer if there is one."""
        row_bytes = self.shape[1] * self.dtype.itemsize
        size = (stop - start) * row_bytes
        data = np.empty(size, np.uint8) if buffer is None else buffer[:size]
        with self.path.open("rb", buffering=0) as file:
            file.seek(self.offset + start * row_bytes)
            if file.readinto(data.data) < size:
                raise PredictionError("the file ends before its descriptors", where=self.path)
        return data.view(self.dtype).reshape(-1, self.shape[1])


@dataclass(frozen=True, eq=False)
class Rows:
    """Descriptors (n, D) of floating-point numbers, in memory or in files, read some at a time."""

    parts: tuple[NDArray[Any] | _FileRows, ...]  # whose rows from `start` to `stop` are meant
    dtype: np.dtype[Any]
    start: int
    stop: int

    @classmethod
    def join(cls, *arrays: NDArray[Any]) -> Rows:
        """Join arrays, which may be mapped; whole numbers are read as floating point."""
        types = [as_floating(np.empty(0, array.dtype)).dtype for array in arrays]
        return cls(arrays, np.result_type(*types), 0, sum(map(len, arrays)))

    def located(self) -> Rows:
        """Return the same, where parts that are memory maps are read by plain reads.

        Pages of a map count as memory of the process until the kernel takes them back, and a map
        is sent to other processes as a whole.
        """
        return replace(self, parts=tuple(map(_located, self.parts)))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and dimensions."""
        return self.stop - self.start, self.parts[0].shape[1]

    @property
    def in_files(self) -> bool:
        """Whether no row is held in memory."""
        return all(isinstance(part, _FileRows) for part in self.parts)

    def __len__(self) -> int:
        return self.stop - self.start

    def part(self, start: int, stop: int) -> Rows:
        """Return some of the rows, which are not read yet."""
        return replace(self, start=self.start + start, stop=self.start + stop)

    def read(self, start: int, stop: int, buffer: NDArray[np.uint8] | None = None) -> NDArray[Any]:
        """Read rows that follow each other; `buffer` is for those of a file."""
        low, high = self.start + start, min(self.start + stop, self.stop)
        found: list[NDArray[Any]] = [np.empty((0, self.shape[1]), self.dtype)]
        for part in self.parts:
            first, last = max(low, 0), min(high, part.shape[0])
            if first < last:
                own = buffer if last - first == high - low else None
                rows = (
                    part.read(first, last, own) if isinstance(part, _FileRows) else part[first:last]
                )
                found.append(as_floating(rows))
            low, high = low - part.shape[0], high - part.shape[0]
        rows = found[-1] if len(found) <= 2 else np.concatenate(found)
        return rows.astype(self.dtype, copy=False)

    def blocks(self, memory_bytes: int = 8 * _BLOCK_BYTES) -> Iterator[tuple[int, NDArray[Any]]]:
        """Yield (first row, rows) in order, valid until the next; that is read meanwhile."""
        step = self.block(memory_bytes)
        size = step * self.shape[1] * self.dtype.itemsize
        buffers = [np.empty(size, np.uint8) if self.in_files else None for _ in range(2)]
        with ThreadPoolExecutor(1) as reader:
            ahead = reader.submit(self.read, 0, step, buffers[0])
            for turn, start in enumerate(range(0, len(self), step), 1):
                rows = ahead.result()
                ahead = reader.submit(self.read, start + step, start + 2 * step, buffers[turn % 2])
                yield start, rows

    def block(self, memory_bytes: int) -> int:
        """Return how many rows `blocks` reads at a time."""
        row_bytes = max(1, self.shape[1] * max(self.dtype.itemsize, 4))
        return int(np.clip(min(_BLOCK_BYTES, memory_bytes // 8) // row_bytes, 1, 4096))

    def take(self, rows: Ints) -> NDArray[Any]:
        """Read rows into memory, in the order of their numbers."""
        found = np.empty((len(rows), self.shape[1]), self.dtype)
        for group in in_windows(rows, _WINDOW):
            first = int(rows[group[0]])
            found[group] = self.read(first, int(rows[group[-1]]) + 1)[rows[group] - first]
        return found


def _located(array: NDArray[Any] | _FileRows) -> NDArray[Any] | _FileRows:
    """Return where in which file the rows of a memory map lie; others as they are."""
    if not isinstance(array, np.memmap) or not array.flags.c_contiguous:
        return array
    if array.mode == "c" or not array.filename:  # it may differ from its file
        return array
    root: Any = array
    while isinstance(root.base, np.memmap):
        root = root.base
    # A view inherits the offset of its map, not its own.
    offset = int(root.offset) + array.ctypes.data - root.ctypes.data
    return _FileRows(Path(str(root.filename)), offset, array.dtype, (len(array), array.shape[1]))


def in_windows(rows: Ints, width: int) -> list[Ints]:
    """Group the places of rows, in ascending order of row, by windows of `width` rows."""
    order = np.argsort(rows, kind="stable")
    firsts = np.flatnonzero(np.diff(rows[order] // width)) + 1
    return np.split(order, firsts) if len(rows) else []


def as_float32(rows: NDArray[Any]) -> NDArray[np.float32]:
    """Round rows to float32; too large a number becomes infinite."""
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        return np.ascontiguousarray(rows, dtype=np.float32)


def similarity(queries: Floats, gallery: Floats, metric: Metric) -> tuple[Floats, Floats]:
    """Return similarities of pairs, (n, D) and (n, D), and bounds of their errors.

    The order in which they are summed depends on D alone.
    """
    error = gamma(queries.shape[1], _UNIT)
    if metric == "l2":
        apart = queries - gallery
        found = -_dot(apart, apart) / 2
        return found, error * np.abs(found)
    if metric == "cosine":
        found = _dot(normalised(queries), normalised(gallery))
        return found, np.full(len(found), 2 * error)
    bound = error * np.sqrt(_dot(queries, queries) * _dot(gallery, gallery))
    return _dot(queries, gallery), bound


def gamma(n: int, unit: float) -> float:
    """Return the relative error of a sum of n products, and of a few roundings around it."""
    grown = _LAMBDA * np.sqrt(n) * unit + n * unit**2 / (1 - unit)
    return float(np.expm1(grown)) + 8 * unit


def _dot(a: Floats, b: Floats) -> Floats:
    total = np.zeros(len(a))
    for start in range(0, a.shape[1], _PIECE):
        total += np.vecdot(a[:, start : start + _PIECE], b[:, start : start + _PIECE])
    return total


def normalised(rows: NDArray[Any]) -> Floats:
    """Divide rows by their norms."""
    scaled, _ = _scaled(rows)
    return np.asarray(scaled / np.sqrt(_dot(scaled, scaled))[:, None])


def _scaled(rows: NDArray[Any]) -> tuple[Floats, Ints]:
    """Divide rows by powers of two, which is exact, so that their squares do not underflow."""
    with np.errstate(invalid="ignore", over="ignore"):  # what is not finite is refused elsewhere
        double = rows.astype(np.float64)
        _, exponents = np.frexp(np.abs(double).max(axis=1, initial=0.0))
        return np.ldexp(double, -exponents[:, None]), exponents


def norms_of(rows: NDArray[Any], single: NDArray[np.float32]) -> Floats:
    """Return norms, nearly; infinite or NaN where a number is, or where float32 overflows."""
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        squares = np.vecdot(single, single).astype(np.float64)
    norms: Floats = np.sqrt(squares)
    small = np.flatnonzero(squares < _LEAST_SQUARE)
    norms[small] = exact_norms(rows[small])
    return norms


def exact_norms(rows: NDArray[Any]) -> Floats:
    """Return Euclidean norms in float64."""
    scaled, exponents = _scaled(rows)
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused elsewhere
        return np.asarray(np.ldexp(np.sqrt(_dot(scaled, scaled)), exponents))


def faults_of(rows: NDArray[Any], norms: Floats, metric: Metric) -> NDArray[np.int8]:
    """Return for each row which of `_FAULTS` it has, counted from 1; 0 where it can be ranked."""
    faults = np.where(norms <= _MOST_NORM, 0, 2).astype(np.int8)  # also tells NaN
    wild = np.flatnonzero(faults)
    faults[wild[~np.isfinite(rows[wild]).all(axis=1)]] = 1
    if metric == "cosine":
        faults[norms == 0] = 3
    return faults


def refuse_faults(faults: NDArray[np.int8], field: str, names: Names | None) -> None:
    """Refuse descriptors that have faults, by the names of their rows."""
    for number, (what, expected) in enumerate(_FAULTS, 1):
        rows = np.flatnonzero(faults == number).tolist()
        if rows:
            named = [f"row {row}" if names is None else names[row] for row in rows]
            raise PredictionError(
                f"{what}: {first_of(named, len(faults))}",
                where=f"field '{field}'",
                expected=expected,
                fix="export them again, and look for a division by zero or half precision",
            )


def check_descriptors(rows: Rows, field: str, metric: Metric, names: Names | None = None) -> None:
    """Refuse descriptors that cannot be ranked."""
    parts = [faults_of(some, norms_of(some, as_float32(some)), metric) for _, some in rows.blocks()]
    refuse_faults(np.concatenate(parts), field, names)


def points_one_way(rows: Rows, metric: Metric) -> bool:
    """Return whether all rows are equal, or under cosine multiples of one vector up to rounding.

    No ranking of such a gallery means anything.
    """
    first: Floats | None = None
    stored, lost = np.finfo(rows.dtype), np.zeros((1, 1))
    for start in range(0, len(rows), _FEW):
        some = rows.read(start, start + _FEW)
        with np.errstate(all="ignore"):  # what is not finite is near nothing, and refused elsewhere
            deciding = normalised(some) if metric == "cosine" else some.astype(np.float64)
            first = deciding[:1] if first is None else first
            if metric == "cosine":  # how far storage may have turned a row
                largest = np.abs(some).max(axis=1, keepdims=True).astype(np.float64)
                lost = 4 * float(stored.eps) * np.abs(first)
                lost = lost + 2 * float(stored.smallest_subnormal) / largest
            if not (np.abs(deciding - first) <= lost).all():
                return False
    return len(rows) > 1
