"""Tables as other programs and benchmarks write them: columns by name, checked numbers."""

from __future__ import annotations

import csv
import math
import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import BenchmarkError, counted, first_of, readable
from airzoo_bench.core.validation import nearest
from airzoo_bench.geometry.arrays import Floats

_LIMIT_BYTES = 64 << 20
_HEADER_LINES = 20  # within which the line that names the columns is looked for


def read_native_text(path: Path) -> str:
    """Read a text in UTF-8, with or without a byte-order mark, or in GB18030."""
    fix = "save it as a text in UTF-8, or download it again"
    with readable(path, "no table as text", kind=BenchmarkError, fix=fix):
        if path.stat().st_size > _LIMIT_BYTES:
            raise ValueError(f"more than {_LIMIT_BYTES:,} bytes")
        content = path.read_bytes()
        if b"\0" in content:
            raise ValueError("it holds bytes of zero")
        with suppress(UnicodeDecodeError):
            return content.decode("utf-8-sig")
        return content.decode("gb18030")


@dataclass(frozen=True, eq=False)
class Table:
    """Texts by our names of columns; a row has its line in the file, counted from 1.

    `header` is what the file calls each column that is there, `names` are all of its columns.
    """

    path: Path
    header: Mapping[str, str]
    names: Sequence[str]
    by_name: Mapping[str, tuple[str, ...]]
    lines: Sequence[int]

    def __len__(self) -> int:
        return len(self.lines)

    def has(self, *columns: str) -> bool:
        """Return whether all these columns are there."""
        return set(columns) <= set(self.header)

    def texts(self, column: str) -> tuple[str, ...]:
        """Return the values of a column unchanged."""
        return self.by_name[column]

    def numbers(
        self, column: str, least: float = -math.inf, most: float = math.inf, *, empty: bool = False
    ) -> Floats:
        """Return the values of a column as numbers; NaN for empty cells, where these may be."""
        values = [_number(text) for text in self.texts(column)]
        for text, value, line in zip(self.texts(column), values, self.lines, strict=True):
            if not (least <= value <= most and math.isfinite(value)) and (text or not empty):
                raise BenchmarkError(
                    f"column {self.header[column]}: {text[:40]!r}",
                    where=f"{self.path}, line {line}",
                    expected=f"a number from {least:g} to {most:g}, with a decimal point",
                )
        return np.array(values, dtype=np.float64)

    def columns(self, names: Sequence[str], least: float = -1e9, most: float = 1e9) -> Floats:
        """Return several columns of numbers side by side."""
        return np.stack([self.numbers(name, least, most) for name in names], axis=1)

    def require_unique(self, column: str) -> None:
        """Refuse a value that two rows have."""
        counts = Counter(self.texts(column))
        twice = [value for value, count in counts.items() if count > 1]
        if twice:
            raise BenchmarkError(
                f"column {self.header[column]}: several rows have {first_of(map(repr, twice))}",
                where=self.path,
                expected="each once",
            )


def plain(name: str) -> str:
    """Return a column's name without case, units in brackets, blanks, '_', '-', '.' and '#'."""
    return re.sub(r"\[.*?\]|\(.*?\)|[\s_.#\"\ufeff-]", "", name.casefold())


def read_table(
    path: Path,
    columns: Mapping[str, Iterable[str]],
    optional: Collection[str] = (),
    *,
    blanks: bool = False,
) -> Table:
    """Read a table; its first lines name the columns.

    `columns` are the names that the file may have for each of ours, of which those in `optional`
    may be missing. Raise BenchmarkError with the line or the column.
    """
    lines = read_native_text(path).splitlines()
    known = {plain(name): ours for ours, names in columns.items() for name in names}
    separators = (",", ";", "\t", None) if blanks else (",", ";", "\t")
    place, separator, names = max(
        _headers(lines, separators),
        key=lambda found: len({known.get(plain(name)) for name in found[2]} - {None}),
        default=(0, ",", []),
    )
    given = [(known[plain(name)], name) for name in names if plain(name) in known]
    header = dict(given)
    missing = [ours for ours in columns if ours not in header and ours not in optional]
    if missing or len(header) < len(given):
        unknown = [name for name in names if name and plain(name) not in known]
        listed = ", ".join(f"{ours}{nearest(ours, unknown)}" for ours in missing)
        has = ", ".join(map(repr, names))[:300]
        what = f"lacks the columns {listed}, or has two columns of one meaning; it has {has}"
        expected = ", ".join("/".join(called) for ours, called in columns.items())
        raise BenchmarkError(what, where=path, expected=f"a first line with each of {expected}")
    kept, numbers = [], []
    for number, line in enumerate(lines[place + 1 :], place + 2):
        row = _split(path, line, separator)
        if not any(map(str.strip, row)) or row[0].startswith("#"):
            continue
        if len(row) < len(names) or any(map(str.strip, row[len(names) :])):
            what = f"has {counted(len(row), 'value')} for {counted(len(names), 'column')}"
            fix = "write numbers with a decimal point; download it again if it ends here"
            raise BenchmarkError(what, where=f"{path}, line {number}", fix=fix)
        kept.append([text.strip() for text in row])
        numbers.append(number)
    if not kept:
        raise BenchmarkError("has no row below its columns", where=path, expected="a row a photo")
    texts = {ours: tuple(row[names.index(name)] for row in kept) for ours, name in header.items()}
    return Table(path, header, names, texts, numbers)


