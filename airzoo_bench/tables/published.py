"""Published numbers of papers, a line a number of a CSV file, with their source.

A source is a TOML file that says where numbers come from and what the paper's names mean here,
beside its CSV file. Such numbers were not scored here: they have no fingerprint, and stand next to
results, never among them.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import Field

from airzoo_bench.core.errors import ResultError, first_of
from airzoo_bench.core.files import read_text
from airzoo_bench.core.validation import Name, Strict, nearest, read_toml, validated
from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.tables.printed import Rounded, Score, Span, parse_number, read_score

__all__ = [
    "OVERALL",
    "PrintedValue",
    "Published",
    "PublishedTable",
    "Source",
    "grouped",
    "published_benchmarks",
    "published_sources",
    "published_tables",
    "read_published",
    "read_source",
    "read_source_file",
    "shipped_fingerprints",
]

S = TypeVar("S")
T = TypeVar("T")

OVERALL = ""
"""The key of the average over scenes, which no scene has."""

_NEEDED = ("method", "scene", "metric", "value")
_OPTIONAL = ("table", "benchmark", "track", "unit", "n", "bold", "gain", "printed_delta")
_SUMMARIES = {"overall", "average", "avg", "avg.", "mean", "all", "total", "pooled"}
_MISSING = {"", "-", "–", "—", "n/a", "na", "inf", "∞"}
_FULL = {"": 100, "%": 100, "percent": 100, "share": 1, "1": 1}
_BOLD = {"": False, "0": False, "1": True}


@dataclass(frozen=True)
class PrintedValue:
    """A printed number and its place.

    `line` is of the file; `full` is what a share of all is printed as, 100 or 1; `gain` is the
    difference that is printed next to it; `queries` are those of its scene, where the file says so.
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
        """Whether it is an average of several scenes."""
        return self.scene.casefold() in _SUMMARIES

    @property
    def is_pooled(self) -> bool:
        """Whether it says of itself that it is over all queries, whatever their scene."""
        return self.scene.casefold() == "pooled"

    @property
    def group(self) -> tuple[str, str]:
        """Benchmark and track, which scenes and their averages have in common."""
        return self.benchmark, self.track

    @property
    def row(self) -> tuple[str, ...]:
        """The key of its row: table, benchmark, track, scene and method."""
        return self.table, *self.group, self.scene, self.method

    @property
    def place(self) -> str:
        """Benchmark and scene, for people."""
        return ", ".join(part for part in (self.benchmark, self.scene) if part)

    @property
    def share(self) -> Span:
        """Where the true number lies, as a share from 0 to 1."""
        return self.number.span.times(Fraction(1, self.full))


@dataclass(frozen=True)
class Published:
    """The numbers of one file, in its order, and whether it says what is bold."""

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


def read_published(path: Path) -> Published:
    """Read published numbers from a CSV file of a line a number."""
    rows = list(_rows(path))
    cells = tuple(
        _value(path, line, row) for line, row in rows if row["value"].casefold() not in _MISSING
    )
    if not cells:
        raise ResultError("no printed number", where=path, expected="a line a number")
    _refuse_repeated(path, cells)
    _refuse_ambiguous(path, cells)
    return Published(path.name, cells, "bold" in rows[0][1])


