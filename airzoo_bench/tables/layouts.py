"""Layouts of results: one by scene; methods by average, by scene, and over several benchmarks."""

from __future__ import annotations

from collections.abc import Sequence

from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from airzoo_bench.results.comparable import find_scene
from airzoo_bench.results.result import Result, ScoreColumn
from airzoo_bench.tables.method_table import (
    UNITS,
    MethodRow,
    MethodTable,
    as_shown,
    method_table,
    score_column,
    share_notes,
    values_by_scene,
)
from airzoo_bench.tables.model import Cell, Column, Row, Table
from airzoo_bench.tables.published import OVERALL

AVERAGE = "Average"
"""The title of the average over scenes."""


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


def methods_layout(methods: MethodTable, scene: str | None = None) -> Table:
    """Lay out a row a method, a column a score: of the average over scenes, or of one scene."""
    key = OVERALL if scene is None else find_scene(methods.scenes, scene)
    return Table(
        f"{methods.title}, {methods.scenes.get(key, 'average over scenes')}",
        (Column("Method"), *map(score_column, methods.scores)),
        _rows(methods, [key]),
        methods.notes,
        legend=methods.legend,
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
        (_units_note(methods.scores), *methods.notes),
        legend=methods.legend,
    )


def _units_note(scores: Sequence[ScoreColumn]) -> str:
    """Say the units of scores, for tables with other titles above the columns."""
    titles: dict[str, dict[str, None]] = {}
    for score in scores:
        titles.setdefault(UNITS[score.unit], {})[score.title] = None
    return "; ".join(f"{', '.join(those)} in {unit}" for unit, those in titles.items())


def benchmarks_layout(parts: Sequence[MethodTable]) -> Table:
    """Lay out a row a method and benchmarks side by side, the average of each over its scenes."""
    tracks = [part.track for part in parts]
    parts = sorted(parts, key=lambda part: tracks.index(part.track))
    titles = _benchmark_titles(parts)
    by_name = [{(r.floor, r.method, bool(r.reported)): r for r in part.rows} for part in parts]
    rows = []
    for key in sorted(dict.fromkeys(key for part in by_name for key in part), key=lambda k: k[0]):
        entries = [part.get(key, MethodRow(key[1], {})) for part in by_name]
        pairs = zip(parts, entries, strict=True)
        cells = [cell for part, row in pairs for cell in row.cells([OVERALL], part.scores)]
        reported = "; ".join(filter(None, dict.fromkeys(row.reported for row in entries)))
        rows.append(Row((Cell(key[1]), *cells), key[0], reported=reported, floor=key[0]))
    named = list(zip(titles, parts, strict=True))
    legend = share_notes(((t, note) for t, part in named for note in part.legend), len(parts))
    rest = ((t, n) for t, part in named for n in part.notes if n not in part.legend)
    notes = share_notes(rest, len(parts))
    return Table(
        "Averages over scenes: " + ", ".join(part.title for part in parts),
        (Column("Method"), *(score_column(s, title) for title, part in named for s in part.scores)),
        tuple(rows),
        (_units_note([score for part in parts for score in part.scores]), *legend, *notes),
        legend=tuple(legend),
    )


def _benchmark_titles(parts: Sequence[MethodTable]) -> list[str]:
    """Return the title of each benchmark, or of the protocol where several have the same."""
    protocols = [load_protocol(path) for path in shipped_protocols().values()]
    # A protocol's title is the benchmark's, and behind a comma what is measured.
    shipped = {protocol.benchmark: protocol.title.partition(",")[0] for protocol in protocols}
    names = [shipped.get(part.benchmark, part.benchmark) for part in parts]
    return [
        name if names.count(name) == 1 else part.title
        for name, part in zip(names, parts, strict=True)
    ]


def scenes_table(
    result: Result,
    *,
    floors: bool = False,
    methods: MethodTable | None = None,
) -> Table:
    """Lay out one result: a row a scene, the average over scenes, the mean over all queries.

    `methods` holds the same result with chosen scores, its intervals and their notes.
    """
    methods = methods or method_table([result])
    scores, [own] = methods.scores, methods.rows
    # Where a scene is one query, their number says nothing.
    counted = "points" if result.unit == "scene" else "queries"
    titles = result.truth.scene_titles
    rows = [
        Row((Cell(titles[s]), Cell(result.counts[s].get(counted)), *own.cells([s], scores)))
        for s in result.scenes
    ]
    average = Cell(AVERAGE, mark=own.mark)
    rows.append(Row((average, Cell(None), *own.cells([OVERALL], scores)), summary=True))
    total = sum(counts["queries"] for counts in result.counts.values())
    if total > len(result.scenes):
        pooled = [Cell(as_shown(score, result.pooled[score.key])) for score in scores]
        rows.append(Row((Cell("Pooled"), Cell(total), *pooled), summary=True))
    references = result.references if floors else {}
    for name, reference in references.items():
        row = MethodRow(name, values_by_scene(result.columns, reference))
        cells = (Cell(name), Cell(None), *row.cells([OVERALL], scores))
        rows.append(Row(cells, summary=True, floor=True))
    return Table(
        f"{own.method} on {methods.title}",
        (Column("Scene"), Column(counted.capitalize()), *map(score_column, scores)),
        tuple(rows),
        methods.notes,
        legend=methods.legend,
    ).with_notes(*(f"{name}: {one.meaning}" for name, one in references.items()), first=True)
