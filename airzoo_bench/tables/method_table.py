"""Tables of methods: numbers scored here, numbers reported by papers, and floors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from airzoo_bench.results.comparable import check_comparable, version_notes
from airzoo_bench.results.comparison import FLOOR_MARK, floor_note, notes_of
from airzoo_bench.results.files import method_names
from airzoo_bench.results.result import Reference, Result, ScoreColumn
from airzoo_bench.tables.model import Between, Cell, Column, share_to_percent
from airzoo_bench.tables.published import OVERALL, PublishedTable

__all__ = [
    "OVERALL",
    "UNITS",
    "MethodRow",
    "MethodTable",
    "as_shown",
    "identity",
    "method_table",
    "score_column",
    "shared_references",
    "shown_values",
    "with_floors",
    "with_published",
]

UNITS = {"share": "%", "m": "m", "deg": "deg"}
"""What tables show for the unit of a score."""

_ROUNDING = 1e-9


@dataclass(frozen=True)
class MethodRow:
    """A method's numbers: percent, metres, degrees.

    Values and uncertainties are by scene, with `OVERALL` for the average, then by score. `reported`
    says where the numbers were printed; a floor is what scores without a method; a note says what
    the mark means.
    """

    method: str
    values: Mapping[str, Mapping[str, float]]
    uncertainties: Mapping[str, Mapping[str, Between]] = field(default_factory=dict)
    reported: str = ""
    floor: bool = False
    mark: str = ""

    def cell(self, scene: str, score: ScoreColumn) -> Cell:
        """Return the cell of one score in one scene; without a number where there is none."""
        return Cell(
            self.values.get(scene, {}).get(score.key),
            uncertainty=self.uncertainties.get(scene, {}).get(score.key),
        )


@dataclass(frozen=True)
class MethodTable:
    """Entries of one table: of one protocol and truth, or reported for them.

    `scenes` and `queries` are titles, and known numbers of queries, by scene. A method note names
    its methods. LaTeX prints the notes in `legend` and `about_intervals` under the table, since
    numbers mislead without them. The numbers depend on `identity`.
    """

    title: str
    benchmark: str
    track: str
    scores: tuple[ScoreColumn, ...]
    scenes: Mapping[str, str]
    queries: Mapping[str, int]
    rows: tuple[MethodRow, ...]
    method_notes: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    legend: tuple[str, ...] = ()
    about_intervals: tuple[str, ...] = ()
    identity: str = ""

    @property
    def all_notes(self) -> tuple[str, ...]:
        """The notes of all and of methods, and last what the numbers depend on."""
        return (*self.notes, *self.method_notes, *filter(None, [self.identity]))

    @property
    def whole_legend(self) -> tuple[str, ...]:
        """The notes that LaTeX prints under the table."""
        return (*self.legend, *self.about_intervals)

    def noted(self, *notes: str, legend: bool = False) -> MethodTable:
        """Return the table with further notes, which may be of the legend."""
        more = notes if legend else ()
        return replace(self, notes=(*self.notes, *notes), legend=(*self.legend, *more))


def method_table(
    results: Sequence[Result], *, paths: Sequence[Path] = (), every_score: bool = False
) -> MethodTable:
    """Put results of one protocol and one truth into one table of methods."""
    methods = [result.predictions.method for result in results]
    names = method_names(paths, results) if paths else methods
    # Who reads a refusal looks for files.
    called = [f"{m} ({p})" for m, p in zip(methods, paths, strict=True)] if paths else methods
    check_comparable(called, results)
    first = results[0]
    # One that a method has no score for stays empty.
    scores = {c.key: c for r in results for c in r.columns if every_score or c.headline}
    floors = [floor_note(result) for result in results]
    by_note: dict[str, list[str]] = {}
    for name, result in zip(names, results, strict=True):
        for note in dict.fromkeys(notes_of(result)):
            by_note.setdefault(note, []).append(name)
    noted = {note: f"{', '.join(who)}: {note}" for note, who in by_note.items()}
    return MethodTable(
        f"{first.protocol.name} v{first.protocol.version}",
        first.truth.benchmark,
        first.track,
        tuple(scores.values()),
        first.truth.scene_titles,
        {scene: counts["queries"] for scene, counts in first.counts.items()},
        tuple(
            MethodRow(name, shown_values(result.columns, result), mark=FLOOR_MARK * bool(floor))
            for name, result, floor in zip(names, results, floors, strict=True)
        ),
        method_notes=tuple(noted.values()),
        legend=tuple(noted[floor] for floor in dict.fromkeys(floors) if floor),
        notes=tuple(version_notes(names, results)),
        identity=identity(first),
    )


def shown_values(
    scores: Sequence[ScoreColumn], numbers: Result | Reference
) -> dict[str, dict[str, float]]:
    """Return scores as tables show them, by scene, with `OVERALL` for the average, then by key."""
    by_key = {score.key: score for score in scores}
    parts = {OVERALL: numbers.overall} | numbers.scenes
    return {
        scene: {key: as_shown(by_key[key], value) for key, value in part.items()}
        for scene, part in parts.items()
    }


def as_shown(score: ScoreColumn, value: float) -> float:
    """Turn a result's value into what tables show: percent for a share."""
    return share_to_percent(value) if score.unit == "share" else value


