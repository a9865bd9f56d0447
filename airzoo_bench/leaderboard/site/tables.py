"""A table of the board with all that belongs to it: scenes, conditions, pairs, methods."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from airzoo_bench.leaderboard.site import api
from airzoo_bench.leaderboard.site.api import API, Condition, Links, Row, Scene, TableFile
from airzoo_bench.leaderboard.site.breakdowns import by_condition, by_scene
from airzoo_bench.leaderboard.site.measured import OVERALL, RESAMPLING
from airzoo_bench.leaderboard.site.ranking import (
    Ranked,
    check_alike,
    headline_first,
    rank,
    rank_sealed,
)
from airzoo_bench.leaderboard.site.reported import Reported
from airzoo_bench.leaderboard.site.rows import (
    Scored,
    Scores,
    floor_row,
    reported_row,
    reported_scores,
    scored_row,
    scores_of,
    slugs,
)
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.intervals import Interval
from airzoo_bench.tables.intervals import intervals_made, resampled
from airzoo_bench.tables.published import shipped_fingerprints

__all__ = ["About", "Made", "make_table"]

_RANKS = (
    "Rank ranges: from 1 plus the methods that are significantly better to N minus those that are "
    "significantly worse, of the N methods that were scored here. "
)
_PAIRED = "Paired tests of every two methods, Holm's correction for all pairs of a column, 5 %."
_UNPAIRED = (
    "The truth is sealed, so methods are compared by their rounded scores and standard errors, "
    "which are added as if no two methods erred alike: ranges are wider than paired tests would "
    "give. Holm's correction for all pairs of a column, 5 %."
)
_NO_ERROR = (
    "A median that is a failure, or whose interval reaches one, has no standard error. What it may "
    "be has no bound, so it is told from no other method, and its range is from 1 to N."
)
_SEALED = "95 % intervals: the rounded score and 1.96 rounded standard errors to each side."


@dataclass(frozen=True)
class About:
    """What a table is of, apart from its rows.

    Attributes
    ----------
    columns : sequence of ScoreColumn
        Where no result says them.
    protocol : Protocol or None
        The shipped or prepared one, where it is known.
    """

    id: str
    title: str
    benchmark: str
    benchmark_title: str
    track: str
    protocol: str
    protocol_version: int
    fingerprint: str
    current: bool
    apart: str
    columns: Sequence[ScoreColumn]
    known: Protocol | None


@dataclass(frozen=True)
class Made:
    """A table, its rows by scene, and the further files that are its own.

    Attributes
    ----------
    scenes : dict of str to Scores
        By row.
    """

    table: TableFile
    scenes: dict[str, Scores]
    files: dict[str, Any]


def make_table(about: About, methods: Sequence[Scored], reported: Reported) -> Made:
    """Rank methods, put them beside what is published, and lay out the table's files."""
    check_alike(methods)
    columns = headline_first(methods, about.columns)
    ranked = _ranked(columns, methods)
    ranges = {key: one.ranges for key, one in ranked.items()}
    scenes = _scenes(about, methods)
    titles = {scene.id: scene.title for scene in scenes}
    rows: dict[str, tuple[Row, Scores]] = {}
    for place, one in enumerate(methods):
        found = scores_of(columns, one.measured, ranges, place)
        rows[one.id] = (scored_row(one, found[OVERALL]), found)
    printed, notes = ([], []) if _is_sealed(methods) else reported.rows(
        about.benchmark, about.track, columns, titles
    )  # fmt: skip
    names = slugs([f"reported {row.method}" for row in printed], rows)
    for name, printed_row in zip(names, printed, strict=True):
        found = reported_scores(columns, printed_row)
        findings = reported.of(about.benchmark, about.track, printed_row.method, titles)
        row = reported_row(name, printed_row, found.get(OVERALL, {}), findings)
        rows[name] = (row, found)
    ordered = _ordered(columns, rows) | _floors(columns, methods, rows)
    if printed and about.fingerprint not in shipped_fingerprints(about.benchmark, about.track):
        notes = [*notes, "not the shipped protocol: reported numbers may measure something else"]
    base = f"api/v1/tables/{about.id}"
    pairs = {key: one.pairs for key, one in ranked.items() if one.pairs is not None}
    paths = {key: f"{base}/pairs/{n}.json" for n, key in enumerate(pairs)}
    conditions = _conditions(methods)
    downloads = [f"downloads/{about.id}.{end}" for end in ("csv", "json", "tex", "md")]
    first = methods[0].measured if methods else None
    table = TableFile(
        API,
        about.id,
        about.title,
        about.benchmark,
        about.benchmark_title,
        None if first is None or first.sealed else first.benchmark_version,
        about.track,
        about.protocol,
        about.protocol_version,
        about.fingerprint,
        "" if first is None else first.truth,
        _is_sealed(methods),
        about.current,
        about.apart,
        "query" if first is None or first.unit == "query" else "scene",
        tuple(scenes),
        tuple(
            api.ScoreColumn(
                c.key, c.title, c.unit, c.higher_is_better, c.average, c.headline, paths.get(c.key)
            )
            for c in columns
        ),
        tuple(row for row, _ in ordered.values()),
        tuple(
            Condition(c["by"], c["title"], tuple(c["labels"]), tuple(c["counts"]))
            for c in conditions
        ),
        _about_ranks(methods, columns),
        _about_intervals(methods),
        (*notes, *_version_notes(methods)),
        Links(f"{base}/scenes.json", f"{base}/conditions.json" if conditions else None, *downloads),
    )
    by_row = {name: found for name, (_, found) in ordered.items()}
    files: dict[str, Any] = {paths[key]: found for key, found in pairs.items()}
    files[f"{base}/scenes.json"] = by_scene(table, by_row)
    if conditions:
        files[f"{base}/conditions.json"] = by_condition(table, conditions, methods)
    return Made(table, by_row, files)


