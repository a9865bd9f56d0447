"""Tables of methods: numbers scored here, numbers reported by papers, and floors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from airzoo_bench.protocol.model import Protocol, load_protocol, shipped_protocols
from airzoo_bench.results.comparable import check_comparable
from airzoo_bench.results.comparison import FLOOR_MARK, floor_note
from airzoo_bench.results.result import Reference, Result, ScoreColumn, method_names
from airzoo_bench.tables.model import Between, Cell, Column, share_to_percent
from airzoo_bench.tables.published import OVERALL, PrintedValue

UNITS = {"share": "%", "m": "m", "deg": "deg"}
"""What tables show for the unit of a score."""


def as_shown(score: ScoreColumn, value: float) -> float:
    """Turn a result's value into what tables show: percent for a share."""
    return share_to_percent(value) if score.unit == "share" else value


def score_column(score: ScoreColumn, group: str = "") -> Column:
    """Return a score's column."""
    unit = UNITS[score.unit]
    return Column(score.title, unit, score.higher_is_better, group=group)


def identity(result: Result) -> str:
    """Return what a result's numbers depend on, in one line."""
    return (
        f"protocol {result.protocol.fingerprint[:12]}, truth {result.truth.fingerprint[:12]}, "
        f"airzoo-bench {result.versions['airzoo-bench']}"
    )


def share_notes(notes: Iterable[tuple[str, str]], everyone: int = 0) -> list[str]:
    """Return each note once, after the names that have it, if these are not all."""
    users: dict[str, dict[str, None]] = {}
    for name, note in notes:
        users.setdefault(note, {})[name] = None
    return [
        note if len(who) == everyone else f"{', '.join(who)}: {note}" for note, who in users.items()
    ]


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

    `scenes` are titles by scene. LaTeX prints the notes in `legend`, since numbers mislead without
    them.
    """

    title: str
    benchmark: str
    track: str
    scores: tuple[ScoreColumn, ...]
    scenes: Mapping[str, str]
    rows: tuple[MethodRow, ...] = ()
    notes: tuple[str, ...] = ()
    legend: tuple[str, ...] = ()

    def with_notes(self, *notes: str, legend: bool = True) -> MethodTable:
        """Return the table with further notes, which may be of the legend."""
        more = notes if legend else ()
        return replace(self, notes=(*notes, *self.notes), legend=(*self.legend, *more))


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
    first, named = results[0], list(zip(names, results, strict=True))
    # One that a method has no score for stays empty.
    scores = {c.key: c for r in results for c in r.columns if every_score or c.headline}
    floors = {name: floor_note(result) for name, result in named}
    notes = share_notes(((name, note) for name, r in named for note in r.notes), len(names))
    alone = len(names) == 1
    legend = share_notes(((name, note) for name, note in floors.items() if note), alone)
    return MethodTable(
        f"{first.protocol.name} v{first.protocol.version}",
        first.truth.benchmark,
        first.track,
        tuple(scores.values()),
        first.truth.scene_titles,
        tuple(
            MethodRow(name, values_by_scene(r.columns, r), mark=FLOOR_MARK * bool(floors[name]))
            for name, r in named
        ),
        notes=(*notes, *legend, identity(first)),
        legend=tuple(legend),
    )


def empty_table(protocol: Protocol, scores: Sequence[ScoreColumn]) -> MethodTable:
    """Return the table of a protocol without methods."""
    title = f"{protocol.name} v{protocol.version}"
    scenes = {scene.id: scene.title for scene in protocol.scenes}
    return MethodTable(title, protocol.benchmark, protocol.track, tuple(scores), scenes)


def with_published(
    methods: MethodTable,
    printed: Sequence[PrintedValue],
    scenes: Sequence[str],
    fingerprint: str = "",
) -> MethodTable:
    """Put the rows of papers before the methods scored here by the protocol of a fingerprint.

    A number that two tables print is that of the one by scene where scenes are shown, else of the
    other.
    """
    if fingerprint and printed:
        shipped = [load_protocol(path) for path in shipped_protocols().values()]
        if fingerprint not in {protocol.fingerprint for protocol in shipped}:
            note = f"{methods.title} is not the shipped protocol: reported numbers may measure "
            methods = methods.with_notes(note + "something else")
    keys = {title: key for key, title in methods.scenes.items()} | {OVERALL: OVERALL}
    known = {score.key for score in methods.scores}
    scenic, by_scene = {v.table for v in printed if v.scene != OVERALL}, [*scenes] != [OVERALL]
    rows: dict[str, dict[str, dict[str, float]]] = {}
    sources: dict[str, dict[str, None]] = {}
    for cell in sorted(printed, key=lambda cell: (cell.table in scenic) != by_scene):
        # A method that is nowhere printed by scene has no row among those that are.
        is_alone = by_scene and cell.table not in scenic and cell.method not in rows
        if keys.get(cell.scene) in scenes and cell.metric in known and not is_alone:
            part = rows.setdefault(cell.method, {}).setdefault(keys[cell.scene], {})
            if cell.metric not in part:
                part[cell.metric] = float(cell.value)
                sources.setdefault(cell.method, {})[cell.table] = None
    if not rows:
        what = "by scene " if by_scene else ""
        note = f"nothing is published {what}on {methods.benchmark} ({methods.track})"
        return methods.with_notes(note, legend=False)
    reported = (MethodRow(m, v, reported="; ".join(sources[m])) for m, v in rows.items())
    return replace(methods, rows=(*reported, *methods.rows))


def with_floors(methods: MethodTable, results: Sequence[Result]) -> MethodTable:
    """Put what scores without a method behind the rows of methods, and say what it is."""
    references = shared_references(results)
    columns = [column for result in results for column in result.columns]
    rows = tuple(
        MethodRow(name, values_by_scene(columns, found), floor=True)
        for name, found in references.items()
    )
    meanings = [f"{name}: {found.meaning}" for name, found in references.items()]
    return replace(methods.with_notes(*meanings), rows=(*methods.rows, *rows))


def shared_references(results: Sequence[Result]) -> dict[str, Reference]:
    """Return the references of results by name, the first of each name."""
    found: dict[str, Reference] = {}
    for result in results:
        found = result.references | found
    return found
