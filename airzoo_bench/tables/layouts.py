"""Tables of methods, scored here or printed in papers, with floors, and their layouts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from airzoo_bench.protocol.model import Protocol, load_protocol, shipped_protocols
from airzoo_bench.results.comparison import FLOOR_MARK, check_comparable, find_scene, floor_note
from airzoo_bench.results.result import Reference, Result, ScoreColumn, method_names
from airzoo_bench.statistics.intervals import Interval
from airzoo_bench.tables.model import Cell, Column, Row, Table
from airzoo_bench.tables.published import OVERALL, PrintedValue

AVERAGE = "Average"  # the title of the average over scenes
UNITS = {"share": "%", "m": "m", "deg": "deg"}
"""What tables show for the unit of a score."""


# --- a score as tables show it ---


def as_shown(score: ScoreColumn, value: float) -> float:
    """Turn a result's value into what tables show: percent for a share."""
    return 100.0 * value if score.unit == "share" else value


def score_column(score: ScoreColumn, group: str = "") -> Column:
    """Return a score's column."""
    return Column(score.title, UNITS[score.unit], score.higher_is_better, group=group)


def score_cell(score: ScoreColumn, value: float | None, interval: Interval | None = None) -> Cell:
    """Return a value as tables show it, with its interval where there is one."""
    if value is None:
        return Cell(None)
    return Cell(as_shown(score, value), uncertainty=limits_shown(score, interval))


def limits_shown(score: ScoreColumn, interval: Interval | None) -> tuple[float, float] | None:
    """Return the limits of an interval as tables show them; None where there are none."""
    if interval is None or interval.low is None or interval.high is None:
        return None
    return as_shown(score, interval.low), as_shown(score, interval.high)


def score_texts(score: ScoreColumn, values: Iterable[float | None]) -> list[str]:
    """Write values of a score as tables do."""
    return [score_cell(score, None if v is None else float(v)).text(2) for v in values]


def share_notes(notes: Iterable[tuple[str, str]], everyone: int = 0) -> list[str]:
    """Return each note once, after the names that have it, if these are not all."""
    users: dict[str, dict[str, None]] = {}
    for name, note in notes:
        users.setdefault(note, {})[name] = None
    return [
        note if len(who) == everyone else f"{', '.join(who)}: {note}" for note, who in users.items()
    ]


# --- methods ---


@dataclass(frozen=True)
class MethodRow:
    """A method's numbers in percent, metres and degrees, by scene or `OVERALL`, then by score.

    The other fields are those of a `Row` and of its first cell.
    """

    method: str
    values: Mapping[str, Mapping[str, float]]
    intervals: Mapping[str, Mapping[str, tuple[float, float] | None]] = field(default_factory=dict)
    reported: str = ""
    floor: bool = False
    mark: str = ""

    def cells(self, scenes: Iterable[str], scores: Sequence[ScoreColumn]) -> list[Cell]:
        """Return the cells of scores in scenes, without a number where there is none."""
        values, spans = self.values, self.intervals
        return [
            Cell(values.get(s, {}).get(c.key), uncertainty=spans.get(s, {}).get(c.key))
            for s in scenes
            for c in scores
        ]


@dataclass(frozen=True)
class MethodTable:
    """Methods of one protocol and truth before they are laid out; `scenes` are titles by scene."""

    title: str
    benchmark: str
    track: str
    scores: tuple[ScoreColumn, ...]
    scenes: Mapping[str, str]
    rows: tuple[MethodRow, ...] = ()
    notes: tuple[str, ...] = ()


