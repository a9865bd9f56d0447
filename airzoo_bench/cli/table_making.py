"""Builds the table that `airzoo-bench table` prints of its options."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from airzoo_bench.benchmark.folder import data_here
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.registry import load_track
from airzoo_bench.protocol.model import find_protocol, shipped_protocols
from airzoo_bench.results.comparable import check_score, find_scene, scores_by_name
from airzoo_bench.results.records import Method, read_records
from airzoo_bench.results.result import Result, read_result, result_paths
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables import layouts, marks
from airzoo_bench.tables.comparison import with_intervals
from airzoo_bench.tables.layouts import (
    MethodTable,
    empty_table,
    method_table,
    with_floors,
    with_published,
)
from airzoo_bench.tables.model import Table
from airzoo_bench.tables.published import OVERALL, published_values


class _Part(NamedTuple):
    """The methods of one protocol, with their results and files."""

    table: MethodTable
    results: Sequence[Result] = ()
    paths: Sequence[Path] = ()


def make_table(asked: Any) -> Table:
    """Read the results that the options name, lay them out and mark the best."""
    parts = _read_parts(asked)
    layout = _choose_layout(asked, parts)
    wanted, tables = asked.scores or (), []
    for name in wanted:
        check_score(name, [c for part in parts for c in part.table.scores], "--score")
    for part in parts:
        known = scores_by_name(part.table.scores)
        scores = tuple(dict.fromkeys(known[name] for name in wanted if name in known))
        if scores or not wanted:
            table = replace(part.table, scores=scores or part.table.scores)
            tables.append(_add_rows(asked, layout, part._replace(table=table)))
    if not any(table.rows for table in tables):
        titles = ", ".join(table.title for table in tables)
        raise UsageError(f"nothing is published on {titles} for layout {layout}")
    if layout == "result":
        made = layouts.scenes_table(parts[0].results[0], floors=asked.floors, methods=tables[0])
    elif layout == "benchmarks":
        made = layouts.benchmarks_layout(tables)
    elif layout == "methods":
        made = layouts.methods_layout(tables[0], asked.scene)
    else:
        made = layouts.scenes_layout(tables[0])
    if asked.decimals is not None:
        made = marks.with_decimals(made, asked.decimals)
    if layout == "result":
        return made
    made = marks.highlight(marks.mark_best(made), asked.highlight or ())
    made = marks.add_citations(made, asked.cite or ())
    return marks.add_gains(made, asked.baseline or ())


def _choose_layout(asked: Any, parts: Sequence[_Part]) -> str:
    """Return the layout for these results; refuse one that cannot show them or the options."""
    among_methods = ("scene", "published", "baseline", "highlight", "cite")
    compares = any(getattr(asked, name) for name in among_methods)
    several = sum(len(part.results) for part in parts) > 1
    layout: str | None = asked.layout
    if layout is None:  # one result has nothing to be compared with, unless that is asked for
        layout = "methods" if compares or several else "result"
        layout = "benchmarks" if len(parts) > 1 else layout
    allowed = {
        "result": not compares and not several,
        "methods": len(parts) == 1,
        "scenes": len(parts) == 1 and not asked.scene,
        "benchmarks": not asked.scene,
    }
    if not allowed[layout]:
        raise UsageError(
            f"layout {layout} does not go with these results or options",
            expected="result: one result alone; methods, scenes: of one protocol; --scene: methods",
        )
    return layout


def _read_parts(asked: Any) -> list[_Part]:
    """Read the results by protocol, and protocols for the numbers that are published on them."""
    names = [name for name in asked.results if asked.published and name in shipped_protocols()]
    paths = result_paths([one for one in asked.results if one not in names])
    results = [read_result(path) for path in paths]
    every_score = asked.every or bool(asked.scores)
    groups: dict[str, list[tuple[Result, Path]]] = {}
    for result, path in zip(results, paths, strict=True):
        groups.setdefault(result.protocol.name, []).append((result, path))
    parts = []
    for pairs in groups.values():
        some, files = zip(*pairs, strict=True)
        parts.append(_Part(method_table(some, paths=files, every_score=every_score), some, files))
    for protocol in (find_protocol(name, data_here()) for name in names):
        columns = load_track(protocol.track).scores(protocol)
        scores = [column for column in columns if every_score or column.headline]
        parts.append(_Part(empty_table(protocol, scores)))
    return parts


def _add_rows(asked: Any, layout: str, part: _Part) -> MethodTable:
    """Add intervals, published rows and floors, where they are asked for."""
    table = part.table
    scenes = [OVERALL if asked.scene is None else find_scene(table.scenes, asked.scene)]
    if layout in ("result", "scenes"):
        scenes = [*table.scenes, OVERALL]
    if asked.intervals and part.results:
        triples = zip(table.rows, part.results, part.paths, strict=True)
        methods = [Method(row.method, result, read_records(path)) for row, result, path in triples]
        table = with_intervals(table, methods, ResamplingConfig(), scenes)
    if asked.published:
        table = with_published(
            table,
            published_values(table.benchmark, table.track),
            scenes,
            part.results[0].protocol.fingerprint if part.results else "",
        )
    if not part.results and not asked.scores:
        printed = {key for row in table.rows for values in row.values.values() for key in values}
        table = replace(table, scores=tuple(s for s in table.scores if s.key in printed))
    if asked.floors and part.results and layout != "result":
        table = with_floors(table, part.results)
    return table
