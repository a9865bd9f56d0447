"""Clouds as text: a point a line, in ``.xyz``, ``.txt``, ``.csv``, ``.asc`` and ``.pts`` files.

There is no standard. Separators are blanks, commas or semicolons; there may be comments, a line
with the number of points (``.pts``) and a line of names before the points. Notes say what was
taken to be what; what could be two things is refused.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import FIX_COPY, PredictionError, counted
from airzoo_bench.formats.clouds.cloud import (
    Cloud,
    FileCloud,
    cloud_of_columns,
    refusal,
    too_few,
)
from airzoo_bench.geometry.arrays import Floats

_SAMPLE = 1000
_MOST_PREAMBLE = 1000
_LONGEST_LINE = 1 << 16
_SHOWN = 60
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
    words = (line.replace(separator or " ", " ").split() for line in lines)
    sound = (len(row) == width and all(map(_is_number, row)) for row in words)
    wrong = next((line for line, is_sound in zip(lines, sound, strict=False) if not is_sound), "")
    with path.open(encoding="latin-1") as stream:
        number = next((place for place, line in enumerate(stream, 1) if line == wrong), 0)
    return refusal(path, f"line {number:,} is {quoted(wrong)}", expected=f"{width} numbers")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def quoted(line: str) -> str:
    """Return a line as it may stand in a message: short, and only characters that print."""
    return repr(line.strip()[:_SHOWN])


def open_text(path: Path) -> FileCloud:
    """Open a cloud in a text file."""
    offset, names, promised = _find_start(path)
    count = count_lines(path, offset)
    if promised is not None and count != promised:
        raise refusal(
            path,
            f"says that it holds {counted(promised, 'point')}, and holds {count:,}",
            expected="as many lines as its first line says",
            fix=FIX_COPY,
        )
    separator, width = _find_separator(path, offset)
    places = _find_columns(path, names, width)

    def read(points: int) -> Iterator[Cloud]:
        for rows in read_rows(path, offset, 0, count, width, points, separator):
            yield cloud_of_columns({name: rows[:, place] for name, place in places.items()})

    kind = f"text (separated by {_SEPARATORS[separator]})"
    note = "columns, counted from 1: x y z from " + ", ".join(str(places[a] + 1) for a in "xyz")
    if "confidence" in places:
        note += f"; confidence from {places['confidence'] + 1}"
    if width > len(places):
        note += f"; {width - len(places)} of {width} passed over"
    return FileCloud(path, kind, count, read, np.dtype(np.float64), (note,))


def _find_start(path: Path) -> tuple[int, str | None, int | None]:
    """Return the byte of the first point, and the names and the count in the lines before."""
    names, promised = None, None
    with path.open("rb") as stream:
        offset = stream.seek(len(_BOM) if stream.read(len(_BOM)) == _BOM else 0)
        for line in islice(iter(partial(stream.readline, _LONGEST_LINE), b""), _MOST_PREAMBLE):
            text = line.decode("latin-1").strip()
            words = re.split(r"[\s,;]+", text.strip(" \t,;"))
            is_count = len(words) == 1 and text.isascii() and text.isdigit()
            if text and all(map(_is_number, words)) and not (is_count and promised is None):
                return offset, names, promised
            if is_count:
                promised = int(text)
            else:
                names = text or names
            offset = stream.tell()
    if promised == 0:
        return offset, names, promised
    raise refusal(path, "holds no line with a point", expected=_EXPECTED)


def _find_separator(path: Path, offset: int) -> tuple[str, int]:
    """Return what separates columns, and their number."""
    with opened_lines(path, offset) as lines:
        first = list(islice(lines, _SAMPLE))
    if not first:
        return "", 3
    separator = next((one for one in (";", ",") if one in first[0]), "")
    for line in first:  # 1,5 2,5 3,5 and 1,5;2,5;3,5 would be read as twice as many columns
        words = re.split(r"[\s;]+", line.strip())
        if len(words) > 1 and any(_NUMBER_WITH_COMMA.fullmatch(word) for word in words):
            raise refusal(
                path,
                f"a line has decimal commas: {quoted(line)}",
                expected="decimal points",
                fix="export it with decimal points",
            )
    width = len(first[0].replace(separator or " ", " ").split())
    if width < 3:
        raise refusal(path, f"a line has {width} columns: {quoted(first[0])}", expected=_EXPECTED)
    next(read_rows(path, offset, 0, len(first), width, len(first), separator))
    return separator, width


def _find_columns(path: Path, header: str | None, width: int) -> dict[str, int]:
    """Return the places of x, y, z and confidence, by a line of names where it fits."""
    first = {"x": 0, "y": 1, "z": 2}
    words = re.split(r"[\s,;]+", _IN_BRACKETS.sub("", header or "").strip("#/;, \t"))
    names = [word.strip("\"'").lower() for word in words]
    if header is None or len(names) != width:
        return first
    found = {
        name: next(names.index(one) for one in some if one in names)
        for name, some in _NAMED.items()
        if {*some} & {*names}
    }
    if {*"xyz"} <= found.keys():
        return found
    if header.startswith(("#", "//", ";")):
        return first
    raise refusal(
        path,
        f"its columns are {quoted(header)}, and none is called x, y or z",
        expected="columns x, y and z (or easting, northing, height), in metres",
        fix="name the columns, or leave the names out where x y z stand first",
    )
