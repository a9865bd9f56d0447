"""Published numbers of papers, a line a number of a CSV file, with their source.

A source is a TOML file beside its CSV file: where numbers come from, and how the suite calls the
paper's names. Such numbers were not scored here, and are shown next to results, never among them.
"""

from __future__ import annotations

import csv
import io
import re
from decimal import Decimal
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AliasChoices, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from airzoo_bench.core.errors import ResultError
from airzoo_bench.core.files import read_text
from airzoo_bench.core.validation import Name, Strict, read_toml, validated, validation_message
from airzoo_bench.protocol.model import shipped_protocols

OVERALL = ""
"""The key of the average over scenes, which no scene has."""

_SUMMARIES = {"overall", "average", "avg", "avg.", "mean", "all", "total", "pooled"}
_MISSING = {"", "-", "–", "—", "n/a", "na", "inf", "∞"}
_GAINS = ("gain", "printed_delta")
_NUMBER = re.compile(r"[+-]?[0-9]{1,9}(\.[0-9]{1,9})?")


def _read_number(text: object) -> Decimal:
    digits = str(text).replace("−", "-").replace("–", "-")
    if not _NUMBER.fullmatch(digits):
        raise ValueError("not the digits as printed, such as 96.21, with at most 9 decimals")
    return Decimal(digits)


Number = Annotated[Decimal, BeforeValidator(_read_number)]
Text = Annotated[str, Field(min_length=1)]


class PrintedValue(BaseModel):
    """A printed number with its trailing zeros, and its place.

    `line` is of the file; `gain` is the difference that is printed next to the number; `n` are the
    queries of its scene, where the file says so.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    line: int
    method: Text
    scene: str = "overall"
    metric: Text
    value: Number
    table: str = ""
    benchmark: str = ""
    track: str = ""
    unit: str = ""
    n: Annotated[int, Field(ge=1, lt=10**9)] | None = None
    bold: bool = False
    gain: Annotated[Number | None, Field(validation_alias=AliasChoices(*_GAINS))] = None

    @property
    def is_summary(self) -> bool:
        """Whether it is an average of several scenes."""
        return self.scene.casefold() in _SUMMARIES

    @property
    def is_share(self) -> bool:
        """Whether its unit says that it is from 0 to 1."""
        return self.unit.casefold() in ("share", "1")

    @property
    def place(self) -> str:
        """Benchmark and scene, for people."""
        return ", ".join(part for part in (self.benchmark, self.scene) if part)


def read_published(path: Path) -> list[PrintedValue]:
    """Read published numbers from a CSV file of a line a number."""
    text = read_text(path, ResultError, "table of published numbers").removeprefix("\ufeff")
    reader = csv.DictReader(io.StringIO(text, newline=""), strict=True, restkey="more")
    found: dict[tuple[str, ...], PrintedValue] = {}
    try:
        for row in reader:
            texts = {k: " ".join(v.split()) if isinstance(v, str) else v for k, v in row.items()}
            if str(texts.get("value")).casefold() in _MISSING:
                continue
            no_gain = {k for k in _GAINS if texts.get(k) in _MISSING}
            given = {k: v for k, v in texts.items() if v != "" and k not in no_gain}
            cell = PrintedValue.model_validate({"line": reader.line_num, **given})
            # Average and average are one.
            names = (cell.table, cell.benchmark, cell.track, cell.method)
            first = found.setdefault((*names, cell.scene.casefold(), cell.metric.casefold()), cell)
            if first is not cell:
                what = f"{cell.metric} of {cell.method} on {cell.place} is in line {first.line} too"
                fix = "tell tables apart by a column 'table'"
                raise ResultError(what, where=f"{path}, line {cell.line}", fix=fix)
    except (csv.Error, ValidationError) as error:
        said = f"not valid CSV: {error}"
        if isinstance(error, ValidationError):
            said = validation_message(error, PrintedValue)
        where = f"{path}, line {reader.line_num}"
        raise ResultError(said, where=where, fix="docs/audit.md lists the columns") from None
    if not found:
        raise ResultError("no printed number", where=path, expected="a line a number")
    return list(found.values())


class Source(Strict):
    """Where published numbers come from, and how the suite calls its names."""

    schema_version: Literal[1] = Field(alias="schema")
    name: Name
    title: Text
    url: Text
    data: Name
    benchmarks: dict[str, Name]
    scores: dict[str, dict[str, str]]
    citations: dict[str, str]


def published_sources() -> dict[str, Path]:
    """Return the sources that travel with the package, by name."""
    folders = {path.parent / "published" for path in shipped_protocols().values()}
    return {path.stem: path for folder in sorted(folders) for path in sorted(folder.glob("*.toml"))}


def read_source_file(path: Path) -> Source:
    """Read what a source says of itself."""
    data = read_toml(path, ResultError, "file of published numbers")
    return validated(data, Source, ResultError, path, "file of published numbers")


def read_source(path: Path) -> list[PrintedValue]:
    """Read a source with its numbers by the names of the suite.

    A value's table names the source too, its scene is `OVERALL` for an average, its metric a
    score's key, and its unit percent, metres or degrees.
    """
    source = read_source_file(path)
    place, values = path.with_name(source.data), []
    for cell in read_published(place):
        try:
            changes = {
                "table": f"{source.name}, {cell.table}",
                "benchmark": source.benchmarks[cell.benchmark],
                "scene": OVERALL if cell.is_summary else cell.scene,
                "metric": source.scores[cell.track][cell.metric],
                "value": cell.value * (100 if cell.is_share else 1),
            }
        except KeyError as error:
            where, fix = f"{place}, line {cell.line}", f"add the name to {path.name}"
            raise ResultError(f"the name {error} is not explained", where=where, fix=fix) from None
        values.append(cell.model_copy(update=changes))
    return values


def published_values(benchmark: str, track: str) -> list[PrintedValue]:
    """Return what the shipped sources print of one benchmark and track."""
    values = (value for path in published_sources().values() for value in read_source(path))
    return [v for v in values if (v.benchmark, v.track) == (benchmark, track)]
