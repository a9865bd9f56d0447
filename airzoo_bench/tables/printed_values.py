"""Printed numbers of papers, read from a CSV file of a line a number."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import TypeVar

from airzoo_bench.core.errors import ResultError, first_of
from airzoo_bench.core.files import read_text
from airzoo_bench.core.validation import nearest
from airzoo_bench.tables.printed_numbers import Interval, Rounded, parse_number
from airzoo_bench.tables.printed_scores import Family, Score, read_score, recall_of_cloud

__all__ = ["PrintedValue", "Published", "grouped", "is_summary_name", "read_published"]

S = TypeVar("S")
T = TypeVar("T")

_NEEDED = ("method", "scene", "metric", "value")
_OPTIONAL = ("table", "benchmark", "track", "unit", "n", "bold", "gain", "printed_delta")
_SUMMARIES = {"overall", "average", "avg", "avg.", "mean", "all", "total", "pooled"}
_MISSING = {"", "-", "–", "—", "n/a", "na", "inf", "∞"}
_FULL = {"": 100, "%": 100, "percent": 100, "share": 1, "1": 1}
_BOLD = {"": False, "0": False, "1": True}
_LARGEST_BYTES = 2 << 20
_MOST_NUMBERS = 20_000
_MOST_QUERIES = 1_000_000_000


@dataclass(frozen=True)
class PrintedValue:
    """A printed number and where it stands.

    Attributes
    ----------
    line : int
        Of the file.
    full : int
        What a share of all is printed as: 100 or 1.
    gain : Rounded or None
        The difference that is printed next to it.
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
    bold: bool
    queries: int | None

    @property
    def is_summary(self) -> bool:
        """Whether it stands for several scenes."""
        return is_summary_name(self.scene)

    @property
    def is_pooled(self) -> bool:
        """Whether it says of itself that it is over all queries, whatever their scene."""
        return self.scene.casefold() == "pooled"

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
    has_bold : bool
        Whether the file says what is bold.
    """

    source: str
    cells: tuple[PrintedValue, ...]
    has_bold: bool

    def by(self, key: Callable[[PrintedValue], T]) -> dict[T, list[PrintedValue]]:
        """Group the cells, in the order of the file."""
        return grouped(self.cells, key)


def grouped(items: Iterable[S], key: Callable[[S], T]) -> dict[T, list[S]]:
    """Group items, in their order."""
    groups: dict[T, list[S]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return groups


def is_summary_name(scene: str) -> bool:
    """Whether a scene's name stands for several."""
    return scene.casefold() in _SUMMARIES


def read_published(path: Path) -> Published:
    """Read published numbers."""
    rows = list(_rows(path))
    if len(rows) > _MOST_NUMBERS:
        raise ResultError(
            f"more than {_MOST_NUMBERS:,} numbers", where=path, fix="audit a table at a time"
        )
    read = [_value(path, line, row) for line, row in rows if not _is_missing(row["value"])]
    if not read:
        raise ResultError("no printed number", where=path, expected="a line a number")
    cells = _settled(read)
    _refuse_repeated(path, cells)
    _refuse_ambiguous(path, cells)
    return Published(path.name, cells, "bold" in rows[0][1])


