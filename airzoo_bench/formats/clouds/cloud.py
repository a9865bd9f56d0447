"""Point clouds: what every reader yields and every step takes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import FIX_COPY, PredictionError, counted
from airzoo_bench.geometry.arrays import Floats

_CONFIDENCE = ("confidence", "conf")
_STORED_POINTS = 1 << 20


@dataclass(frozen=True, eq=False)
class Cloud:
    """N points in memory, in the scene's units; readers leave colours out."""

    points: Floats  # (N, 3) float64
    colours: NDArray[np.uint8] | None = None  # (N, 3)
    confidence: NDArray[np.float32] | None = None  # (N,)

    def __len__(self) -> int:
        return len(self.points)


class CloudSource(Protocol):
    """A cloud that is read in pieces, as often as asked, always in the same order."""

    @property
    def count(self) -> int:
        """How many points it holds, those with NaN included."""

    def pieces(self, points: int) -> Iterator[Cloud]:
        """Yield all points, at most that many at a time."""


@dataclass(frozen=True, eq=False)
class FileCloud:
    """A cloud in a file, or sampled on a mesh in a file: a `CloudSource`."""

    path: Path
    kind: str  # for results, such as "PLY (binary)"
    count: int  # points with NaN included
    read: Callable[[int], Iterator[Cloud]]  # yields all points, at most that many at a time
    precision: np.dtype[Any]  # that the coordinates are stored in
    notes: tuple[str, ...] = ()  # on how it was read

    def pieces(self, points: int) -> Iterator[Cloud]:
        """Yield all points, at most that many at a time."""
        return self.read(points)

    def stored(self, folder: Path) -> FileCloud:
        """Return the cloud with its points in plain files of a folder."""
        points = np.lib.format.open_memmap(folder / "points.npy", "w+", np.float64, (self.count, 3))
        confidence, done = None, 0
        for piece in self.pieces(_STORED_POINTS):
            part = slice(done, done + len(piece))
            done += len(piece)
            if done > self.count:
                break
            points[part] = piece.points
            if piece.confidence is not None:
                if confidence is None:
                    confidence = np.lib.format.open_memmap(
                        folder / "confidence.npy", "w+", np.float32, (self.count,)
                    )
                confidence[part] = piece.confidence
        if done != self.count:
            raise refusal(self.path, f"holds {done:,} points, not {self.count:,}")
        return replace(self, read=ArrayPieces(points, confidence))


@dataclass(frozen=True, eq=False)
class ArrayPieces:
    """Reads a cloud from arrays, which may be mapped: points (N, 3) and confidence (N,)."""

    points: NDArray[Any]
    confidence: NDArray[Any] | None = None

    def __call__(self, size: int) -> Iterator[Cloud]:
        """Yield all points, at most `size` at a time."""
        for start in range(0, len(self.points), size):
            part = slice(start, start + size)
            trust = None if self.confidence is None else _as_confidence(self.confidence[part])
            yield Cloud(np.array(self.points[part], np.float64), None, trust)


def cloud_of_columns(columns: Mapping[str, NDArray[Any]]) -> Cloud:
    """Make a cloud of columns (N,) by name: x, y, z, and perhaps confidence."""
    points = np.empty((len(columns["x"]), 3))
    for axis, name in enumerate("xyz"):
        points[:, axis] = columns[name]
    found = next((columns[name] for name in _CONFIDENCE if name in columns), None)
    return Cloud(points, None, None if found is None else _as_confidence(found))


def _as_confidence(column: NDArray[Any]) -> NDArray[np.float32]:
    """Turn a column (N,) into float32; what is too large for it becomes infinite."""
    with np.errstate(over="ignore", invalid="ignore"):
        return column.astype(np.float32)


def refusal(
    path: Path, what: str, *, expected: str | None = None, fix: str | None = None
) -> PredictionError:
    """Make the error of a file."""
    return PredictionError(what, where=path, expected=expected, fix=fix)


def too_few(path: Path, count: int) -> PredictionError:
    """Make the error of a file that ends before the points that its header counts."""
    return refusal(
        path,
        f"its header promises {counted(count, 'point')}, and the file holds fewer",
        expected="all points that the header promises",
        fix=FIX_COPY,
    )


def uncounted(left: int, what: str, count: int) -> tuple[str, ...]:
    """Say that more follows the points than the header of a file counts, if it does."""
    if left <= 0:
        return ()
    return (f"{left:,} {what} follow the {count:,} points that its header promises: not read",)


def read_records(
    path: Path, record: np.dtype[Any], start: int, count: int, size: int
) -> Iterator[NDArray[Any]]:
    """Yield records from a byte of a file on, at most `size` at a time."""
    with path.open("rb", buffering=0) as stream:
        stream.seek(start)
        for done in range(0, count, size):
            block = np.fromfile(stream, record, min(size, count - done))
            if len(block) < min(size, count - done):
                raise too_few(path, count)
            yield block
