"""Published numbers of papers, a line a number of a CSV file, with their source.

A source is a TOML file that says where numbers come from and how the suite calls the paper's names,
beside its CSV file. Such numbers were not scored here: they have no fingerprint, and are shown next
to results, never among them.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import Field

from airzoo_bench.core.errors import ResultError
from airzoo_bench.core.files import read_text
from airzoo_bench.core.validation import Name, Strict, nearest, read_toml, validated
from airzoo_bench.protocol.model import load_protocol, shipped_protocols

S = TypeVar("S")
T = TypeVar("T")

OVERALL = ""
"""The key of the average over scenes, which no scene has."""

_NEEDED = ("method", "scene", "metric", "value")
_OPTIONAL = ("table", "benchmark", "track", "unit", "n", "bold", "gain", "printed_delta")
_SUMMARIES = {"overall", "average", "avg", "avg.", "mean", "all", "total", "pooled"}
_MISSING = {"", "-", "–", "—", "n/a", "na", "inf", "∞"}
_SHARES = {"share", "1"}  # units of numbers from 0 to 1
_BOLD = {"": False, "0": False, "1": True}
_NUMBER = re.compile(r"[+-]?[0-9]{1,9}(\.[0-9]{1,9})?")
_MINUS = str.maketrans({"−": "-", "–": "-"})


@dataclass(frozen=True)
class Rounded:
    """A number as printed, trailing zeros included: its exact value, digits behind the point."""

    text: str
    value: Fraction
    decimals: int

    @property
    def half(self) -> Fraction:
        """Half a step of the last digit."""
        return Fraction(1, 2 * 10**self.decimals)


def parse_number(text: str) -> Rounded | None:
    """Read a printed number; None for what is none."""
    plain = text.strip().replace("--", "-").translate(_MINUS)
    if not _NUMBER.fullmatch(plain):
        return None
    return Rounded(plain, Fraction(plain), len(plain.partition(".")[2]))


@dataclass(frozen=True, eq=False)
class PrintedValue:
    """A printed number and its place.

    `line` is of the file; `gain` is the difference that is printed next to the number; `queries`
    are those of its scene, where the file says so.
    """

    line: int
    table: str
    benchmark: str
    track: str
    scene: str
    method: str
    metric: str
    unit: str
    number: Rounded
    gain: Rounded | None
    bold: bool
    queries: int | None

    @property
    def is_summary(self) -> bool:
        """Whether it is an average of several scenes."""
        return self.scene.casefold() in _SUMMARIES

    @property
    def is_share(self) -> bool:
        """Whether its unit says that it is from 0 to 1."""
        return self.unit.casefold() in _SHARES

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


@dataclass(frozen=True)
class Published:
    """The numbers of one file, in its order, and whether it says what is bold."""

    path: Path
    cells: tuple[PrintedValue, ...]
    has_bold: bool


def grouped(items: Iterable[S], key: Callable[[S], T]) -> dict[T, list[S]]:
    """Group items, in their order."""
    groups: dict[T, list[S]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return groups


def read_published(path: Path) -> Published:
    """Read published numbers from a CSV file of a line a number."""
    rows = list(_rows(path))
    printed = [(line, row) for line, row in rows if row["value"].casefold() not in _MISSING]
    cells = tuple(_value(f"{path}, line {line}", line, row) for line, row in printed)
    if not cells:
        raise ResultError("no printed number", where=path, expected="a line a number")
    for same in grouped(cells, _identity).values():
        if len(same) > 1:
            raise ResultError(
                f"{same[1].metric} of {same[1].method} on {same[1].place} again",
                where=f"{path}, line {same[1].line}",
                expected=f"once in a table; line {same[0].line} has it",
                fix="tell tables apart by a column 'table'",
            )
    return Published(path, cells, "bold" in rows[0][1])


def _identity(cell: PrintedValue) -> tuple[str, ...]:
    # Average and average are one.
    return cell.table, *cell.group, cell.scene.casefold(), cell.method, cell.metric.casefold()


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
    faults = [f"no column {name}" for name in _NEEDED if name not in columns]
    faults += [f"unknown column {n[:80]!r}{nearest(n, known)}" for n in columns if n not in known]
    if len(set(columns)) < len(columns) or {"gain", "printed_delta"} <= set(columns):
        faults.append("two columns for the same; there may be one of gain or printed_delta")
    if faults:
        expected = f"the columns {', '.join(_NEEDED)}, and any of {', '.join(_OPTIONAL)}"
        fix = "write a line a number; see docs/audit.md"
        raise ResultError(faults[0], where=path, expected=expected, fix=fix)


def _value(where: str, line: int, row: Mapping[str, str]) -> PrintedValue:
    def check(fits: object, column: str, expected: str) -> None:
        if not fits:
            place = f"{where}, column {column!r}"
            raise ResultError(f"{column} is {row[column][:80]!r}", where=place, expected=expected)

    gain = "printed_delta" if "printed_delta" in row else "gain"
    has_gain = row.get(gain, "").casefold() not in _MISSING
    bold, n = row.get("bold", ""), row.get("n", "")
    for name in ("method", "metric"):
        check(row[name], name, "a name")
    digits = "the digits as printed, such as 96.21, with at most 9 decimals"
    number = parse_number(row["value"])
    check(number, "value", digits)
    difference = parse_number(row[gain]) if has_gain else None
    check(difference or not has_gain, gain, digits)
    check(bold in _BOLD, "bold", "1 or 0")
    check(not n or re.fullmatch(r"0*[1-9][0-9]{0,8}", n), "n", "the number of queries of the scene")
    assert number is not None
    return PrintedValue(
        line=line,
        scene=row["scene"] or "overall",
        method=row["method"],
        metric=row["metric"],
        **{name: row.get(name, "") for name in ("table", "benchmark", "track", "unit")},
        number=number,
        gain=difference,
        bold=_BOLD[bold],
        queries=int(n) if n else None,
    )


class Source(Strict):
    """Where published numbers come from, and how the suite calls its names."""

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


def published_sources() -> dict[str, Path]:
    """Return the sources that travel with the package, by name."""
    folders = {path.parent / "published" for path in shipped_protocols().values()}
    return {path.stem: path for folder in sorted(folders) for path in sorted(folder.glob("*.toml"))}


@cache
def _shipped_tables() -> list[PublishedTable]:
    return [table for path in published_sources().values() for table in read_source(path)]


def published_tables(benchmark: str, track: str) -> list[PublishedTable]:
    """Return what the shipped sources print of one benchmark and track."""
    return [t for t in _shipped_tables() if (t.benchmark, t.track) == (benchmark, track)]


@cache
def shipped_fingerprints(benchmark: str, track: str) -> set[str]:
    """Return the fingerprints of the shipped protocols of one benchmark and track."""
    protocols = [load_protocol(path) for path in shipped_protocols().values()]
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
        key = _explained(scores, cell.metric, "metric", where)
        scene = OVERALL if cell.is_summary else cell.scene
        table = found.setdefault((cell.table, benchmark, cell.track), {})
        values = table.setdefault(cell.method, {}).setdefault(scene, {})
        if key in values:
            once = "one average a table, and one number for each score of the TOML file"
            raise ResultError(f"{cell.method} has {cell.metric} twice", where=where, expected=once)
        # Shares become percent, and anything else stays as it is printed.
        values[key] = float(cell.number.value * (100 if cell.is_share else 1))
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
