"""Published tables from a CSV file: a row a printed number."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TypeVar

from airzoo_bench.audit.rounding import MOST_DECIMALS, Interval, Rounded, parse_number
from airzoo_bench.audit.scores import Score, read_score
from airzoo_bench.errors import ResultError, first_of
from airzoo_bench.files import read_text
from airzoo_bench.validation import nearest

__all__ = ["Printed", "Published", "read_published"]

T = TypeVar("T")

_REQUIRED = ("method", "scene", "metric", "value")
_OPTIONAL = ("table", "benchmark", "track", "unit", "n", "bold", "gain", "printed_delta")
_SUMMARIES = {"overall", "average", "avg", "avg.", "mean", "all", "total"}
_FULL = {"%": 100, "percent": 100, "share": 1, "1": 1}
_BOLD = {"1": True, "true": True, "yes": True, "0": False, "false": False, "no": False, "": False}
_ABSENT = {"", "-", "–", "—", "--", "n/a", "na"}
_LAYOUT = "columns method, scene, metric, value (docs/audit.md names the others)"
# Printed tables are small; checks compare methods with each other.
_LARGEST_BYTES = 2 << 20
_MOST_QUERIES = 1_000_000_000


@dataclass(frozen=True)
class Printed:
    """A printed number and where it stands.

    Attributes
    ----------
    line : int
        Of the file.
    full : int
        What a share of all is printed as: 100 or 1.
    gain : Rounded or None
        The difference that is printed beside it.
    bold : bool or None
        None where the file does not say.
    queries : int or None
        Of its scene, where the file says so.
    """

    line: int
    table: str
    benchmark: str
    track: str
    scene: str
    method: str
    score: Score
    unit: str
    full: int
    number: Rounded
    gain: Rounded | None
    bold: bool | None
    queries: int | None

    @property
    def is_summary(self) -> bool:
        """Whether it stands for several scenes."""
        return self.scene.casefold() in _SUMMARIES

    @property
    def group(self) -> tuple[str, str]:
        """Benchmark and track: what scenes and their averages have in common."""
        return self.benchmark, self.track

    @property
    def place(self) -> str:
        """Benchmark and scene, for people."""
        return ", ".join(part for part in (self.benchmark, self.scene) if part)

    @property
    def share(self) -> Interval:
        """The interval of the true number, as a share from 0 to 1."""
        return self.number.interval.times(Fraction(1, self.full))


@dataclass(frozen=True)
class Published:
    """The numbers of one file, in its order.

    Attributes
    ----------
    source : str
        The file's name.
    cells : tuple of Printed
    unused_columns : tuple of str
    has_bold : bool
        Whether the file says what is bold.
    """

    source: str
    cells: tuple[Printed, ...]
    unused_columns: tuple[str, ...]
    has_bold: bool

    def by(self, key: Callable[[Printed], T]) -> dict[T, list[Printed]]:
        """Group the cells, in the order of the file."""
        return grouped(self.cells, key)


def grouped(cells: Iterable[Printed], key: Callable[[Printed], T]) -> dict[T, list[Printed]]:
    """Group cells, in their order."""
    groups: dict[T, list[Printed]] = {}
    for cell in cells:
        groups.setdefault(key(cell), []).append(cell)
    return groups


def read_published(path: Path) -> Published:
    """Read published tables.

    Parameters
    ----------
    path : Path
        A CSV file with the columns method, scene, metric and value, and any of table, benchmark,
        track, unit, n, bold, gain (or printed_delta). A value that is empty or a dash is left out.

    Raises
    ------
    ResultError
        A column is missing or mistyped, a value is no printed number, a cell stands there twice,
        or it cannot be told whether shares are in percent.
    """
    text = read_text(path, ResultError, "table of published numbers", _LARGEST_BYTES)
    rows = csv.DictReader(io.StringIO(text.removeprefix("\ufeff"), newline=""), strict=True)
    try:
        columns = tuple(name.strip() for name in rows.fieldnames or ())
        _check_columns(path, columns)
        rows.fieldnames = columns
        cells = [_read_row(path, rows.line_num, row) for row in rows]
    except csv.Error as error:
        raise ResultError(
            f"not valid CSV: {error}", where=f"{path}, line {rows.line_num}", expected=_LAYOUT
        ) from error
    kept = tuple(cell for cell in cells if cell is not None)
    _check_cells(path, kept)
    unused = tuple(name for name in columns if name not in (*_REQUIRED, *_OPTIONAL))
    return Published(path.name, kept, unused, "bold" in columns)


def _check_columns(path: Path, columns: tuple[str, ...]) -> None:
    known = [*_REQUIRED, *_OPTIONAL]
    missing = [name for name in _REQUIRED if name not in columns]
    twice = sorted({name for name in columns if columns.count(name) > 1})
    both = [name for name in ("gain", "printed_delta") if name in columns]
    if missing:
        shown = ", ".join(columns)[:200] or "none"
        raise ResultError(
            f"no column {', '.join(repr(name) for name in missing)} (found: {shown})",
            where=path,
            expected=_LAYOUT,
            mend="put the names of the columns, separated by commas, into the first line",
        )
    if twice or len(both) > 1:
        names = " and ".join(repr(name) for name in twice or both)
        raise ResultError(f"{names}: one thing in two columns", where=path, mend="keep one")
    for name in columns:
        if name not in known and (hint := nearest(name.casefold(), known)):
            raise ResultError(f"unknown column {name[:80]!r}{hint}", where=path, expected=_LAYOUT)


def _read_row(path: Path, line: int, row: Mapping[str | None, str | None]) -> Printed | None:
    where = f"{path}, line {line}"
    if None in row or None in row.values():
        raise ResultError(
            "the line has not as many fields as the first",
            where=where,
            mend="put a field that holds a comma into double quotes",
        )
    field = {name: " ".join((value or "").split()) for name, value in row.items() if name}
    for name in ("method", "metric"):
        if not field[name]:
            raise ResultError(f"no {name}", where=where, expected="a name")
    if field["value"].casefold() in _ABSENT:
        return None
    score = read_score(field["metric"])
    unit = field.get("unit", "")
    gain = field.get("gain", field.get("printed_delta", ""))
    return Printed(
        line,
        field.get("table", ""),
        field.get("benchmark", ""),
        field.get("track", ""),
        field["scene"],
        field["method"],
        score,
        unit,
        _full(where, score, unit),
        _number(where, "value", field["value"]),
        None if gain.casefold() in _ABSENT else _number(where, "gain", gain),
        _bold(where, field["bold"]) if "bold" in field else None,
        _queries(where, field.get("n", "")),
    )


def _number(where: str, name: str, text: str) -> Rounded:
    number = parse_number(text)
    if number is None:
        raise ResultError(
            f"{name} {text[:80]!r} is no printed number",
            where=where,
            expected=f"digits as printed, such as 96.21, with at most {MOST_DECIMALS} decimals",
            mend="put unit, gain and bold into columns of their own",
        )
    return number


def _full(where: str, score: Score, unit: str) -> int:
    if not score.is_share:
        return 1
    if unit and unit.casefold() not in _FULL:
        raise ResultError(
            f"unit {unit[:80]!r} for {score.name[:80]!r}, a {score.family.value}",
            where=where,
            expected="% or share",
        )
    return _FULL[unit.casefold() or "%"]


def _bold(where: str, text: str) -> bool:
    if text.casefold() not in _BOLD:
        raise ResultError(f"bold is {text[:80]!r}", where=where, expected="1 or 0")
    return _BOLD[text.casefold()]


def _queries(where: str, text: str) -> int | None:
    if not text:
        return None
    if not (text.isascii() and text.isdigit() and 0 < int(text[:12]) <= _MOST_QUERIES):
        raise ResultError(
            f"n is {text[:80]!r}", where=where, expected="the number of queries of the scene"
        )
    return int(text)


def _check_cells(path: Path, cells: tuple[Printed, ...]) -> None:
    if not cells:
        raise ResultError("no printed number", where=path, expected="a line a number")
    first: dict[tuple[str, ...], int] = {}
    for cell in cells:
        names = (cell.table, cell.benchmark, cell.track, cell.scene, cell.method, cell.score.name)
        if names in first:
            raise ResultError(
                f"{cell.score.name} of {cell.method} on {cell.place} again",
                where=f"{path}, line {cell.line}",
                expected=f"once in a table; line {first[names]} has it",
                mend="tell tables apart by a column 'table'",
            )
        first[names] = cell.line
    shares = [cell for cell in cells if cell.score.is_share and not cell.unit]
    if shares and all(0 <= cell.number.value <= 1 for cell in shares):
        raise ResultError(
            "all shares are at most 1: percent, or from 0 to 1? "
            + first_of(dict.fromkeys(cell.score.name for cell in shares)),
            where=path,
            expected="a column 'unit' that says % or share",
        )