def _split(path: Path, line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    with readable(path, "not a table", kind=BenchmarkError):
        return next(csv.reader([line], delimiter=separator, strict=True), [])


def _headers(
    lines: Sequence[str], separators: Sequence[str | None]
) -> Iterator[tuple[int, str | None, list[str]]]:
    """Yield each line that may name the columns, the separator, and the names."""
    for place, line in enumerate(lines[:_HEADER_LINES]):
        for separator in separators if line.strip() else ():
            with suppress(BenchmarkError):  # quotes belong to another separator
                row = _split(Path(), line.lstrip("# \ufeff"), separator)
                yield place, separator, [name.strip() for name in row]


def read_lines(path: Path, columns: Sequence[str]) -> Table:
    """Read lines of values separated by blanks, without a line that names them."""
    lines = enumerate(map(str.strip, read_native_text(path).splitlines()), 1)
    rows = {
        number: line.rsplit(None, len(columns) - 1)
        for number, line in lines
        if line and not line.startswith("#")
    }
    wrong = [number for number, row in rows.items() if len(row) != len(columns)]
    if wrong or not rows:
        where = f"{path}, line {wrong[0] if wrong else 1}"
        expected = f"{len(columns)} values, separated by blanks: {' '.join(columns)}"
        raise BenchmarkError("has another number of values", where=where, expected=expected)
    texts = dict(zip(columns, zip(*rows.values(), strict=True), strict=True))
    return Table(path, {name: name for name in columns}, columns, texts, list(rows))


def _number(text: str) -> float:
    try:
        # Python's own grouping of digits is no number here.
        return math.nan if "_" in text else float(text)
    except ValueError:
        return math.nan


def match_names(given: Iterable[str], photos: Iterable[str], where: object) -> dict[str, str]:
    """Find the photo that each name means, whatever its case, path or ending."""
    names, there, found = list(given), list(photos), dict[str, str]()
    for form in range(3, -1, -1):  # the strictest that finds one holds
        counts = Counter(_form(photo, form) for photo in there)
        known = {_form(photo, form): photo for photo in there if counts[_form(photo, form)] == 1}
        found |= {name: known[_form(name, form)] for name in names if _form(name, form) in known}
    twice = [photo for photo, count in Counter(found.values()).items() if count > 1]
    if twice or not found:
        what = f"none of its {counted(len(names), 'name')} is among {counted(len(there), 'photo')}"
        what += f": it has names such as {first_of(names, shown=1)}"
        what = f"more than one name means {first_of(twice, len(there))}" if twice else what
        expected = f"names such as {min(there, default='')!r}, each photo once"
        raise BenchmarkError(what, where=where, expected=expected)
    return {name: found[name] for name in names if name in found}


def match_every_row(table: Table, column: str, photos: Iterable[str]) -> dict[str, str]:
    """Find the photo of each row, by its name; refuse a table with photos that are not there."""
    listed = table.texts(column)
    found = match_names(listed, photos, table.path)
    absent = [name for name in listed if name not in found]
    if absent:
        what = f"photos of it are missing: {first_of(absent, len(listed))}"
        fix = "download or unpack it again; remove rows only to leave photos out"
        raise BenchmarkError(what, where=table.path, fix=fix)
    return found


def _form(name: str, form: int) -> str:
    """Return a name as it is, in one case, without its folders, or without its ending too."""
    path = name.replace("\\", "/").casefold()
    base = path.rpartition("/")[2]
    return (name, path, base, base.rpartition(".")[0] or base)[form]


def values_by_scene(
    given: Sequence[str] | None, option: str, scenes: Collection[str]
) -> dict[str, str]:
    """Read an option that is given as SCENE=VALUE, repeated; with one scene, VALUE will do."""
    found: dict[str, str] = {}
    for text in given or ():
        scene, equals, value = text.partition("=")
        if not equals and len(scenes) == 1:
            scene, value = next(iter(scenes)), text
        if scene not in scenes or scene in found or not value:
            raise BenchmarkError(
                f"names no scene that is there{nearest(scene[:80], list(scenes))}, or one twice",
                where=f"--{option} {text}",
                expected=f"SCENE=VALUE with a scene among {first_of(scenes)}",
            )
        found[scene] = value
    return found
