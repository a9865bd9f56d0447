"""Layouts of results: one by scene; methods by average, by scene, and over several benchmarks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from airzoo_bench.results.comparable import find_scene
from airzoo_bench.results.comparison import FLOOR_MARK, floor_note, notes_of
from airzoo_bench.results.result import Result, ScoreColumn
from airzoo_bench.tables.marks import mark_best
from airzoo_bench.tables.method_table import (
    UNITS,
    MethodRow,
    MethodTable,
    as_shown,
    identity,
    method_table,
    score_column,
    values_by_scene,
)
from airzoo_bench.tables.model import Between, Cell, Column, Row, Table
from airzoo_bench.tables.published import OVERALL

AVERAGE = "Average"
"""The title of the average over scenes."""

POOLED = "Pooled"
"""The row of means over all queries, whatever their scene."""


def _rows(methods: MethodTable, scenes: Sequence[str]) -> tuple[Row, ...]:
    return tuple(
        Row(
            (Cell(row.method, mark=row.mark), *row.cells(scenes, methods.scores)),
            summary=row.floor,
            reported=row.reported,
            floor=row.floor,
        )
        for row in methods.rows
    )


def methods_table(
    results: Sequence[Result], *, every_score: bool = False, scene: str | None = None
) -> Table:
    """Lay out several results of one protocol: a row a method, the best marked."""
    return mark_best(methods_layout(method_table(results, every_score=every_score), scene))


def methods_layout(methods: MethodTable, scene: str | None = None) -> Table:
    """Lay out a row a method, a column a score: of the average over scenes, or of one scene."""
    key = OVERALL if scene is None else find_scene(methods.scenes, scene)
    return Table(
        f"{methods.title}, {methods.scenes.get(key, 'average over scenes')}",
        (Column("Method"), *map(score_column, methods.scores)),
        _rows(methods, [key]),
        methods.all_notes,
        legend=methods.whole_legend,
    )


def scenes_layout(methods: MethodTable, *, average: bool = True) -> Table:
    """Lay out scenes side by side, the scores under each, and the average over scenes last."""
    titles = dict(methods.scenes)
    # Of published scenes alone an average may be printed nowhere.
    if average and any(row.values.get(OVERALL) for row in methods.rows):
        titles[OVERALL] = AVERAGE
    columns = [score_column(score, title) for title in titles.values() for score in methods.scores]
    return Table(
        f"{methods.title}, by scene",
        (Column("Method"), *columns),
        _rows(methods, list(titles)),
        (_units_note(methods.scores), *methods.all_notes),
        legend=methods.whole_legend,
    )


def _units_note(scores: Sequence[ScoreColumn]) -> str:
    """Say the units of scores, for tables with other titles above the columns."""
    by_unit: dict[str, dict[str, None]] = {}
    for score in scores:
        by_unit.setdefault(UNITS[score.unit], {})[score.title] = None
    most = max(by_unit, key=lambda unit: len(by_unit[unit]))
    rest = by_unit.pop(most)
    named = [f"{', '.join(titles)} in {unit}" for unit, titles in by_unit.items()]
    # Where units differ, naming those of the fewer scores is enough.
    others = "all other scores" if named else ", ".join(rest)
    return "; ".join([*named, f"{others} in {most}"])


def benchmarks_layout(parts: Sequence[MethodTable]) -> Table:
    """Lay out a row a method and benchmarks side by side, the average of each over its scenes."""
    tracks = [part.track for part in parts]
    parts = sorted(parts, key=lambda part: tracks.index(part.track))
    titles = _benchmark_titles(parts)
    numbered = [_numbered(part.rows) for part in parts]
    keys = sorted(dict.fromkeys(key for found in numbered for key in found), key=lambda key: key[2])
    rows = []
    for key in keys:
        entries = [found.get(key, MethodRow("", {})) for found in numbered]
        pairs = zip(parts, entries, strict=True)
        cells = [cell for part, row in pairs for cell in row.cells([OVERALL], part.scores)]
        reported = "; ".join(filter(None, dict.fromkeys(row.reported for row in entries)))
        name, _, is_floor, _ = key
        rows.append(Row((Cell(name), *cells), is_floor, reported=reported, floor=is_floor))
    notes = _notes(parts, titles)
    return Table(
        "Averages over scenes: " + ", ".join(part.title for part in parts),
        (
            Column("Method"),
            *(
                score_column(score, title, part.track)
                for part, title in zip(parts, titles, strict=True)
                for score in part.scores
            ),
        ),
        tuple(rows),
        (
            _units_note([score for part in parts for score in part.scores]),
            *notes.values(),
            *(f"{part.title}: {part.identity}" for part in parts if part.identity),
        ),
        groups_per_block=4,
        legend=tuple(dict.fromkeys(notes[note] for part in parts for note in part.whole_legend)),
    )


def _notes(parts: Sequence[MethodTable], titles: Sequence[str]) -> dict[str, str]:
    """Return each note as it is said; one that is not of all benchmarks names its own."""
    benchmarks: dict[str, list[str]] = {}
    for part, title in zip(parts, titles, strict=True):
        for note in (*part.notes, *part.method_notes):
            benchmarks.setdefault(note, []).append(title)
    of_all = {note for part in parts for note in part.legend}
    of_all |= {note for note, those in benchmarks.items() if len(those) == len(parts)}
    return {n: n if n in of_all else f"{', '.join(those)}: {n}" for n, those in benchmarks.items()}


def _numbered(rows: Sequence[MethodRow]) -> dict[tuple[str, bool, bool, int], MethodRow]:
    """Return rows by their identity across benchmarks: two of one name stay two."""
    seen: Counter[tuple[str, bool, bool]] = Counter()
    found = {}
    for row in rows:
        name = (row.method, bool(row.reported), row.floor)
        found[(*name, seen[name])] = row
        seen[name] += 1
    return found


def _benchmark_titles(parts: Sequence[MethodTable]) -> list[str]:
    """Return the title of each benchmark; equal titles get a distinguishing suffix."""
    protocols = [load_protocol(path) for path in shipped_protocols().values()]
    # A protocol's title is the benchmark's, and behind a comma what is measured.
    shipped = {protocol.benchmark: protocol.title.partition(",")[0] for protocol in protocols}
    names = [shipped.get(part.benchmark, part.benchmark) for part in parts]
    tracks = [f"{name}, {part.track}" for name, part in zip(names, parts, strict=True)]
    return [
        name if names.count(name) == 1 else track if tracks.count(track) == 1 else part.title
        for name, track, part in zip(names, tracks, parts, strict=True)
    ]


def scenes_table(
    result: Result,
    *,
    every_score: bool = False,
    scores: Sequence[ScoreColumn] | None = None,
    uncertainties: Mapping[str, Mapping[str, Between]] | None = None,
    floors: bool = False,
) -> Table:
    """Lay out one result: a row a scene, the average over scenes, the mean over all queries."""
    if scores is None:
        scores = [c for c in result.columns if every_score or c.headline]
    own = MethodRow("", values_by_scene(result.columns, result), uncertainties or {})
    # Where a scene is one query, their number says nothing.
    counted = "points" if result.unit == "scene" else "queries"
    titles = result.truth.scene_titles
    rows = [
        Row((Cell(titles[s]), Cell(result.counts[s].get(counted)), *own.cells([s], scores)))
        for s in result.scenes
    ]
    floor = floor_note(result)
    average = Cell(AVERAGE, mark=FLOOR_MARK * bool(floor))
    rows.append(Row((average, Cell(None), *own.cells([OVERALL], scores)), summary=True))
    total = sum(counts["queries"] for counts in result.counts.values())
    if total > len(result.scenes):
        pooled = [Cell(as_shown(score, result.pooled[score.key])) for score in scores]
        rows.append(Row((Cell(POOLED), Cell(total), *pooled), summary=True))
    references = result.references if floors else {}
    for name, reference in references.items():
        row = MethodRow(name, values_by_scene(result.columns, reference), floor=True)
        # The average first: the name alone is short, and of one scene it is all there is to say.
        parts = {OVERALL: name}
        if len(reference.scenes) > 1:
            parts |= {scene: f"in {titles[scene]}" for scene in result.scenes}
        for scene, title in parts.items():
            cells = (Cell(title), Cell(None), *row.cells([scene], scores))
            rows.append(Row(cells, summary=True, floor=True))
    meanings = [f"{name}: {reference.meaning}" for name, reference in references.items()]
    return Table(
        f"{result.predictions.method} on {result.protocol.name} v{result.protocol.version}",
        (Column("Scene"), Column(counted.capitalize()), *map(score_column, scores)),
        tuple(rows),
        (*meanings, *notes_of(result), identity(result)),
        legend=(*meanings, *filter(None, [floor])),
    )
