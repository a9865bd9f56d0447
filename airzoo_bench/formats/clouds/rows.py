"""Rows of points in files: records of PLY, and PCD and text files whole.

PCD is the format of the Point Cloud Library: ascii, binary and binary_compressed.

Text (``.xyz``, ``.txt``, ``.csv``, ``.asc``, ``.pts``) has no standard. Separators are blanks,
commas or semicolons; there may be comments, a line with the number of points (``.pts``) and a line
of names before the points. Notes say which columns were taken; a file that could mean two things
is refused.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.core.errors import FIX_COPY, PredictionError, counted, readable
from airzoo_bench.formats.clouds.cloud import Cloud, FileCloud, cloud_of_columns, refusal
from airzoo_bench.geometry.arrays import Floats

_SHOWN = 60
_PCD_KINDS = ("ascii", "binary", "binary_compressed")
_PCD_SIZES = {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}
_LITERAL = 32  # control bytes below it are of bytes to be copied
_LONG = 7  # a length that goes on in the next byte
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
        notes += check_left(self.path, self.count, left if are_last else min(left, 0), what)
        precision = np.result_type(*(self.record[axis].base for axis in "xyz"))
        return FileCloud(self.path, kind, self.count, self.pieces, precision, notes)

    def pieces(self, points: int) -> Iterator[Cloud]:
        """Yield all points, at most that many at a time."""
        blocks = self._lines(points) if self.is_text else self._records(points)
        for done, columns in zip(range(0, self.count, points), blocks, strict=True):
            if len(columns["x"]) < min(points, self.count - done):
                raise too_few_points(self.path, self.count)
            yield cloud_of_columns(columns)

    def _records(self, points: int) -> Iterator[dict[str, Any]]:
        with self.path.open("rb", buffering=0) as stream:
            stream.seek(self.start)
            for done in range(0, self.count, points):
                block = np.fromfile(stream, self.record, min(points, self.count - done))
                columns = {name: block[name] for name in self.record.names or ()}
                yield {n: c if c.ndim == 1 else c[:, 0] for n, c in columns.items()}

    def _lines(self, points: int) -> Iterator[dict[str, Floats]]:
        names = self.record.names or ()
        places = np.cumsum([0, *(int(np.prod(self.record[name].shape)) for name in names)]).tolist()
        with open_lines(self.path, self.start) as lines:
            rest = islice(lines, self.skip, None)
            for done in range(0, self.count, points):
                some = list(islice(rest, min(points, self.count - done)))
                # Text of a float property may have more digits than float32: all are kept.
                block = read_lines(self.path, some, self.separator, places[-1])
                yield {n: block[:, p] for n, p in zip(names, places, strict=False)}


def check_left(path: Path, count: int, left: int, what: str) -> tuple[str, ...]:
    """Refuse a file that ends before its points do; say so where more follows."""
    if left < 0:
        raise too_few_points(path, count)
    more = f"{left:,} {what} follow the {count:,} points that its header promises: not read"
    return (more,) if left else ()


def too_few_points(path: Path, count: int) -> PredictionError:
    """Make the error of a file that ends before the points that its header counts."""
    what = f"its header promises {counted(count, 'point')}, and the file holds fewer"
    return refusal(path, what, expected="all points that the header promises", fix=FIX_COPY)


@contextmanager
def open_lines(path: Path, offset: int = 0) -> Iterator[Iterator[str]]:
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
    if not lines:
        return np.empty((0, width))
    try:
        rows = np.loadtxt(numbers, np.float64, comments=None, ndmin=2)
        if rows.shape != (len(lines), width):
            raise ValueError("rows of another width")
    except ValueError as error:
        words = (line.split() for line in numbers)
        sound = (len(row) == width and all(map(is_number, row)) for row in words)
        pairs = zip(lines, sound, strict=True)
        wrong = next((line for line, is_sound in pairs if not is_sound), "")
        with path.open(encoding="latin-1") as stream:
            number = next((place for place, line in enumerate(stream, 1) if line == wrong), 0)
        what = f"line {number:,} is {quoted(wrong)}"
        raise refusal(path, what, expected=f"{width} numbers") from error
    return rows


def is_number(word: str) -> bool:
    """Tell whether a word is a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def quoted(line: str) -> str:
    """Return a line for a message: short, and only characters that print."""
    return repr(line.strip()[:_SHOWN])