def _rows(path: Path) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield the line number of each row and its texts by column."""
    text = read_text(path, ResultError, "table of published numbers")
    reader = csv.reader(io.StringIO(text.removeprefix("\ufeff"), newline=""), strict=True)
    try:
        columns = [name.strip() for name in next(reader, [])]
        _check_columns(path, columns)
        for texts in filter(None, reader):
            if len(texts) != len(columns):
                raise ResultError(
                    f"{len(texts)} fields",
                    where=f"{path}, line {reader.line_num}",
                    expected=f"{len(columns)}, as many as columns",
                    fix="put a field that holds a comma in double quotes",
                )
            tidy = (" ".join(text.split()) for text in texts)
            yield reader.line_num, dict(zip(columns, tidy, strict=True))
    except csv.Error as error:
        place = f"{path}, line {reader.line_num}"
        raise ResultError(f"not valid CSV: {error}", where=place) from None


def _check_columns(path: Path, columns: Sequence[str]) -> None:
    known = [*_NEEDED, *_OPTIONAL]
    expected = f"the columns {', '.join(_NEEDED)}, and any of {', '.join(_OPTIONAL)}"
    lacking = [name for name in _NEEDED if name not in columns]
    odd = [name for name in columns if name not in known]
    if lacking:
        what = f"no column {', '.join(lacking)} (found: {', '.join(columns)[:200] or 'none'})"
        fix = "write a line a number; see docs/audit.md"
        raise ResultError(what, where=path, expected=expected, fix=fix)
    if odd:
        what = f"unknown column {odd[0][:80]!r}{nearest(odd[0], known)}"
        raise ResultError(what, where=path, expected=expected)
    if len(set(columns)) < len(columns) or {"gain", "printed_delta"} <= set(columns):
        once = "each once, and gain or printed_delta"
        raise ResultError("two columns for the same", where=path, expected=once)


def _value(path: Path, line: int, row: Mapping[str, str]) -> PrintedValue:
    def refuse(column: str, expected: str) -> ResultError:
        where = f"{path}, line {line}, column {column!r}"
        return ResultError(f"{column} is {row[column][:80]!r}", where=where, expected=expected)

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
    if n and not (n.isascii() and n.isdigit() and 0 < int(n) < 10**9):
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
        gain=None if row.get(gain, "").casefold() in _MISSING else number(gain),
        bold=_BOLD[bold],
        queries=int(n) if n else None,
    )


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


class Source(Strict):
    """Where published numbers come from, and what its names mean here."""

    schema_version: Literal[1] = Field(alias="schema")
    name: Name
    title: Annotated[str, Field(min_length=1)]
    url: Annotated[str, Field(min_length=1)]
    data: Name
    benchmarks: dict[str, Name]
    scores: dict[str, dict[str, str]]
    citations: dict[str, str]


@dataclass(frozen=True)
class PublishedTable:
    """One printed table, or its part for one benchmark, by the names of the suite.

    Values are by method, scene title (`OVERALL` for the average over scenes) and score, in percent,
    metres or degrees.
    """

    source: str
    label: str
    benchmark: str
    track: str
    values: Mapping[str, Mapping[str, Mapping[str, float]]]

    @property
    def has_scenes(self) -> bool:
        """Whether there is more than an average."""
        return any(scene != OVERALL for scenes in self.values.values() for scene in scenes)

    def average_of(self, method: str) -> Mapping[str, float]:
        """Return the scores of a method over scenes, none where none are printed."""
        return self.values.get(method, {}).get(OVERALL, {})


def published_sources() -> dict[str, Path]:
    """Return the sources that travel with the package, by name."""
    folders = {path.parent / "published" for path in shipped_protocols().values()}
    return {path.stem: path for folder in sorted(folders) for path in sorted(folder.glob("*.toml"))}


def published_tables(benchmark: str, track: str) -> list[PublishedTable]:
    """Return what the shipped sources print of one benchmark and track."""
    return [t for t in _shipped_tables() if (t.benchmark, t.track) == (benchmark, track)]


def published_benchmarks(track: str, *, by_scene: bool = False) -> list[str]:
    """Return the benchmarks on which something is published in a track, and by scene if asked."""
    tables = _shipped_tables()
    fitting = [t for t in tables if t.track == track and (t.has_scenes or not by_scene)]
    return list(dict.fromkeys(table.benchmark for table in fitting))


def _shipped_tables() -> list[PublishedTable]:
    return [table for path in published_sources().values() for table in read_source(path)]


@cache
def _shipped() -> list[Protocol]:
    return [load_protocol(path) for path in shipped_protocols().values()]


def shipped_fingerprints(benchmark: str, track: str) -> set[str]:
    """Return the fingerprints of the shipped protocols of one benchmark and track."""
    protocols = _shipped()
    return {p.fingerprint for p in protocols if (p.benchmark, p.track) == (benchmark, track)}


def read_source_file(path: Path) -> Source:
    """Read what a source says of itself."""
    data = read_toml(path, ResultError, "file of published numbers")
    return validated(data, Source, ResultError, path, "file of published numbers")


def read_source(path: Path) -> list[PublishedTable]:
    """Read a source with its numbers."""
    source = read_source_file(path)
    place = path.with_name(source.data)
    found: dict[tuple[str, str, str], dict[str, dict[str, dict[str, float]]]] = {}
    for cell in read_published(place).cells:
        where = f"{place}, line {cell.line}"
        benchmark = _explained(source.benchmarks, cell.benchmark, "benchmark", where)
        scores = _explained(source.scores, cell.track, "track", where)
        key = _explained(scores, cell.score.name, "metric", where)
        scene = OVERALL if cell.is_summary else cell.scene
        table = found.setdefault((cell.table, benchmark, cell.track), {})
        values = table.setdefault(cell.method, {}).setdefault(scene, {})
        if key in values:
            once = "one average a table, and one number for each score of the TOML file"
            what = f"{cell.method} has {cell.score.name} twice"
            raise ResultError(what, where=where, expected=once)
        # Shares become percent, and anything else stays as it is printed.
        factor = 100 // cell.full if cell.score.is_share else 1
        values[key] = float(cell.number.value * factor)
    return [PublishedTable(source.name, *key, values) for key, values in found.items()]


def _explained(names: Mapping[str, T], name: str, what: str, where: str) -> T:
    if name not in names:
        raise ResultError(
            f"the {what} {name[:80]!r} is not explained{nearest(name, sorted(names))}",
            where=f"{where}, column {what!r}",
            expected="one of " + ", ".join(names),
            fix="add it to the TOML file",
        )
    return names[name]
