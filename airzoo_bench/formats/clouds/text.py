"""Clouds as text: a point a line, in ``.xyz``, ``.txt``, ``.csv``, ``.asc`` and ``.pts`` files.

There is no standard. Separators are blanks, commas or semicolons; there may be comments, a line
with the number of points (``.pts``) and a line of names before the points. What is taken to be
what stands in the notes; what could be two things is refused.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from airzoo_bench.core.errors import PredictionError, counted
from airzoo_bench.formats.clouds.cloud import (
    FIX_COPY,
    Cloud,
    FileCloud,
    cloud_of_columns,
    refusal,
    too_few,
)
from airzoo_bench.geometry.arrays import Floats

__all__ = ["count_lines", "open_text", "opened_lines", "read_rows", "shown"]

_SAMPLE = 1000
_MOST_PREAMBLE = 1000
_LONGEST_LINE = 1 << 16
_SHOWN = 60
_COMMENTS = ("#", "//", ";")
_BOM = b"\xef\xbb\xbf"
_SEPARATORS = {"": "blanks", ",": "commas", ";": "semicolons"}
_IN_BRACKETS = re.compile(r"\[[^]]*\]|\([^)]*\)")
_NUMBER_WITH_COMMA = re.compile(r"[-+]?\d+,\d+")
_NAMED = {
    "x": ("x", "easting"),
    "y": ("y", "northing"),
    "z": ("z", "height", "elevation", "altitude"),
    "confidence": ("confidence", "conf"),
}
_EXPECTED = "a line a point: x y z and more numbers, the same number in each line"


class _Start(NamedTuple):
    """Where the points begin, and what the lines before say."""

    offset: int
    names: str | None
    promised: int | None


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


def read_rows(
    path: Path, offset: int, skip: int, count: int, width: int, size: int, separator: str = ""
) -> Iterator[Floats]:
    """Yield rows of numbers, at most `size` at a time.

    They begin `skip` lines behind a byte, and are `count` in all, each of `width` numbers.
    """
    with opened_lines(path, offset) as lines:
        rest = islice(lines, skip, None)
        for done in range(0, count, size):
            some = list(islice(rest, min(size, count - done)))
            if len(some) < min(size, count - done):
                raise too_few(path, count)
            numbers = [line.replace(separator, " ") for line in some] if separator else some
            try:
                rows = np.loadtxt(numbers, np.float64, comments=None, ndmin=2)
                if rows.shape != (len(some), width):
                    raise ValueError("rows of another width")
            except ValueError as error:
                raise _wrong_row(path, some, separator, width) from error
            yield rows


def _wrong_row(path: Path, lines: list[str], separator: str, width: int) -> PredictionError:
    """Name the first line that is not as many numbers as it should be."""
    wrong = lines[0]
    for line in lines:
        words = line.replace(separator or " ", " ").split()
        if len(words) != width or not all(map(_is_number, words)):
            wrong = line
            break
    with path.open(encoding="latin-1") as stream:
        number = next((place for place, line in enumerate(stream, 1) if line == wrong), 0)
    return refusal(path, f"line {number:,} is {shown(wrong)}", expected=f"{width} numbers")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def shown(line: str) -> str:
    """Return a line as it may stand in a message: short, and only characters that print."""
    return repr(line.strip()[:_SHOWN])


def open_text(path: Path) -> FileCloud:
    """Open a cloud in a text file."""
    start = _find_start(path)
    count = count_lines(path, start.offset)
    if start.promised is not None and count != start.promised:
        raise refusal(
            path,
            f"says that it holds {counted(start.promised, 'point')}, and holds {count:,}",
            expected="as many lines as its first line says",
            fix=FIX_COPY,
        )
    separator, sample = _sample(path, start.offset, min(count, _SAMPLE))
    places = _find_columns(path, start.names, sample.shape[1])
    kind = f"text (separated by {_SEPARATORS[separator]})"
    read = partial(_read, path, start.offset, separator, places, sample.shape[1], count)
    note = _columns_note(places, sample.shape[1])
    return FileCloud(path, kind, count, read, np.dtype(np.float64), (note,))


def _read(
    path: Path,
    offset: int,
    separator: str,
    places: dict[str, int],
    width: int,
    count: int,
    points: int,
) -> Iterator[Cloud]:
    for rows in read_rows(path, offset, 0, count, width, points, separator):
        yield cloud_of_columns({name: rows[:, place] for name, place in places.items()})


def _find_start(path: Path) -> _Start:
    """Step over comments, a count and a line of names."""
    names, promised = None, None
    with path.open("rb") as stream:
        offset = stream.seek(len(_BOM) if stream.read(len(_BOM)) == _BOM else 0)
        for line in islice(iter(partial(stream.readline, _LONGEST_LINE), b""), _MOST_PREAMBLE):
            text = line.decode("latin-1").strip()
            if text and _is_points(text, promised):
                return _Start(offset, names, promised)
            if text.isascii() and text.isdigit():
                promised = int(text)
            else:
                names = text or names
            offset = stream.tell()
    if promised == 0:
        return _Start(offset, names, promised)
    raise refusal(path, "holds no line with a point", expected=_EXPECTED)


def _is_points(text: str, promised: int | None) -> bool:
    """Say whether a line holds numbers only; one whole number is a count, where none was before."""
    words = re.split(r"[\s,;]+", text.strip(" \t,;"))
    if len(words) == 1 and promised is None and words[0].isdigit():
        return False
    return all(map(_is_number, words))


def _sample(path: Path, offset: int, count: int) -> tuple[str, Floats]:
    """Return the separator and the first rows."""
    if not count:
        return "", np.empty((0, 3))
    with opened_lines(path, offset) as lines:
        first = list(islice(lines, count))
    separator = next((one for one in (";", ",") if one in first[0]), "")
    for line in first:
        _refuse_decimal_commas(path, line)
    width = len(first[0].replace(separator or " ", " ").split())
    if width < 3:
        raise refusal(path, f"a line has {width} columns: {shown(first[0])}", expected=_EXPECTED)
    (rows,) = read_rows(path, offset, 0, count, width, count, separator)
    return separator, rows


def _refuse_decimal_commas(path: Path, line: str) -> None:
    """Refuse ``1,5 2,5 3,5`` and ``1,5;2,5;3,5``, which would be read as twice as many columns."""
    words = re.split(r"[\s;]+", line.strip())
    if len(words) > 1 and any(_NUMBER_WITH_COMMA.fullmatch(word) for word in words):
        raise refusal(
            path,
            f"a line has decimal commas: {shown(line)}",
            expected="decimal points",
            fix="export it with decimal points",
        )


def _find_columns(path: Path, header: str | None, width: int) -> dict[str, int]:
    """Return the places of x, y, z and confidence, by a line of names where it fits."""
    first = dict(zip("xyz", range(3), strict=True))
    if header is None:
        return first
    words = re.split(r"[\s,;]+", _IN_BRACKETS.sub("", header).strip("#/;, \t"))
    names = [word.strip("\"'").lower() for word in words]
    if len(names) != width:
        return first
    known = {
        name: next((names.index(one) for one in some if one in names), None)
        for name, some in _NAMED.items()
    }
    found = {name: place for name, place in known.items() if place is not None}
    if {*"xyz"} <= found.keys():
        return found
    if header.startswith(_COMMENTS):
        return first
    raise refusal(
        path,
        f"its columns are {shown(header)}, and none is called x, y or z",
        expected="columns x, y and z (or easting, northing, height), in metres",
        fix="name the columns, or leave the names out where x y z stand first",
    )


def _columns_note(places: dict[str, int], width: int) -> str:
    """Say which columns were read, counted from 1."""
    said = "x y z from " + ", ".join(str(places[axis] + 1) for axis in "xyz")
    if "confidence" in places:
        said += f"; confidence from {places['confidence'] + 1}"
    left = width - len(places)
    passed = f"; {left} of {width} passed over" if left else ""
    return f"columns, counted from 1: {said}{passed}"
