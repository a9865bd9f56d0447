"""Published numbers: what papers print, as data with their source.

A source is a TOML file that says where numbers come from and what the paper's names mean here, and
a CSV file that holds every number as it is printed. Such numbers were not scored here: they have
no fingerprint, and stand next to results, never among them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import Field

from airzoo_bench.core.errors import ResultError
from airzoo_bench.core.validation import Name, Strict, nearest, read_toml, validated
from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.tables.printed_values import PrintedValue, read_published

__all__ = [
    "PublishedTable",
    "Source",
    "published_benchmarks",
    "published_sources",
    "published_tables",
    "read_source",
    "read_source_file",
    "shipped_fingerprints",
]

V = TypeVar("V")

_OVERALL = ""


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
    """One printed table, or the part of it that is of one benchmark.

    Attributes
    ----------
    source, label : str
        The source's name, and what the paper calls the table.
    benchmark, track : str
        By the names that they have here.
    values : mapping of str to mapping of str to mapping of str to float
        By method, scene title (empty for the average over scenes) and score, in percent, metres
        or degrees.
    """

    source: str
    label: str
    benchmark: str
    track: str
    values: Mapping[str, Mapping[str, Mapping[str, float]]]

    @property
    def has_scenes(self) -> bool:
        """Whether there is more than an average."""
        return any(scene != _OVERALL for scenes in self.values.values() for scene in scenes)

    def average_of(self, method: str) -> Mapping[str, float]:
        """Return the scores of a method over scenes, none where none are printed."""
        return self.values.get(method, {}).get(_OVERALL, {})


def published_sources() -> dict[str, Path]:
    """Return the sources that travel with the package, by name."""
    folders = {path.parent / "published" for path in shipped_protocols().values()}
    return {path.stem: path for folder in sorted(folders) for path in sorted(folder.glob("*.toml"))}


def published_tables(benchmark: str, track: str) -> list[PublishedTable]:
    """Return what the shipped sources print of one benchmark and track."""
    tables = [table for path in published_sources().values() for table in read_source(path)]
    return [t for t in tables if (t.benchmark, t.track) == (benchmark, track)]


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
        where = f"{place}, line {cell.line}, column"
        benchmark = _known(source.benchmarks, cell.benchmark, "benchmark", where)
        scores = _known(source.scores, cell.track, "track", where)
        key = _known(scores, cell.score.name, "metric", where)
        scene = _OVERALL if cell.is_summary else cell.scene
        table = found.setdefault((cell.table, benchmark, cell.track), {})
        values = table.setdefault(cell.method, {}).setdefault(scene, {})
        if key in values:
            raise ResultError(
                f"{cell.method} has {cell.score.name} twice",
                where=f"{place}, line {cell.line}",
                expected="one average a table, and one number for each score of the TOML file",
            )
        values[key] = float(cell.number.value * _factor(cell))
    return [PublishedTable(source.name, *place, values) for place, values in found.items()]


def _factor(cell: PrintedValue) -> int:
    """Return what makes a share percent, and leaves anything else as it is printed."""
    return 100 // cell.full if cell.score.is_share else 1


def _known(names: Mapping[str, V], name: str, what: str, where: str) -> V:
    if name not in names:
        raise ResultError(
            f"the {what} {name[:80]!r} is not explained{nearest(name, sorted(names))}",
            where=f"{where} {what!r}",
            expected="one of " + ", ".join(names),
            fix="add it to the TOML file",
        )
    return names[name]


def published_benchmarks(track: str, *, by_scene: bool = False) -> list[str]:
    """Return the benchmarks on which something is published in a track, and by scene if asked."""
    tables = [table for path in published_sources().values() for table in read_source(path)]
    fitting = [t for t in tables if t.track == track and (t.has_scenes or not by_scene)]
    return list(dict.fromkeys(table.benchmark for table in fitting))