def method_table(
    results: Sequence[Result], *, paths: Sequence[Path] = (), wanted: Sequence[str] | None = ()
) -> MethodTable:
    """Put results of one protocol and truth into a table, with ‡ by `wanted` scores; None: all."""
    every = wanted is None or bool(wanted)
    names = method_names(paths, results) if paths else [r.predictions.method for r in results]
    files = [f"{name} ({path})" for name, path in zip(names, paths, strict=False)]
    check_comparable(files or names, results)
    first, named = results[0], list(zip(names, results, strict=True))
    floors = {name: floor_note(result, wanted or ()) for name, result in named}
    rows = (
        MethodRow(name, _values_shown(r.columns, r), mark=FLOOR_MARK * bool(floors[name]))
        for name, r in named
    )
    prints = f"protocol {first.protocol.fingerprint[:12]}, truth {first.truth.fingerprint[:12]}"
    hidden = {c.title for r in results for c in r.columns if not (every or c.headline)}
    noted = ((name, note) for name, r in named for note in r.notes)
    # A note may begin with the titles of the scores that it is about.
    seen = [pair for pair in noted if {*pair[1].split(": ")[0].split(", ")} - hidden]
    notes = share_notes(seen, len(names))
    marks = share_notes((pair for pair in floors.items() if pair[1]), len(names) == 1)
    # A score that a method has not stays empty.
    scores = {c.key: c for r in results for c in r.columns if every or c.headline}
    return MethodTable(
        f"{first.protocol.name} v{first.protocol.version}",
        first.truth.benchmark,
        first.track,
        tuple(scores.values()),
        first.truth.scene_titles,
        tuple(rows),
        (*notes, *marks, f"{prints}, airzoo-bench {first.versions['airzoo-bench']}"),
    )


def _values_shown(
    scores: Sequence[ScoreColumn], numbers: Result | Reference
) -> dict[str, dict[str, float]]:
    by_key = {score.key: score for score in scores}
    return {
        scene: {key: as_shown(by_key[key], value) for key, value in part.items()}
        for scene, part in ({OVERALL: numbers.overall} | numbers.scenes).items()
    }


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
        where = f"{'by scene ' * by_scene}on {methods.benchmark} ({methods.track})"
        return replace(methods, notes=(f"nothing is published {where}", *methods.notes))
    shipped = (load_protocol(path) for path in shipped_protocols().values())
    if fingerprint and fingerprint not in {protocol.fingerprint for protocol in shipped}:
        note = f"{methods.title} is not the shipped protocol: reported numbers may measure "
        methods = replace(methods, notes=(note + "something else", *methods.notes))
    reported = (MethodRow(m, v, reported="; ".join(sources[m])) for m, v in rows.items())
    return replace(methods, rows=(*reported, *methods.rows))


def with_floors(methods: MethodTable, results: Sequence[Result]) -> MethodTable:
    """Put what scores without a method behind the rows of methods, and say what it is."""
    found = shared_references(results)
    scores = [column for result in results for column in result.columns]
    rows = (MethodRow(n, _values_shown(scores, one), floor=True) for n, one in found.items())
    meanings = (f"{name}: {one.meaning}" for name, one in found.items())
    return replace(methods, rows=(*methods.rows, *rows), notes=(*meanings, *methods.notes))


def shared_references(results: Sequence[Result]) -> dict[str, Reference]:
    """Return the references of results by name, the first of each name."""
    return {name: one for r in reversed(results) for name, one in r.references.items()}


# --- layouts ---


def _rows(methods: MethodTable, scenes: Sequence[str]) -> tuple[Row, ...]:
    rows = ((Cell(m.method, mark=m.mark), *m.cells(scenes, methods.scores)) for m in methods.rows)
    pairs = zip(rows, methods.rows, strict=True)
    return tuple(Row(cells, reported=m.reported, floor=m.floor) for cells, m in pairs)


def methods_layout(methods: MethodTable, scene: str | None = None) -> Table:
    """Lay out a row a method, a column a score: of the average over scenes, or of one scene."""
    key = OVERALL if scene is None else find_scene(methods.scenes, scene)
    return Table(
        f"{methods.title}, {methods.scenes.get(key, 'average over scenes')}",
        (Column("Method"), *map(score_column, methods.scores)),
        _rows(methods, [key]),
        methods.notes,
    )