def score_column(score: ScoreColumn, group: str = "", block: str = "") -> Column:
    """Return a score's column."""
    unit = UNITS[score.unit]
    return Column(score.title, unit, score.higher_is_better, group=group, block=block)


def identity(result: Result) -> str:
    """Return what a result's numbers depend on, in one line."""
    return (
        f"protocol {result.protocol.fingerprint[:12]}, truth {result.truth.fingerprint[:12]}, "
        f"airzoo-bench {result.versions['airzoo-bench']}"
    )


def with_published(
    methods: MethodTable,
    tables: Sequence[PublishedTable],
    *,
    by_scene: bool,
    average: bool = True,
    elsewhere: Sequence[str] = (),
) -> MethodTable:
    """Put the rows of published tables before the methods scored here."""
    scenic = [table for table in tables if table.has_scenes]
    plain = [table for table in tables if not table.has_scenes]
    chosen = scenic if by_scene else plain or scenic
    if not chosen:
        what = "by scene " if by_scene else ""
        note = f"nothing is published {what}on {methods.benchmark} ({methods.track})"
        others = [name for name in elsewhere if name != methods.benchmark]
        return methods.noted(note + (f", but on {', '.join(others)}" if others else ""))
    rows = [row for table in chosen for row in _reported(methods, table)]
    if by_scene and average:
        averages = {
            row.method: row for table in reversed(plain) for row in _reported(methods, table)[::-1]
        }
        rows = [_with_average(row, averages.get(row.method)) for row in rows]
    pairs = [(table, other) for table in chosen for other in tables] if average else []
    notes = [_disagreement(methods, table, other) for table, other in pairs]
    methods = replace(methods, rows=(*rows, *methods.rows))
    return methods.noted(*filter(None, notes), legend=True)


def _with_average(row: MethodRow, other: MethodRow | None) -> MethodRow:
    """Fill in an average that the tables by scene do not print, and say from where it is."""
    if OVERALL in row.values or other is None:
        return row
    values = {**row.values, OVERALL: other.values[OVERALL]}
    return replace(row, values=values, reported=f"{row.reported}; average: {other.reported}")


def _reported(methods: MethodTable, table: PublishedTable) -> list[MethodRow]:
    keys = {title: key for key, title in methods.scenes.items()} | {OVERALL: OVERALL}
    known = {score.key for score in methods.scores}
    return [
        MethodRow(
            method,
            {
                keys[title]: {key: value for key, value in values.items() if key in known}
                for title, values in scenes.items()
                if title in keys
            },
            reported=f"{table.source}, {table.label}",
        )
        for method, scenes in table.values.items()
    ]


def _disagreement(methods: MethodTable, table: PublishedTable, other: PublishedTable) -> str:
    shown = [score.key for score in methods.scores]
    differ = [
        method
        for method, scenes in table.values.items()
        for here, there in [(scenes.get(OVERALL, {}), other.average_of(method))]
        if any(key in here and there.get(key, here[key]) != here[key] for key in shown)
    ]
    if not differ:
        return ""
    return f"{other.label} of the same source prints another average of {', '.join(differ)}"


def with_floors(methods: MethodTable, results: Sequence[Result]) -> MethodTable:
    """Put what scores without a method behind the rows of methods, and say what it is."""
    references, notes = shared_references(results)
    columns = [column for result in results for column in result.columns]
    rows = tuple(
        MethodRow(name, shown_values(columns, found), floor=True)
        for name, found in references.items()
    )
    meanings = [f"{name}: {found.meaning}" for name, found in references.items()]
    noted = methods.noted(*notes).noted(*meanings, legend=True)
    return replace(noted, rows=(*methods.rows, *rows))


def shared_references(results: Sequence[Result]) -> tuple[dict[str, Reference], list[str]]:
    """Return the references of results by name, the first of each name, and what must be said."""
    found: dict[str, Reference] = {}
    for result in results:
        for name, reference in result.references.items():
            found.setdefault(name, reference)
    if not found:
        return {}, ["no floors: these results hold none, as those of older versions"]
    odd = [
        f"{name} of {result.predictions.method} differs from the one that is shown"
        for name, reference in found.items()
        for result in results
        if name in result.references and not _alike(result.references[name], reference)
    ]
    return found, list(dict.fromkeys(odd))


def _alike(one: Reference, other: Reference) -> bool:
    parts = [{OVERALL: r.overall, "pooled": r.pooled} | r.scenes for r in (one, other)]
    return parts[0].keys() == parts[1].keys() and all(
        part.keys() == parts[1][scene].keys()
        and all(math.isclose(v, parts[1][scene][k], rel_tol=_ROUNDING) for k, v in part.items())
        for scene, part in parts[0].items()
    )
