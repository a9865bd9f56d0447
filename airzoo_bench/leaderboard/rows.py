"""The content of board.json: tables of one protocol and truth, and their rows."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from airzoo_bench.results.result import ScoreColumn

__all__ = ["OVERALL", "Conditions", "Head", "Model", "Row", "Scene", "Score", "Table", "Version"]

OVERALL = ""
"""The key of the average over scenes."""

Number = float | None


class Model(BaseModel):
    """A part of board.json, in which an infinite number is the text "Infinity"."""

    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="strings")


class Score(Model):
    """A score with its interval, its standard error where the truth is sealed, and its ranks.

    `near_best` says that a test of the two alone cannot tell the method from the best.
    """

    value: Number = None
    low: Number = None
    high: Number = None
    standard_error: Number = None
    rank: tuple[int, int] | None = None
    near_best: bool = False


class Version(Model):
    """A version of a submission: its overall scores, and where its run lies on the data branch."""

    number: int
    date: str
    scores: dict[str, Number]
    files: str


class Row(Model):
    """A method scored here, reported by a paper or not scored, or a floor such as chance.

    Scores are by key, `scenes` by scene, then key: value, low and high; `conditions` by condition,
    then key: a value a group. The newest version comes first in `history`.
    """

    id: str = ""
    kind: Literal["re-scored", "sealed", "reported", "floor", "failed"]
    method: str
    team: str = ""
    authors: tuple[str, ...] = ()
    summary: str = ""
    source: str = ""
    reason: str = ""
    date: str | None = None
    rescored: str | None = None
    version: int | None = None
    paper: str | None = None
    code: str | None = None
    weights: str | None = None
    licence: str | None = None
    training_data: tuple[str, ...] | None = None
    stages: str | None = None
    uses: tuple[str, ...] = ()
    bibtex: str = ""
    notes: tuple[str, ...] = ()
    scores: dict[str, Score] = {}
    scenes: dict[str, dict[str, tuple[Number, Number, Number]]] = {}
    conditions: dict[str, dict[str, tuple[Number, ...]]] = {}
    history: tuple[Version, ...] = ()


class Scene(Model):
    """A scene of a table."""

    id: str
    title: str
    queries: int | None


class Conditions(Model):
    """The groups of queries by a condition, and how many queries each has."""

    by: str
    title: str
    labels: tuple[str, ...]
    counts: tuple[int, ...]


class Head(Model):
    """The benchmark, protocol and truth of all numbers in a table."""

    benchmark: str
    benchmark_version: int | None = None
    track: str
    protocol: str
    protocol_version: int
    protocol_fingerprint: str
    truth: str = ""
    sealed: bool = False
    unit: str = "query"
    scenes: tuple[Scene, ...]


class Table(Head):
    """A table of the board.

    `pairs` are by score: the ids of the ranked methods, and of every two of them low, high, p and
    p_holm, the upper triangle as float32 (little endian), deflated, in base64.
    """

    id: str
    title: str
    summary: str
    benchmark_title: str
    scores: tuple[ScoreColumn, ...]
    conditions: tuple[Conditions, ...] = ()
    rows: tuple[Row, ...] = ()
    pairs: dict[str, dict[str, Any]] = {}
    about_intervals: str = ""
    notes: tuple[str, ...] = ()
    data: str | None = None
    paper: str | None = None
