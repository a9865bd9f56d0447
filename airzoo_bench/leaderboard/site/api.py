"""The JSON files of a board, as dataclasses; docs/leaderboard-api.md says what they mean."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, is_dataclass
from typing import Any, Literal

__all__ = [
    "API",
    "Benchmark",
    "BoardIndex",
    "Condition",
    "Finding",
    "Links",
    "MethodFile",
    "Pairs",
    "Row",
    "Scene",
    "SceneColumn",
    "Score",
    "ScoreColumn",
    "TableFile",
    "TableLink",
    "Version",
    "as_json",
]

API = 1
"""The version of the API; a field that goes, or means something else, makes it a new one."""

Kind = Literal["re-scored", "sealed", "reported", "floor"]
Number = float | int | str | None


@dataclass(frozen=True)
class TableLink:
    """A table of the board: one protocol, one truth."""

    id: str
    title: str
    track: str
    protocol: str
    protocol_version: int
    sealed: bool
    current: bool
    apart: str
    methods: int
    reported: int
    updated: str | None


@dataclass(frozen=True)
class Benchmark:
    """A benchmark and its tables, the current one of each protocol before its earlier ones."""

    name: str
    title: str
    tables: tuple[TableLink, ...]


@dataclass(frozen=True)
class BoardIndex:
    """``board.json``: what there is."""

    api: int
    title: str
    url: str | None
    repository: str | None
    repository_url: str | None
    data_url: str | None
    updated: str | None
    made_with: str
    benchmarks: tuple[Benchmark, ...]


@dataclass(frozen=True)
class Scene:
    """A scene; the number of queries is None where only papers tell of it."""

    id: str
    title: str
    queries: int | None


@dataclass(frozen=True)
class ScoreColumn:
    """A score: what its numbers mean."""

    key: str
    title: str
    unit: Literal["share", "m", "deg"]
    higher_is_better: bool
    average: Literal["mean", "median"]
    headline: bool
    pairs: str | None


@dataclass(frozen=True)
class Score:
    """A score of a row, with what is known of its uncertainty."""

    value: Number
    text: str
    low: Number = None
    high: Number = None
    interval: str = ""
    rank: tuple[int, int] | None = None
    standard_error: float | None = None


@dataclass(frozen=True)
class Finding:
    """What the audit says of a printed number; the empty scene is the average."""

    scene: str
    score: str
    grade: str
    check: str
    printed: str
    why: str
    source: str = ""


@dataclass(frozen=True)
class Row:
    """A row of a table."""

    id: str
    kind: Kind
    method: str
    scores: Mapping[str, Score]
    source: str = ""
    summary: str = ""
    team: str = ""
    authors: tuple[str, ...] = ()
    date: str | None = None
    paper: str | None = None
    code: str | None = None
    weights: str | None = None
    licence: str | None = None
    training_data: tuple[str, ...] | None = None
    stages: str | None = None
    uses: tuple[str, ...] = ()
    hardware: str | None = None
    seconds_per_query: float | None = None
    version: int = 1
    rescored: str | None = None
    notes: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class Condition:
    """A condition that the table can be broken down by."""

    by: str
    title: str
    labels: tuple[str, ...]
    counts: tuple[int, ...]


@dataclass(frozen=True)
class Links:
    """Files that belong to a table, relative to the site's root; None where there is none."""

    scenes: str | None
    conditions: str | None
    csv: str
    json: str
    latex: str
    markdown: str


@dataclass(frozen=True)
class TableFile:
    """``tables/<id>/table.json``: a row a method, the averages over scenes."""

    api: int
    id: str
    title: str
    benchmark: str
    benchmark_title: str
    benchmark_version: int | None
    track: str
    protocol: str
    protocol_version: int
    protocol_fingerprint: str
    truth: str
    sealed: bool
    current: bool
    apart: str
    unit: Literal["query", "scene"]
    scenes: tuple[Scene, ...]
    scores: tuple[ScoreColumn, ...]
    rows: tuple[Row, ...]
    conditions: tuple[Condition, ...]
    about_ranks: str
    about_intervals: str
    notes: tuple[str, ...]
    links: Links


@dataclass(frozen=True)
class SceneColumn:
    """A score in one scene (or group), in the order of the table's rows."""

    value: tuple[Number, ...]
    low: tuple[Number, ...] = ()
    high: tuple[Number, ...] = ()


@dataclass(frozen=True)
class Pairs:
    """``tables/<id>/pairs/<number>.json``: any two of the ranked rows by one score.

    `low`, `high`, `p` and `p_holm` are float32, little endian, base64: the upper triangle of a
    matrix of the ids, row by row. NaN: there is none.
    """

    api: int
    score: str
    ids: tuple[str, ...]
    values: tuple[Number, ...]
    low: str
    high: str
    p: str
    p_holm: str
    family: int
    resamples: int
    about: str


@dataclass(frozen=True)
class Version:
    """A version of a submission, the newest first."""

    number: int
    folder: str
    method: str
    date: str | None
    rescored: str | None
    made_with: str
    table: str
    scores: Mapping[str, Score]
    changes: str
    files: str


@dataclass(frozen=True)
class MethodFile:
    """``tables/<id>/methods/<row>.json``: one method with its history."""

    api: int
    table: str
    row: Row
    scenes: Mapping[str, Mapping[str, Score]]
    history: tuple[Version, ...]
    bibtex: str


def as_json(value: Any) -> Any:
    """Return what `json.dumps` can write: infinite numbers as text, as result.json has them."""
    if value is None or type(value) in (str, int, bool):
        return value
    if isinstance(value, float):
        return ("Infinity" if value > 0 else "-Infinity") if math.isinf(value) else value
    if type(value) in (tuple, list):
        return [as_json(part) for part in value]
    if is_dataclass(value):
        return {name: as_json(part) for name, part in vars(value).items()}
    if isinstance(value, Mapping):
        return {str(key): as_json(part) for key, part in value.items()}
    return value