def _is_sealed(methods: Sequence[Scored]) -> bool:
    return bool(methods) and methods[0].measured.sealed


def _ranked(columns: Sequence[ScoreColumn], methods: Sequence[Scored]) -> dict[str, Ranked]:
    headline = [column for column in columns if column.headline and methods]
    if _is_sealed(methods):
        return {c.key: rank_sealed([one.measured for one in methods], c) for c in headline}
    return {c.key: rank(methods, c) for c in headline}


def _scenes(about: About, methods: Sequence[Scored]) -> list[Scene]:
    if methods:
        return [Scene(*scene) for scene in methods[0].measured.scenes]
    known = about.known.scenes if about.known else ()
    return [Scene(scene.id, scene.title, scene.queries) for scene in known]


def _ordered(
    columns: Sequence[ScoreColumn], rows: Mapping[str, tuple[Row, Scores]]
) -> dict[str, tuple[Row, Scores]]:
    lead = columns[0]

    def order(name: str) -> tuple[bool, float, str]:
        score = rows[name][0].scores.get(lead.key)
        if score is None or not isinstance(score.value, float | int):
            return True, 0.0, name
        return False, -score.value if lead.higher_is_better else score.value, name

    return {name: rows[name] for name in sorted(rows, key=order)}


def _floors(
    columns: Sequence[ScoreColumn], methods: Sequence[Scored], taken: Mapping[str, Any]
) -> dict[str, tuple[Row, Scores]]:
    found: dict[str, Any] = {}
    for one in methods:
        for name, reference in one.measured.references.items():
            found.setdefault(name, (one.measured, reference))
    rows = {}
    for name, slug in zip(found, slugs([f"floor {name}" for name in found], taken), strict=True):
        measured, part = found[name]
        values = {OVERALL: part["overall"]} | part["scenes"]
        of_floor = replace(measured, values=values, limits={}, errors={})
        scores = scores_of(columns, of_floor)
        rows[slug] = (floor_row(slug, name, part["meaning"], scores[OVERALL]), scores)
    return rows


def _conditions(methods: Sequence[Scored]) -> list[dict[str, Any]]:
    return methods[0].measured.conditions if methods else []


def _about_ranks(methods: Sequence[Scored], columns: Sequence[ScoreColumn]) -> str:
    if not methods:
        return ""
    if not _is_sealed(methods):
        return _RANKS + _PAIRED
    errors = [one.measured.errors[OVERALL] for one in methods]
    headline = [column.key for column in columns if column.headline]
    all_known = all(key in known for known in errors for key in headline)
    return _RANKS + (_UNPAIRED if all_known else f"{_UNPAIRED} {_NO_ERROR}")


def _about_intervals(methods: Sequence[Scored]) -> str:
    if not methods:
        return ""
    if _is_sealed(methods):
        return _SEALED
    kinds = sorted({kind for one in methods for kind in one.measured.interval_kinds})
    every = [Interval(0.0, 0.0, kind) for kind in kinds]
    made = intervals_made(every, RESAMPLING, resampled(methods[0].measured.unit))
    return f"{made}." if made else "No intervals: too few queries or scenes."


def _version_notes(methods: Sequence[Scored]) -> list[str]:
    versions = sorted({one.measured.made_with for one in methods})
    return [f"scored by airzoo-bench {', '.join(versions)}"] if versions else []


def table_id(protocol: str, measures: tuple[Any, ...], *, current: bool) -> str:
    """Return the id of a table: the protocol's name, or with what an earlier one was measured."""
    return (
        protocol
        if current
        else f"{protocol}-{hashlib.sha256(repr(measures).encode()).hexdigest()[:8]}"
    )