def scenes_layout(methods: MethodTable) -> Table:
    """Lay out scenes side by side, the scores under each, and the average over scenes last."""
    titles = dict(methods.scenes)
    # Of published scenes alone an average may be printed nowhere.
    if any(row.values.get(OVERALL) for row in methods.rows):
        titles[OVERALL] = AVERAGE
    columns = [score_column(score, title) for title in titles.values() for score in methods.scores]
    return Table(
        f"{methods.title}, by scene",
        (Column("Method"), *columns),
        _rows(methods, list(titles)),
        (_units_note(methods.scores), *methods.notes),
    )


def _units_note(scores: Iterable[ScoreColumn]) -> str:
    """Say the units of scores, for tables with other titles above the columns."""
    units = {score.title: UNITS[score.unit] for score in scores}
    titles = {unit: [t for t, its in units.items() if its == unit] for unit in units.values()}
    *others, (usual, most) = sorted(titles.items(), key=lambda item: len(item[1]))
    known = [f"{', '.join(those)} in {unit}" for unit, those in others]
    rest = ", ".join(most) if len(most) <= 2 else "all other scores" if others else "all scores"
    return "; ".join([*known, f"{rest} in {usual}"])


def benchmarks_layout(parts: Sequence[MethodTable]) -> Table:
    """Lay out a row a method and benchmarks side by side, the average of each over its scenes."""
    tracks = [part.track for part in parts]
    parts = sorted(parts, key=lambda part: tracks.index(part.track))
    # A protocol's title is the benchmark's, and behind a comma what is measured.
    shipped = (load_protocol(path) for path in shipped_protocols().values())
    titles = {protocol.benchmark: protocol.title.partition(",")[0] for protocol in shipped}
    benchmarks = [part.benchmark for part in parts]
    named = [
        (titles.get(b, b) if benchmarks.count(b) == 1 else part.title, part)
        for b, part in zip(benchmarks, parts, strict=True)
    ]
    by_key = [{(r.floor, r.method, bool(r.reported)): r for r in part.rows} for part in parts]
    rows = []
    for key in sorted(dict.fromkeys(key for part in by_key for key in part), key=lambda k: k[0]):
        found = [part.get(key, MethodRow(key[1], {}, floor=key[0])) for part in by_key]
        method = Cell(found[0].method, mark=max(row.mark for row in found))
        pairs = zip(found, parts, strict=True)
        cells = (cell for row, part in pairs for cell in row.cells([OVERALL], part.scores))
        reported = "; ".join(dict.fromkeys(row.reported for row in found if row.reported))
        rows.append(Row((method, *cells), reported=reported, floor=found[0].floor))
    scores = [(score, title) for title, part in named for score in part.scores]
    notes = share_notes(((t, note) for t, part in named for note in part.notes), len(parts))
    return Table(
        "Averages over scenes: " + ", ".join(part.title for part in parts),
        (Column("Method"), *(score_column(*pair) for pair in scores)),
        tuple(rows),
        (_units_note(score for score, _ in scores), *notes),
    )


def scenes_table(
    result: Result, *, floors: bool = False, methods: MethodTable | None = None
) -> Table:
    """Lay out one result: a row a scene, the average over scenes, the mean over all queries.

    `methods` holds the same result with chosen scores, its intervals and their notes.
    """
    methods = methods or method_table([result])
    methods = with_floors(methods, [result]) if floors else methods
    scores, (own, *references) = methods.scores, methods.rows
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
    for row in references:
        cells = (Cell(row.method), Cell(None), *row.cells([OVERALL], scores))
        rows.append(Row(cells, summary=True, floor=True))
    return Table(
        f"{own.method} on {methods.title}",
        (Column("Scene"), Column(counted.capitalize()), *map(score_column, scores)),
        tuple(rows),
        methods.notes,
    )
