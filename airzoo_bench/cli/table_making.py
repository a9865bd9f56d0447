"""Builds the table that `airzoo-bench table` prints of its options."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from airzoo_bench.benchmark.folder import data_here
from airzoo_bench.cli.common import Format, Layout
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.registry import load_track
from airzoo_bench.core.validation import nearest
from airzoo_bench.protocol.model import find_protocol, shipped_protocols
from airzoo_bench.results.comparable import check_score, find_scene, named_scores
from airzoo_bench.results.files import method_names, result_paths, results_here
from airzoo_bench.results.records import Scored, read_records
from airzoo_bench.results.result import Result, read_result, score_columns
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables import layouts, marks
from airzoo_bench.tables.intervals import with_intervals
from airzoo_bench.tables.method_table import (
    MethodTable,
    empty_table,
    method_table,
    with_floors,
    with_published,
)
from airzoo_bench.tables.model import Table
from airzoo_bench.tables.published import OVERALL, published_sources, published_tables


@dataclass(frozen=True)
class _Part:
    """The methods of one protocol, with their results and files."""

    table: MethodTable
    results: Sequence[Result] = ()
    paths: Sequence[Path] = ()


def make_table(asked: Any) -> Table:
    """Read the results that the options name, lay them out and mark the best."""
    parts = _read_parts(asked)
    layout = _choose_layout(asked, len(parts), sum(len(part.results) for part in parts))
    wanted = asked.scores or ()
    for name in wanted:
        check_score(name, [c for part in parts for c in part.table.scores], "--score")
    tables, left_out = [], []
    for part in parts:
        known = named_scores(part.table.scores)
        scores = tuple(dict.fromkeys(known[name] for name in wanted if name in known))
        if wanted and not scores:
            left_out.append(part.table.title)
        else:
            chosen = replace(part.table, scores=scores or part.table.scores)
            tables.append(_filled(asked, layout, replace(part, table=chosen)))
    if not any(table.rows for table in tables):
        titles = ", ".join(table.title for table in tables)
        raise UsageError(
            f"nothing is published on {titles} for layout {layout}",
            fix="name a protocol of a benchmark in protocols/published, or another --layout",
        )
    made = _laid_out(asked, layout, tables, parts[0])
    if left_out:
        note = f"left out, having no {' or '.join(wanted)}: {', '.join(left_out)}"
        made = replace(made, notes=(note, *made.notes))
    if asked.decimals is not None:
        made = marks.with_decimals(made, asked.decimals)
    if layout is Layout.RESULT:
        return made
    made = marks.highlight(marks.mark_best(made, second=asked.second), asked.highlight or ())
    baselines = marks.parse_baselines(made, asked.baseline or ())
    made = marks.add_citations(made, asked.cite or (), published_sources())
    return marks.add_gains(made, baselines)


def _choose_layout(asked: Any, protocols: int, results: int) -> Layout:
    """Return the layout for these numbers of results; refuse options that do not go with it."""
    among_methods = ("scene", "published", "second", "baseline", "highlight", "cite")
    options = [f"--{name}" for name in among_methods if getattr(asked, name)]
    layout: Any = asked.layout
    if layout is None:  # one result has nothing to be compared with, unless that is asked for
        layout = Layout.METHODS if options or results > 1 else Layout.RESULT
        layout = Layout.BENCHMARKS if protocols > 1 else layout
    wrong = ""
    if layout is Layout.RESULT and (options or results > 1):
        wrong = f"layout result shows one result alone, and here are {results} results "
        wrong += " ".join(options)
    elif asked.scene and layout is not Layout.METHODS:
        wrong = f"--scene does not go with layout {layout}"
    elif layout in (Layout.METHODS, Layout.SCENES) and protocols > 1:
        wrong = f"layout {layout} is for one protocol, and here are {protocols}"
    if wrong:
        others = [str(one) for one in Layout if one is not layout]
        raise UsageError(wrong.rstrip(), fix=f"choose --layout {', '.join(others)}")
    if asked.cite and asked.form is not Format.LATEX:
        raise UsageError("--cite is for LaTeX", fix="add --format latex")
    return Layout(layout)


def _read_parts(asked: Any) -> list[_Part]:
    """Read the results by protocol, and protocols for the numbers that are published on them."""
    names = [name for name in asked.results if asked.published and name in shipped_protocols()]
    paths = result_paths(results_here([one for one in asked.results if one not in names]))
    results = _renamed([read_result(path) for path in paths], paths, asked.rename or ())
    every_score = asked.every or bool(asked.scores)
    groups: dict[str, list[tuple[Result, Path]]] = {}
    for result, path in zip(results, paths, strict=True):
        groups.setdefault(result.protocol.name, []).append((result, path))
    parts = []
    for pairs in groups.values():
        some, files = zip(*pairs, strict=True)
        parts.append(_Part(method_table(some, paths=files, every_score=every_score), some, files))
    for protocol in (find_protocol(name, data_here()) for name in names):
        columns = score_columns(load_track(protocol.track).scores(protocol))
        scores = [column for column in columns if every_score or column.headline]
        parts.append(_Part(empty_table(protocol, scores)))
    return parts


def _renamed(
    results: Sequence[Result], paths: Sequence[Path], texts: Sequence[str]
) -> list[Result]:
    """Give methods the names that --rename asks for."""
    known = method_names(paths, results)
    names: dict[str, str] = {}
    for text in texts:
        old, _, new = map(str.strip, text.rpartition("="))
        if old not in known or not new:
            near = nearest(text.partition("=")[0][:80], known)
            raise UsageError(
                f"{text[:80]!r} gives no method a new name{near}",
                where="--rename",
                expected="OLD=NEW, with OLD one of " + ", ".join(known[:30]),
            )
        names[old] = new
    changed = []
    for result, name in zip(results, known, strict=True):
        used = {"method": names.get(name, result.predictions.method)}
        predictions = result.predictions.model_copy(update=used)
        changed.append(result.model_copy(update={"predictions": predictions}))
    return changed


def _filled(asked: Any, layout: Layout, part: _Part) -> MethodTable:
    """Add intervals, published rows and floors, where they are asked for."""
    table = part.table
    scenes = [OVERALL if asked.scene is None else find_scene(table.scenes, asked.scene)]
    if layout in (Layout.RESULT, Layout.SCENES):
        scenes = [*table.scenes, OVERALL]
    if asked.intervals and part.results:
        triples = zip(table.rows, part.results, part.paths, strict=True)
        methods = [Scored(row.method, result, read_records(path)) for row, result, path in triples]
        table = with_intervals(table, methods, ResamplingConfig(), scenes)
    if asked.published:
        table = with_published(
            table,
            published_tables(table.benchmark, table.track),
            by_scene=scenes != [OVERALL],
            average=OVERALL in scenes,
            fingerprint=part.results[0].protocol.fingerprint if part.results else "",
        )
    if not part.results and not asked.scores:
        printed = {key for row in table.rows for values in row.values.values() for key in values}
        table = replace(table, scores=tuple(s for s in table.scores if s.key in printed))
    if asked.floors and part.results and layout is not Layout.RESULT:
        table = with_floors(table, part.results)
    return table


def _laid_out(asked: Any, layout: Layout, tables: Sequence[MethodTable], part: _Part) -> Table:
    first = tables[0]
    if layout is Layout.BENCHMARKS:
        return layouts.benchmarks_layout(tables)
    if layout is Layout.METHODS:
        return layouts.methods_layout(first, asked.scene)
    if layout is Layout.SCENES:
        return layouts.scenes_layout(first)
    spans = first.rows[0].uncertainties
    made = layouts.scenes_table(
        part.results[0], scores=first.scores, uncertainties=spans, floors=asked.floors
    )
    legend = (*first.about_intervals, *made.legend)
    return replace(made, notes=(*first.notes, *made.notes), legend=legend)
