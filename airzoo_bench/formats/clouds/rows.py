"""Rows of points in files: lines of numbers, or records of a type."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import FIX_COPY, PredictionError, counted
from airzoo_bench.formats.clouds.cloud import Cloud, FileCloud, cloud_of_columns, refusal
from airzoo_bench.geometry.arrays import Floats

_SHOWN = 60


@dataclass(frozen=True)
class Rows:
    """Rows of columns that `record` names: records, or lines where `is_text`.

    The records begin at the byte `start`; lines begin `skip` lines behind it. A column may have
    several numbers, of which the first counts.
    """

    path: Path
    record: np.dtype[Any]
    count: int
    start: int
    is_text: bool = False
    skip: int = 0
    separator: str = ""

    def open(self, kind: str, notes: tuple[str, ...] = (), *, are_last: bool = True) -> FileCloud:
        """Return the rows as a cloud, once they are known to be there."""
        if self.is_text:
            left, what = count_lines(self.path, self.start) - self.skip - self.count, "lines"
        else:
            end = self.start + self.count * self.record.itemsize
            left, what = self.path.stat().st_size - end, "bytes"
        if left < 0:
            raise too_few(self.path, self.count)
        notes += uncounted(left if are_last else 0, what, self.count)
        precision = np.result_type(*(self.record[axis].base for axis in "xyz"))
        return FileCloud(self.path, kind, self.count, self.pieces, precision, notes)

    def pieces(self, points: int) -> Iterator[Cloud]:
        """Yield all points, at most that many at a time."""
        names = self.record.names or ()
        if not self.is_text:
            with self.path.open("rb", buffering=0) as stream:
                stream.seek(self.start)
                for done in range(0, self.count, points):
                    block = np.fromfile(stream, self.record, min(points, self.count - done))
                    if len(block) < min(points, self.count - done):
                        raise too_few(self.path, self.count)
                    yield cloud_of_columns({name: _first(block[name]) for name in names})
            return
        sizes = [int(np.prod(self.record[name].shape)) for name in names]
        places = np.cumsum([0, *sizes]).tolist()
        for lines in self._lines(points, places[-1]):
            # Text of a float property may have more digits than float32: all are kept.
            yield cloud_of_columns({n: lines[:, p] for n, p in zip(names, places, strict=False)})

    def _lines(self, size: int, width: int) -> Iterator[Floats]:
        with opened_lines(self.path, self.start) as lines:
            rest = islice(lines, self.skip, None)
            for done in range(0, self.count, size):
                some = list(islice(rest, min(size, self.count - done)))
                if len(some) < min(size, self.count - done):
                    raise too_few(self.path, self.count)
                yield read_lines(self.path, some, self.separator, width)


def _first(column: NDArray[Any]) -> NDArray[Any]:
    return column if column.ndim == 1 else column[:, 0]


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


@contextmanager
def opened_lines(path: Path, offset: int = 0) -> Iterator[Iterator[str]]:
    """Open a text file at a byte, as its lines that are not blank."""
    with path.open("rb") as stream:
        stream.seek(offset)
        lines = io.TextIOWrapper(stream, encoding="latin-1")
        yield (line for line in lines if not line.isspace())


def count_lines(path: Path, offset: int) -> int:
    """Count the lines behind a byte that are not blank."""
    with path.open("rb") as stream:
        stream.seek(offset)
        return sum(not line.isspace() for line in stream)


def read_lines(path: Path, lines: list[str], separator: str, width: int) -> Floats:
    """Return lines as rows of numbers, or name the first that is none."""
    numbers = [line.replace(separator, " ") for line in lines] if separator else lines
    try:
        rows = np.loadtxt(numbers, np.float64, comments=None, ndmin=2)
        if rows.shape != (len(lines), width):
            raise ValueError("rows of another width")
    except ValueError as error:
        raise _wrong_row(path, lines, separator, width) from error
    return rows


def _wrong_row(path: Path, lines: list[str], separator: str, width: int) -> PredictionError:
    """Name the first line that is not as many numbers as it should be."""
    words = (line.replace(separator or " ", " ").split() for line in lines)
    sound = (len(row) == width and all(map(is_number, row)) for row in words)
    wrong = next((line for line, is_sound in zip(lines, sound, strict=False) if not is_sound), "")
    with path.open(encoding="latin-1") as stream:
        number = next((place for place, line in enumerate(stream, 1) if line == wrong), 0)
    return refusal(path, f"line {number:,} is {quoted(wrong)}", expected=f"{width} numbers")


def is_number(word: str) -> bool:
    """Tell whether a word is a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def quoted(line: str) -> str:
    """Return a line as it may stand in a message: short, and only characters that print."""
    return repr(line.strip()[:_SHOWN])
