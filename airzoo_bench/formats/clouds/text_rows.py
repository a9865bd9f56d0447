"""Rows of numbers in text files, in blocks, with the line of every mistake."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.formats.clouds.cloud import FIX_COPY, refusal
from airzoo_bench.geometry.arrays import Floats

__all__ = ["TextLines", "lines_beyond", "opened_text", "parse_rows", "shown"]

_LONGEST_LINE = 1 << 20
_SHOWN = 60


class TextLines:
    """Lines of a text file that are not blank, one by one, and the number of the last."""

    def __init__(self, stream: io.TextIOWrapper, path: Path, number: int) -> None:
        self.path = path
        self.number = number
        self._stream = stream

    def next(self) -> str | None:
        """Return the next line that is not blank, None at the end of the file."""
        while True:
            line = self._stream.readline(_LONGEST_LINE)
            self.number += 1
            if len(line) >= _LONGEST_LINE:
                raise self.error("is endless", f"lines below {_LONGEST_LINE:,} characters")
            if not line:
                return None
            if not line.isspace():
                return line

    def take(self, count: int, of: int, what: str) -> tuple[list[str], list[int]]:
        """Return a number of lines with their line numbers, or say how many there are."""
        lines, numbers = [], []
        for _ in range(count):
            line = self.next()
            if line is None:
                raise refusal(
                    self.path,
                    f"the file ends at line {self.number - 1}",
                    expected=f"{of:,} {what}, as its header says",
                    fix=FIX_COPY,
                )
            lines.append(line)
            numbers.append(self.number)
        return lines, numbers

    def error(self, what: str, expected: str, number: int | None = None) -> PredictionError:
        """Make the error of a line, the last one read unless told."""
        line = self.number if number is None else number
        return refusal(self.path, f"line {line} {what}", expected=expected)

    def wrong(self, line: str, expected: str, number: int | None = None) -> PredictionError:
        """Make the error of a line that holds something else."""
        return self.error(f"is {shown(line)}", expected, number)


@contextmanager
def opened_text(path: Path, offset: int = 0, line: int = 0) -> Iterator[TextLines]:
    """Open a text file at a byte, which begins the line after the one numbered `line`."""
    with path.open("rb") as stream:
        stream.seek(offset)
        yield TextLines(io.TextIOWrapper(stream, encoding="latin-1"), path, line)


def lines_beyond(path: Path, offset: int, count: int) -> int:
    """Return how many lines that are not blank follow the first `count` behind a byte."""
    lines, rest = 0, b""
    with path.open("rb") as stream:
        stream.seek(offset)
        while block := stream.read(_LONGEST_LINE):
            *whole, rest = (rest + block).split(b"\n")
            lines += sum(not line.isspace() and bool(line) for line in whole)
            rest = rest[-_SHOWN:]
    return lines + bool(rest.strip()) - count


def parse_rows(
    text: TextLines, count: int, columns: int, of: int, what: str, separator: str = ""
) -> Floats:
    """Read a number of rows, each of a number of columns."""
    lines, numbers = text.take(count, of, what)
    if not lines:
        return np.empty((0, columns))
    if separator:
        lines = [line.replace(separator, " ") for line in lines]
    try:
        rows = np.loadtxt(lines, np.float64, comments=None, ndmin=2)
    except ValueError as error:
        raise _wrong_line(text, lines, numbers, columns) from error
    if rows.shape != (count, columns):
        raise _wrong_line(text, lines, numbers, columns)
    return np.asarray(rows, np.float64)


def _wrong_line(
    text: TextLines, lines: list[str], numbers: list[int], columns: int
) -> PredictionError:
    for line, number in zip(lines, numbers, strict=True):
        if not _is_row(line, columns):
            return text.wrong(line, f"{columns} numbers", number)
    return text.error("or one before it cannot be read", f"{columns} numbers")


def _is_row(line: str, columns: int) -> bool:
    words = line.split()
    try:
        return len([float(word) for word in words]) == columns
    except ValueError:
        return False


def shown(line: str) -> str:
    """Return a line as it may stand in a message: short, and only characters that print."""
    return repr(line.strip()[:_SHOWN])
