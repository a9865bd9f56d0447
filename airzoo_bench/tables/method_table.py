"""Tables of methods: numbers scored here, numbers reported by papers, and floors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from airzoo_bench.protocol.model import Protocol
from airzoo_bench.results.comparable import check_comparable, version_notes
from airzoo_bench.results.comparison import FLOOR_MARK, floor_note, notes_of
from airzoo_bench.results.files import method_names
from airzoo_bench.results.result import Reference, Result, ScoreColumn
from airzoo_bench.tables.model import Between, Cell, Column, share_to_percent
from airzoo_bench.tables.published import OVERALL, PublishedTable, shipped_fingerprints

UNITS = {"share": "%", "m": "m", "deg": "deg"}
"""What tables show for the unit of a score."""


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

    def cells(self, scenes: Sequence[str], scores: Sequence[ScoreColumn]) -> list[Cell]:
        """Return the cells of scores in scenes, without a number where there is none."""
        return [
            Cell(
                self.values.get(scene, {}).get(score.key),
                uncertainty=self.uncertainties.get(scene, {}).get(score.key),
            )
            for scene in scenes
            for score in scores
        ]


@dataclass(frozen=True)
class MethodTable:
    """Methods of one protocol and truth, or reported for them.

    `scenes` are titles by scene. A method note names its methods. LaTeX prints the notes in
    `legend` and `about_intervals` under the table, since numbers mislead without them. The numbers
    depend on `identity`.
    """

    title: str
    benchmark: str
    track: str
    scores: tuple[ScoreColumn, ...]
    scenes: Mapping[str, str]
    rows: tuple[MethodRow, ...] = ()
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

    def noted(self, *notes: str, legend: bool = True) -> MethodTable:
        """Return the table with further notes, which may be of the legend."""
        more = notes if legend else ()
        return replace(self, notes=(*self.notes, *notes), legend=(*self.legend, *more))


def method_table(
    results: Sequence[Result], *, paths: Sequence[Path] = (), every_score: bool = False
) -> MethodTable:
    """Put results of one protocol and one truth into one table of methods."""
    names = [result.predictions.method for result in results]
    called = names
    if paths:  # who reads a refusal looks for files
        called = [f"{name} ({path})" for name, path in zip(names, paths, strict=True)]
        names = method_names(paths, results)
    check_comparable(called, results)
    first = results[0]
    # One that a method has no score for stays empty.
    scores = {c.key: c for r in results for c in r.columns if every_score or c.headline}
    users: dict[str, list[str]] = {}
    for name, result in zip(names, results, strict=True):
        for note in dict.fromkeys(notes_of(result)):
            users.setdefault(note, []).append(name)
    noted = {note: f"{', '.join(who)}: {note}" for note, who in users.items()}
    floors = [floor_note(result) for result in results]
    return MethodTable(
        f"{first.protocol.name} v{first.protocol.version}",
        first.truth.benchmark,
        first.track,
        tuple(scores.values()),
        first.truth.scene_titles,
        tuple(
            MethodRow(name, values_by_scene(result.columns, result), mark=FLOOR_MARK * bool(floor))
            for name, result, floor in zip(names, results, floors, strict=True)
        ),
        method_notes=tuple(noted.values()),
        notes=tuple(version_notes(names, results)),
        legend=tuple(noted[floor] for floor in dict.fromkeys(floors) if floor),
        identity=identity(first),
    )


def empty_table(protocol: Protocol, scores: Sequence[ScoreColumn]) -> MethodTable:
    """Return the table of a protocol without methods."""
    title = f"{protocol.name} v{protocol.version}"
    scenes = {scene.id: scene.title for scene in protocol.scenes}
    return MethodTable(title, protocol.benchmark, protocol.track, tuple(scores), scenes)


def values_by_scene(
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
    fingerprint: str = "",
) -> MethodTable:
    """Put the rows of published tables before the methods scored here by some protocol."""
    scenic = [table for table in tables if table.has_scenes]
    plain = [table for table in tables if not table.has_scenes]
    chosen = scenic if by_scene else plain or scenic
    if fingerprint and tables:
        shipped = shipped_fingerprints(methods.benchmark, methods.track)
        note = f"{methods.title} is not the shipped protocol: reported numbers may measure "
        methods = methods if fingerprint in shipped else methods.noted(note + "something else")
    if not chosen:
        what = "by scene " if by_scene else ""
        note = f"nothing is published {what}on {methods.benchmark} ({methods.track})"
        return methods.noted(note, legend=False)
    rows = [row for table in chosen for row in _reported(methods, table)]
    if by_scene and average:
        averages: dict[str, MethodRow] = {}
        for row in (row for table in plain for row in _reported(methods, table)):
            averages.setdefault(row.method, row)
        rows = [_with_average(row, averages.get(row.method)) for row in rows]
    return replace(methods, rows=(*rows, *methods.rows))


def _with_average(row: MethodRow, other: MethodRow | None) -> MethodRow:
    """Fill in an average that the tables by scene do not print, and say from where it is."""
    if OVERALL in row.values or other is None:
        return row
    values = {**row.values, OVERALL: other.values[OVERALL]}
    return replace(row, values=values, reported=f"{row.reported}; average: {other.reported}")


def _reported(methods: MethodTable, table: PublishedTable) -> list[MethodRow]:
    keys = {title: key for key, title in methods.scenes.items()} | {OVERALL: OVERALL}
    known = {score.key for score in methods.scores}
    rows = []
    for method, scenes in table.values.items():
        values = {
            keys[title]: {key: value for key, value in part.items() if key in known}
            for title, part in scenes.items()
            if title in keys
        }
        rows.append(MethodRow(method, values, reported=f"{table.source}, {table.label}"))
    return rows


def with_floors(methods: MethodTable, results: Sequence[Result]) -> MethodTable:
    """Put what scores without a method behind the rows of methods, and say what it is."""
    references, notes = shared_references(results)
    columns = [column for result in results for column in result.columns]
    rows = tuple(
        MethodRow(name, values_by_scene(columns, found), floor=True)
        for name, found in references.items()
    )
    meanings = [f"{name}: {found.meaning}" for name, found in references.items()]
    noted = methods.noted(*notes, legend=False).noted(*meanings)
    return replace(noted, rows=(*methods.rows, *rows))


def shared_references(results: Sequence[Result]) -> tuple[dict[str, Reference], list[str]]:
    """Return the references of results by name, the first of each name, and a note without any."""
    found: dict[str, Reference] = {}
    for result in results:
        for name, reference in result.references.items():
            found.setdefault(name, reference)
    none = ["no floors: these results hold none, as those of older versions"]
    return found, [] if found else none
