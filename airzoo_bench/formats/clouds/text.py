"""Clouds as text: a point a line, in ``.xyz``, ``.txt``, ``.csv``, ``.asc`` and ``.pts`` files.

There is no standard. Separators are blanks, commas or semicolons; there may be comments, a line
with the number of points (``.pts``) and a line of names before the points. Notes say which columns
were taken; a file that could mean two things is refused.
"""

from __future__ import annotations

import re
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import FIX_COPY, counted
from airzoo_bench.formats.clouds.cloud import FileCloud, refusal
from airzoo_bench.formats.clouds.rows import (
    Rows,
    count_lines,
    is_number,
    opened_lines,
    quoted,
    read_lines,
)

_SAMPLE = 1000
_MOST_PREAMBLE = 1000
_LONGEST_LINE = 1 << 16
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


def open_text(path: Path) -> FileCloud:
    """Open a cloud in a text file."""
    offset, names, promised = _find_start(path)
    count = count_lines(path, offset)
    if promised is not None and count != promised:
        what = f"says that it holds {counted(promised, 'point')}, and holds {count:,}"
        raise refusal(path, what, expected="as many lines as its first line says", fix=FIX_COPY)
    separator, width = _find_separator(path, offset)
    places = _find_columns(path, names, width)
    columns = {place: name for name, place in places.items()}
    record = np.dtype([(columns.get(place, f"_{place}"), "f8") for place in range(width)])
    kind = f"text (separated by {_SEPARATORS[separator]})"
    note = "columns, counted from 1: x y z from " + ", ".join(str(places[a] + 1) for a in "xyz")
    if "confidence" in places:
        note += f"; confidence from {places['confidence'] + 1}"
    if width > len(places):
        note += f"; {width - len(places)} of {width} passed over"
    return Rows(path, record, count, offset, True, separator=separator).open(kind, (note,))


def _find_start(path: Path) -> tuple[int, str | None, int | None]:
    """Return the byte of the first point, and the names and the count in the lines before."""
    names, promised = None, None
    with path.open("rb") as stream:
        offset = stream.seek(len(_BOM) if stream.read(len(_BOM)) == _BOM else 0)
        for line in islice(iter(partial(stream.readline, _LONGEST_LINE), b""), _MOST_PREAMBLE):
            text = line.decode("latin-1").strip()
            words = re.split(r"[\s,;]+", text.strip(" \t,;"))
            is_count = len(words) == 1 and text.isascii() and text.isdigit()
            if text and all(map(is_number, words)) and not (is_count and promised is None):
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
    """Return the separator of columns, and their number."""
    with opened_lines(path, offset) as lines:
        first = list(islice(lines, _SAMPLE))
    if not first:
        return "", 3
    separator = next((one for one in (";", ",") if one in first[0]), "")
    for line in first:  # 1,5 2,5 3,5 and 1,5;2,5;3,5 would be read as twice as many columns
        words = re.split(r"[\s;]+", line.strip())
        if len(words) > 1 and any(_NUMBER_WITH_COMMA.fullmatch(word) for word in words):
            fix = "export it with decimal points"
            raise refusal(path, f"a line has decimal commas: {quoted(line)}", fix=fix)
    width = len(first[0].replace(separator or " ", " ").split())
    if width < 3:
        raise refusal(path, f"a line has {width} columns: {quoted(first[0])}", expected=_EXPECTED)
    read_lines(path, first, separator, width)
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
        fix="name the columns, or leave the names out where x y z are first",
    )