# --- text ---


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
    with open_lines(path, offset) as lines:
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


# --- PCD ---


def open_pcd(path: Path) -> FileCloud:
    """Open a PCD file."""
    rows, data = _read_pcd_header(path)
    if not {*"xyz"} <= {*(rows.record.names or ())}:
        raise refusal(path, "its FIELDS lack x, y or z", expected="FIELDS x y z, and others")
    kind = f"PCD ({data})"
    if data != "binary_compressed":
        return rows.open(kind)
    with path.open("rb") as stream:
        stream.seek(rows.start)
        packed, plain = np.frombuffer(stream.read(8).ljust(8, b"\0"), "<u4").tolist()
    whole = path.stat().st_size >= rows.start + 8 + packed
    if plain != rows.count * rows.record.itemsize or not whole:
        raise too_few_points(path, rows.count)
    precision = np.result_type(*(rows.record[axis].base for axis in "xyz"))
    read = partial(_read_compressed, rows, packed, plain)
    return FileCloud(path, kind, rows.count, read, precision)


def _read_pcd_header(path: Path) -> tuple[Rows, str]:
    """Return the rows, and how they are stored."""
    values: dict[str, list[str]] = {}
    with path.open("rb") as stream:
        while "DATA" not in values and stream.tell() < _LONGEST_LINE:
            line = stream.readline(_LONGEST_LINE)
            words = line.decode("latin-1").split()
            if not line:
                break
            if words and not words[0].startswith("#"):
                values.setdefault(words[0].upper(), words[1:])
        start = stream.tell()
    expected = "FIELDS, SIZE, TYPE, COUNT, WIDTH, HEIGHT, POINTS and DATA that fit together"
    with readable(path, "the PCD header is wrong", expected=expected):
        (data,), (points,) = values["DATA"], map(int, values["POINTS"])
        width = int(values.get("WIDTH", [str(points)])[0])
        height = int(values.get("HEIGHT", ["1"])[0])
        if data not in _PCD_KINDS or not width * height == points >= 0:
            raise ValueError(f"{points:,} points, {width:,} x {height:,}, as {quoted(data)}")
        names = values["FIELDS"]
        repeats = list(map(int, values.get("COUNT", ["1"] * len(names))))
        fields: list[tuple[str, str, tuple[int]]] = []
        rows = zip(names, map(int, values["SIZE"]), values["TYPE"], repeats, strict=True)
        for number, (name, item, kind, count) in enumerate(rows):
            if item not in _PCD_SIZES.get(kind.upper(), ()) or count < 1:
                raise ValueError(f"field {name} of type {kind}, {item} bytes, {count} times")
            known = name if name != "_" else f"_ {number}"  # several fields may be padding
            fields.append((known, f"<{kind.lower()}{item}", (count,)))
        return Rows(path, np.dtype(fields), points, start, data == "ascii"), data


def _read_compressed(rows: Rows, packed: int, plain: int, points: int) -> Iterator[Cloud]:
    with readable(rows.path, "its compressed points are damaged"), rows.path.open("rb") as stream:
        stream.seek(rows.start + 8)
        body = unpack_lzf(stream.read(packed), plain)
    columns, place = {}, 0
    for name in rows.record.names or ():  # a column after the other
        columns[name] = np.frombuffer(body, rows.record[name], rows.count, place)[:, 0]
        place += rows.count * rows.record[name].itemsize
    for done in range(0, rows.count, points):
        part = slice(done, done + points)
        yield cloud_of_columns({name: column[part] for name, column in columns.items()})


def unpack_lzf(data: bytes, size: int) -> bytearray:
    """Undo Marc Lehmann's LZF."""
    out, place = bytearray(), 0
    while place < len(data) and len(out) <= size:
        control = data[place]
        place += 1
        if control < _LITERAL:
            out += data[place : place + control + 1]
            place += control + 1
            continue
        length = control >> 5
        if length == _LONG:
            length += data[place]
            place += 1
        distance = ((control & 0x1F) << 8 | data[place]) + 1
        place += 1
        start = len(out) - distance
        if start < 0:
            raise ValueError("a copy from before the beginning")
        piece = out[start : start + length + 2]
        # A copy may reach into what it writes; the piece then repeats itself.
        out += (piece * math.ceil((length + 2) / distance))[: length + 2]
    if place != len(data) or len(out) != size:
        raise ValueError("more or less than its header states")
    return out