def _rows(path: Path) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield the line number of each row and its texts by column."""
    text = read_text(path, ResultError, "table of published numbers", _LARGEST_BYTES)
    reader = csv.reader(io.StringIO(text.removeprefix("\ufeff"), newline=""), strict=True)
    try:
        columns = [name.strip() for name in next(reader, [])]
        _check_columns(path, columns)
        for texts in reader:
            if len(texts) not in (0, len(columns)):
                raise ResultError(
                    f"{len(texts)} fields",
                    where=f"{path}, line {reader.line_num}",
                    expected=f"{len(columns)}, as many as columns",
                    fix="put a field that holds a comma in double quotes",
                )
            if texts:
                tidy = (" ".join(text.split()) for text in texts)
                yield reader.line_num, dict(zip(columns, tidy, strict=True))
    except csv.Error as error:
        raise ResultError(
            f"not valid CSV: {error}", where=f"{path}, line {reader.line_num}"
        ) from None


def _check_columns(path: Path, columns: Sequence[str]) -> None:
    known = [*_NEEDED, *_OPTIONAL]
    columns_text = f"the columns {', '.join(_NEEDED)}, and any of {', '.join(_OPTIONAL)}"
    for name in _NEEDED:
        if name not in columns:
            raise ResultError(
                f"no column {name!r} (found: {', '.join(columns)[:200] or 'none'})",
                where=path,
                expected=columns_text,
                fix="write a line a number; see docs/audit.md",
            )
    for name in columns:
        if name not in known:
            what = f"unknown column {name[:80]!r}{nearest(name, known)}"
            raise ResultError(what, where=path, expected=columns_text)
    if len(set(columns)) < len(columns) or {"gain", "printed_delta"} <= set(columns):
        raise ResultError(
            "two columns for the same", where=path, expected="each once, and gain or printed_delta"
        )


def _is_missing(text: str) -> bool:
    return text.casefold() in _MISSING


def _value(path: Path, line: int, row: Mapping[str, str]) -> PrintedValue:
    def refuse(column: str, expected: str) -> ResultError:
        return ResultError(
            f"{column} is {row[column][:80]!r}",
            where=f"{path}, line {line}, column {column!r}",
            expected=expected,
        )

    def number(column: str) -> Rounded:
        parsed = parse_number(row[column])
        if parsed is None:
            raise refuse(column, "the digits as printed, such as 96.21, with at most 9 decimals")
        return parsed

    for name in ("method", "metric"):
        if not row[name]:
            raise refuse(name, "a name")
    score, unit, bold = read_score(row["metric"]), row.get("unit", ""), row.get("bold", "")
    if score.is_share and unit.casefold() not in _FULL:
        raise refuse("unit", "% or share")
    if bold not in _BOLD:
        raise refuse("bold", "1 or 0")
    n = row.get("n", "")
    if n and not (n.isascii() and n.isdigit() and 0 < int(n[:12]) <= _MOST_QUERIES):
        raise refuse("n", "the number of queries of the scene")
    gain = "printed_delta" if "printed_delta" in row else "gain"
    return PrintedValue(
        line=line,
        table=row.get("table", ""),
        benchmark=row.get("benchmark", ""),
        track=row.get("track", ""),
        scene=row["scene"] or "overall",
        method=row["method"],
        score=score,
        unit=unit,
        full=_FULL[unit.casefold()] if score.is_share else 1,
        number=number("value"),
        gain=None if _is_missing(row.get(gain, "")) else number(gain),
        bold=_BOLD[bold],
        queries=int(n) if n else None,
    )


def _settled(cells: Sequence[PrintedValue]) -> tuple[PrintedValue, ...]:
    """Settle by the whole file which recalls are of clouds, and what accuracy is."""
    families = {cell.score.family for cell in cells}
    # Next to F1, accuracy and completeness without a unit may be precision and recall.
    both = {Family.ACCURACY, Family.COMPLETENESS} <= families
    distances = both and Family.F1 not in families
    of_clouds = {
        (cell.table, *cell.group, cell.score.thresholds)
        for cell in cells
        if cell.score.family in (Family.F1, Family.PRECISION) and cell.score.thresholds
    }
    settled = []
    for cell in cells:
        score = cell.score
        as_cloud = recall_of_cloud(score)
        if as_cloud and (cell.table, *cell.group, as_cloud.thresholds) in of_clouds:
            score = as_cloud
        elif score.family in (Family.ACCURACY, Family.COMPLETENESS):
            # Accuracy of a cloud is a distance; a lone one, or one in percent, is anybody's.
            percent = cell.unit.casefold() in ("%", "percent")
            if percent or not (distances or cell.unit):
                better = True if percent else None
                score = replace(score, family=Family.OTHER, higher_is_better=better)
        elif distances and score.family is Family.OTHER and is_summary_name(score.name):
            score = replace(score, family=Family.CHAMFER, higher_is_better=False)
        settled.append(replace(cell, score=score))
    return tuple(settled)


def _refuse_repeated(path: Path, cells: Iterable[PrintedValue]) -> None:
    first: dict[tuple[str, ...], int] = {}
    for cell in cells:
        # Average and average are one.
        scene, score = cell.scene.casefold(), cell.score.name.casefold()
        line = first.setdefault((cell.table, *cell.group, scene, cell.method, score), cell.line)
        if line != cell.line:
            raise ResultError(
                f"{cell.score.name} of {cell.method} on {cell.place} again",
                where=f"{path}, line {cell.line}",
                expected=f"once in a table; line {line} has it",
                fix="tell tables apart by a column 'table'",
            )


def _refuse_ambiguous(path: Path, cells: Iterable[PrintedValue]) -> None:
    shares = [cell for cell in cells if cell.score.is_share and not cell.unit]
    # Nothing at all is 0 by either.
    printed = [cell.number.value for cell in shares if cell.number.value]
    if printed and all(0 < value <= 1 for value in printed):
        names = first_of(dict.fromkeys(cell.score.name for cell in shares))
        raise ResultError(
            f"all shares are at most 1: percent, or from 0 to 1? {names}",
            where=path,
            expected="a column 'unit' that says % or share",
        )
