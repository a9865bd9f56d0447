"""Clouds as text: a point a line, in ``.xyz``, ``.txt``, ``.csv``, ``.asc`` and ``.pts`` files.

There is no standard. Separators are blanks, commas or semicolons; there may be comments, a line
with the number of points (``.pts``) and a line of names before the points. What is taken to be
what stands in the notes; what could be two things is refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import PredictionError, counted
from airzoo_bench.formats.clouds.cloud import FIX_COPY, Cloud, FileCloud, refusal
from airzoo_bench.formats.clouds.columns import Columns, columns_by_name
from airzoo_bench.formats.clouds.text_rows import lines_beyond, opened_text, parse_rows, shown
from airzoo_bench.geometry.arrays import Floats

__all__ = ["looks_like_text", "open_text"]

_SAMPLE = 1000
_MOST_COLUMNS = 64
_MOST_PREAMBLE = 1000
_LONGEST_LINE = 1 << 16
_COMMENTS = ("#", "//", ";")
_BOM = b"\xef\xbb\xbf"
_SEPARATORS = {"": "blanks", ",": "commas", ";": "semicolons"}
_IN_BRACKETS = re.compile(r"\[[^]]*\]|\([^)]*\)")
_UNIT = 1e-3
_NUMBER_WITH_COMMA = re.compile(r"[-+]?\d+,\d+")
_EXPECTED = "a line a point: x y z and more numbers, the same number in each line"


@dataclass(frozen=True)
class _Start:
    """Where the points begin, and what the lines before say."""

    offset: int
    lines: int
    names: str | None
    promised: int | None


def looks_like_text(head: bytes) -> bool:
    """Say whether the first bytes of a file are of a text with numbers."""
    return b"\0" not in head and re.search(rb"\d", head) is not None and head[:1] not in b"<{["


def open_text(path: Path) -> FileCloud:
    """Open a cloud in a text file."""
    start = _find_start(path)
    count = lines_beyond(path, start.offset, 0)
    if start.promised is not None and count != start.promised:
        raise refusal(
            path,
            f"says that it holds {counted(start.promised, 'point')}, and holds {count:,}",
            expected="as many lines as its first line says",
            fix=FIX_COPY,
        )
    separator, sample = _sample(path, start, min(count, _SAMPLE))
    columns = _columns(path, start, sample)
    kind = f"text (separated by {_SEPARATORS[separator]})"
    read = partial(_read, path, start, separator, columns, count)
    return FileCloud(path, kind, count, read, np.dtype(np.float64), (columns.note(),))


def _find_start(path: Path) -> _Start:
    """Step over comments, a count and a line of names."""
    names, promised, number = None, None, 0
    with path.open("rb") as stream:
        offset = stream.seek(len(_BOM) if stream.read(len(_BOM)) == _BOM else 0)
        for line in iter(partial(stream.readline, _LONGEST_LINE), b""):
            text = line.decode("latin-1").strip()
            if number > _MOST_PREAMBLE or (text and _is_points(text, promised)):
                return _Start(offset, number, names, promised)
            if text.isascii() and text.isdigit() and len(text) < 19:
                promised = int(text)
            else:
                names = text or names
            offset, number = stream.tell(), number + 1
    if promised == 0:
        return _Start(offset, number, names, promised)
    raise refusal(path, "holds no line with a point", expected=_EXPECTED)


def _is_points(text: str, promised: int | None) -> bool:
    """Say whether a line holds numbers only; one whole number is a count, where none was before."""
    words = re.split(r"[\s,;]+", text.strip(" \t,;"))
    if len(words) == 1 and promised is None and words[0].isdigit():
        return False
    return all(_is_number(word) for word in words)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _sample(path: Path, start: _Start, count: int) -> tuple[str, Floats]:
    """Return the separator and the first rows."""
    if not count:
        return "", np.empty((0, 3))
    with opened_text(path, start.offset, start.lines) as text:
        lines, _ = text.take(count, count, "points")
    separator = next((one for one in (";", ",") if one in lines[0]), "")
    _refuse_decimal_commas(path, lines, separator, start.lines + 1)
    width = len(lines[0].replace(separator or " ", " ").split())
    if not 3 <= width <= _MOST_COLUMNS:
        raise refusal(
            path,
            f"line {start.lines + 1} has {counted(width, 'column')}: {shown(lines[0])}",
            expected=_EXPECTED,
        )
    with opened_text(path, start.offset, start.lines) as text:
        return separator, parse_rows(text, count, width, count, "points", separator)


def _refuse_decimal_commas(path: Path, lines: list[str], separator: str, first: int) -> None:
    """Refuse ``1,5 2,5 3,5``, ``1,5;2,5;3,5``, and ``1,5,2,05,3,5``, where digits give it away."""
    for number, line in enumerate(lines, start=first):
        words = line.strip().split(separator if separator == ";" else None)
        with_comma = [_NUMBER_WITH_COMMA.fullmatch(word.strip()) for word in words]
        digits = line.strip().split(",") if separator == "," and "." not in line else []
        if (len(words) > 1 and any(with_comma)) or any(re.match(r"0\d", word) for word in digits):
            raise refusal(
                path,
                f"line {number} has decimal commas: {shown(line)}",
                expected="decimal points",
                fix="export it with decimal points",
            )


def _columns(path: Path, start: _Start, sample: Floats) -> Columns:
    _refuse_poses(path, sample)
    given = _IN_BRACKETS.sub("", start.names or "").strip("#/;, \t")
    names = [name.strip("\"'") for name in re.split(r"[\s,;]+", given)]
    if start.names is not None and len(names) == sample.shape[1]:
        found = columns_by_name(names)
        if found is None and not start.names.startswith(_COMMENTS):
            raise refusal(
                path,
                f"its columns are {shown(start.names)}, and none is called x, y or z",
                expected="columns x, y and z (or easting, northing, height), in metres",
                fix="name the columns, or leave the names out where x y z stand first",
            )
        if found is not None:
            return found
    return Columns(sample.shape[1])


def _refuse_poses(path: Path, sample: Floats) -> None:
    """Refuse lines of number, place and unit quaternion, and 3 x 4 matrices: both are cameras."""
    quaternions = matrices = False
    if sample.shape[1] == 8 and len(sample) > 1:
        quaternions = bool((np.diff(sample[:, 0]) >= 0).all()) and any(
            bool((np.abs(np.linalg.norm(sample[:, first : first + 4], axis=1) - 1) < _UNIT).all())
            for first in (1, 4)
        )
    if sample.shape[1] in (12, 13, 16):
        first = sample.shape[1] == 13
        rows = sample[:, first : first + 12].reshape(-1, 3, 4)[:, :, :3]
        products = rows @ rows.transpose(0, 2, 1)
        matrices = bool((np.abs(products - np.eye(3)) < _UNIT).all())
    if quaternions or matrices:
        raise _poses(path, "quaternions" if quaternions else "rotation matrices")


def _poses(path: Path, what: str) -> PredictionError:
    return refusal(
        path,
        f"its lines look like camera poses: they hold {what}",
        expected="points",
        fix="give the cloud; cameras stand beside it in SCENE.cameras.npz",
    )


def _read(
    path: Path, start: _Start, separator: str, columns: Columns, count: int, points: int
) -> Iterator[Cloud]:
    with opened_text(path, start.offset, start.lines) as text:
        for done in range(0, count, points):
            number = min(points, count - done)
            yield columns.cloud(parse_rows(text, number, columns.width, count, "points", separator))
