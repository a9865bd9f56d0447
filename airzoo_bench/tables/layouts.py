"""Layouts of tables of methods: by average, by scene, and over several benchmarks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.results.selection import find_scene
from airzoo_bench.tables.method_table import OVERALL, MethodRow, MethodTable, score_column
from airzoo_bench.tables.model import Cell, Column, Row, Table

__all__ = ["AVERAGE", "benchmark_titles", "benchmarks_layout", "methods_layout", "scenes_layout"]

AVERAGE = "Average"
"""The head of the average over scenes, where scenes stand side by side."""

_Key = tuple[str, bool, bool, int]


def methods_layout(board: MethodTable, scene: str | None = None) -> Table:
    """Lay out a row a method, a column a score: of the average over scenes, or of one scene.

    Parameters
    ----------
    board : MethodTable
    scene : str, optional
        Id or title.

    Raises
    ------
    ResultError
        There is no such scene, or several have that title.
    """
    key = OVERALL if scene is None else find_scene(board.scenes, scene)
    columns = (Column("Method"), *map(score_column, board.scores))
    cells = [[entry.cell(key, score) for score in board.scores] for entry in board.entries]
    title = f"{board.title}, {board.scenes.get(key, 'average over scenes')}"
    return Table(
        title, columns, _rows(board.entries, cells), board.all_notes, legend=board.whole_legend
    )


def scenes_layout(
    board: MethodTable, *, average: bool = True, queries: bool = False, per_block: int | None = None
) -> Table:
    """Lay out scenes side by side, the scores under each, and the average over scenes last.

    Parameters
    ----------
    board : MethodTable
    average : bool
    queries : bool
        Write the number of queries behind a scene's title.
    per_block : int, optional
        How many scenes stand side by side where a format breaks the table; two by default, or one
        where two would have more than twelve columns.
    """
    heads = {key: _head(board, key, queries) for key in board.scenes}
    # Of published scenes alone an average may be printed nowhere.
    has_average = any(entry.values.get(OVERALL) for entry in board.entries)
    heads |= {OVERALL: AVERAGE} if average and has_average else {}
    columns = [score_column(score, head) for head in heads.values() for score in board.scores]
    cells = [
        [entry.cell(key, score) for key in heads for score in board.scores]
        for entry in board.entries
    ]
    return Table(
        f"{board.title}, by scene",
        (Column("Method"), *columns),
        _rows(board.entries, cells),
        (_units_note(board.scores), *board.all_notes),
        per_block or 2,
        fixed=per_block is not None,
        legend=board.whole_legend,
    )


def benchmarks_layout(boards: Sequence[MethodTable], *, per_block: int | None = None) -> Table:
    """Lay out a row a method and benchmarks side by side, the average of each over its scenes.

    Benchmarks of one track follow each other, in the order of the first ones.

    Parameters
    ----------
    boards : sequence of MethodTable
        Each of another protocol.
    per_block : int, optional
        How many benchmarks stand side by side where a format breaks the table; up to four by
        default, as their width allows.
    """
    tracks = [board.track for board in boards]
    boards = sorted(boards, key=lambda board: tracks.index(board.track))
    heads = benchmark_titles(boards)
    numbered = [_numbered(board.entries) for board in boards]
    keys = sorted(dict.fromkeys(key for found in numbered for key in found), key=_is_floor)
    columns = [
        score_column(score, head, board.track)
        for board, head in zip(boards, heads, strict=True)
        for score in board.scores
    ]
    rows = tuple(_across(key, boards, numbered) for key in keys)
    scores = [score for board in boards for score in board.scores]
    said = _notes_of(boards, heads)
    made_by = [f"{board.title}: {board.identity}" for board in boards if board.identity]
    title = "Averages over scenes: " + ", ".join(board.title for board in boards)
    columns = [Column("Method"), *columns]
    legend = dict.fromkeys(said[note] for board in boards for note in board.whole_legend)
    return Table(
        title,
        tuple(columns),
        rows,
        (_units_note(scores), *said.values(), *made_by),
        per_block or 4,
        fixed=per_block is not None,
        legend=tuple(legend),
    )


def _notes_of(boards: Sequence[MethodTable], heads: Sequence[str]) -> dict[str, str]:
    """Return what is said for each note of boards; what is not of all says of which it is."""
    titles: dict[str, list[str]] = {}
    for board, head in zip(boards, heads, strict=True):
        for note in (*board.notes, *board.method_notes):
            titles.setdefault(note, []).append(head)
    of_all = {note for board in boards for note in board.legend}
    of_all |= {note for note, those in titles.items() if len(those) == len(boards)}
    return {n: n if n in of_all else f"{', '.join(those)}: {n}" for n, those in titles.items()}


def _rows(entries: Sequence[MethodRow], cells: Sequence[list[Cell]]) -> tuple[Row, ...]:
    return tuple(
        Row(
            (Cell(entry.method), *own),
            summary=entry.floor,
            reported=entry.reported,
            floor=entry.floor,
        )
        for entry, own in zip(entries, cells, strict=True)
    )


def _head(board: MethodTable, key: str, queries: bool) -> str:
    number = board.queries.get(key)
    counted = queries and number is not None
    return f"{board.scenes[key]} ({number})" if counted else board.scenes[key]


def _units_note(scores: Sequence[ScoreColumn]) -> str:
    by_unit: dict[str, dict[str, None]] = {}
    for score in scores:
        by_unit.setdefault(score_column(score).unit, {})[score.title] = None
    most = max(by_unit, key=lambda unit: len(by_unit[unit]))
    rest = by_unit.pop(most)
    named = [f"{', '.join(titles)} in {unit}" for unit, titles in by_unit.items()]
    # Where units differ, naming those of the fewer scores is enough.
    others = "all other scores" if named else ", ".join(rest)
    return "; ".join([*named, f"{others} in {most}"])


def _is_floor(key: _Key) -> bool:
    return key[2]


def _numbered(entries: Sequence[MethodRow]) -> dict[_Key, MethodRow]:
    """Return entries by what makes them one row across benchmarks: two of one name stay two."""
    seen: Counter[tuple[str, bool, bool]] = Counter()
    found = {}
    for entry in entries:
        name = (entry.method, bool(entry.reported), entry.floor)
        found[(*name, seen[name])] = entry
        seen[name] += 1
    return found


def _across(
    key: _Key, boards: Sequence[MethodTable], numbered: Sequence[dict[_Key, MethodRow]]
) -> Row:
    empty = MethodRow(key[0], {})
    cells = [
        found.get(key, empty).cell(OVERALL, score)
        for board, found in zip(boards, numbered, strict=True)
        for score in board.scores
    ]
    sources = dict.fromkeys(found[key].reported for found in numbered if key in found)
    return Row(
        (Cell(key[0]), *cells),
        summary=_is_floor(key),
        reported="; ".join(source for source in sources if source),
        floor=_is_floor(key),
    )


def benchmark_titles(boards: Sequence[MethodTable]) -> list[str]:
    """Return a head for each board: the benchmark's title, and what more tells them apart.

    That is the track, such as in ``AirZoo-Mini, matching``, or else the protocol's name. The title
    is that of a shipped protocol; a benchmark that has none goes by its name.
    """
    titles = _shipped_titles()
    benchmarks = [titles.get(board.benchmark, board.benchmark) for board in boards]
    tracks = [f"{name}, {b.track}" for name, b in zip(benchmarks, boards, strict=True)]
    heads = []
    for benchmark, track, board in zip(benchmarks, tracks, boards, strict=True):
        alone = benchmarks.count(benchmark) == 1
        heads.append(benchmark if alone else track if tracks.count(track) == 1 else board.title)
    return heads


def _shipped_titles() -> dict[str, str]:
    # A protocol's title is the benchmark's, and behind a comma what is measured.
    protocols = [load_protocol(path) for path in shipped_protocols().values()]
    return {protocol.benchmark: protocol.title.partition(",")[0] for protocol in protocols}
