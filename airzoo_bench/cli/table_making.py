"""Builds the table that `airzoo-bench table` prints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from airzoo_bench.cli.common import scores_of
from airzoo_bench.cli.table_request import Layout, TableRequest
from airzoo_bench.core.errors import UsageError
from airzoo_bench.results.comparable import check_score, find_scene, named_scores
from airzoo_bench.results.files import result_paths, results_here
from airzoo_bench.results.result import Result, ScoreColumn, read_result
from airzoo_bench.tables import marks
from airzoo_bench.tables.layouts import (
    AVERAGE,
    POOLED,
    benchmarks_layout,
    methods_layout,
    scenes_layout,
    scenes_table,
)
from airzoo_bench.tables.method_table import (
    OVERALL,
    MethodTable,
    method_table,
    with_floors,
    with_published,
)
from airzoo_bench.tables.model import Table
from airzoo_bench.tables.published import (
    published_benchmarks,
    published_sources,
    published_tables,
    read_source_file,
    shipped_fingerprints,
)

__all__ = ["make_table"]


def make_table(asked: TableRequest) -> Table:
    """Read the results that a request names, lay them out and mark the best."""
    if asked.protocol is not None or not asked.results:
        return _published_alone(asked)
    paths = result_paths(results_here(asked.results))
    results = [read_result(path) for path in paths]
    layout = asked.layout_for(results)
    tables = _method_tables(asked, layout, paths, results)
    if layout is Layout.RESULT:
        return _table_of_one(asked, tables[0], results[0])
    if layout is Layout.BENCHMARKS:
        made = benchmarks_layout([table for table in tables if table.scores])
        titles = [table.title for table in tables if not table.scores]
        wanted = " or ".join(asked.scores or ())
        left_out = [f"left out, having no {wanted}: {', '.join(titles)}"] if titles else []
        made = replace(made, notes=(*left_out, *made.notes))
    elif layout is Layout.METHODS:
        made = methods_layout(tables[0], asked.scene)
    else:
        made = scenes_layout(tables[0], average=asked.average, queries=asked.queries)
    columns = {score.key: score for result in results for score in result.columns}
    return _marked(asked, made, list(columns.values()))


def _method_tables(
    asked: TableRequest, layout: Layout, paths: Sequence[Path], results: Sequence[Result]
) -> list[MethodTable]:
    """Return a table of methods for each protocol, with the scores to show, if it has any."""
    every_score = asked.every_score or bool(asked.scores)
    groups: dict[str, list[int]] = {}
    for place, result in enumerate(results):
        groups.setdefault(result.protocol.name, []).append(place)
    parts = [([results[p] for p in some], [paths[p] for p in some]) for some in groups.values()]
    tables = [method_table(some, paths=files, every_score=every_score) for some, files in parts]
    for name in asked.scores or ():
        check_score(name, [score for table in tables for score in table.scores], "--score")
    tables = [replace(table, scores=_chosen(table.scores, asked.scores)) for table in tables]
    return [
        _filled(asked, layout, table, *part) if table.scores else table
        for table, part in zip(tables, parts, strict=True)
    ]


def _chosen(scores: Sequence[ScoreColumn], wanted: list[str] | None) -> tuple[ScoreColumn, ...]:
    """Return the scores named by key or title, in that order; all if none is named."""
    if not wanted:
        return tuple(scores)
    by_name = named_scores(scores)
    return tuple(dict.fromkeys(by_name[name] for name in wanted if name in by_name))


def _filled(
    asked: TableRequest,
    layout: Layout,
    table: MethodTable,
    results: Sequence[Result],
    paths: Sequence[Path],
) -> MethodTable:
    """Add intervals, published rows and floors, where they are asked for."""
    if asked.intervals:
        table = _with_intervals(asked, layout, table, results, paths)
    if asked.published:
        shipped = shipped_fingerprints(table.benchmark, table.track)
        is_published = published_tables(table.benchmark, table.track)
        if is_published and results[0].protocol.fingerprint not in shipped:
            note = f"{table.title} is not the shipped protocol: reported numbers may measure "
            table = table.noted(note + "something else", legend=True)
        table = _next_to_published(asked, layout, table)
    if asked.floors and layout is not Layout.RESULT:
        table = with_floors(table, results)
        if asked.intervals:
            floors = ", ".join(entry.method for entry in table.rows if entry.floor)
            table = table.noted(*_without_interval(floors), legend=True)
    return table


def _with_intervals(
    asked: TableRequest,
    layout: Layout,
    table: MethodTable,
    results: Sequence[Result],
    paths: Sequence[Path],
) -> MethodTable:
    from airzoo_bench.results.records import Scored, read_records
    from airzoo_bench.statistics.samples import ResamplingConfig
    from airzoo_bench.tables.intervals import with_intervals

    scenes = [OVERALL if asked.scene is None else find_scene(table.scenes, asked.scene)]
    if layout in (Layout.RESULT, Layout.SCENES):
        scenes = [*table.scenes, *[OVERALL] * asked.average]
    methods = [
        Scored(entry.method, result, read_records(path))
        for entry, result, path in zip(table.rows, results, paths, strict=True)
    ]
    made = with_intervals(table, methods, ResamplingConfig(), scenes)
    return replace(made, about_intervals=made.notes[len(table.notes) :])


def _without_interval(floors: str) -> list[str]:
    return [f"no interval for {floors}: intervals are of methods"] if floors else []


def _table_of_one(asked: TableRequest, table: MethodTable, result: Result) -> Table:
    """Return the table of one result, a row a scene."""
    (entry,) = table.rows
    made = scenes_table(
        result, scores=table.scores, uncertainties=entry.uncertainties, floors=asked.floors
    )
    references = ", ".join(result.references)
    without, hint = list[str](), list[str]()
    if asked.intervals and POOLED in [row.cells[0].value for row in made.rows]:
        averages = "intervals are of scenes and of the average over scenes"
        without = [f"no interval for {POOLED}: {averages}"]
    if asked.intervals and asked.floors:
        without += _without_interval(references)
    if references and not asked.floors:
        hint = [f"not shown: {references}; --floors adds it"]
    made = replace(
        made,
        notes=(*table.notes, *without, *made.notes, *hint),
        legend=(*table.about_intervals, *without, *made.legend),
    )
    return marks.rename(_in_digits(asked, made), asked.rename or ())


def _published_alone(asked: TableRequest) -> Table:
    """Return the table of the numbers published on a protocol."""
    if asked.results or asked.protocol is None or not asked.published:
        raise UsageError(
            "results name their own protocol" if asked.results else "nothing to lay out",
            expected="result files, or --published with --protocol and no results",
            fix="such as `airzoo-bench table --published --protocol uav-visloc-retrieval`",
        )
    layout = asked.layout or Layout.METHODS
    if asked.intervals or asked.floors or layout not in (Layout.METHODS, Layout.SCENES):
        raise UsageError(
            "--intervals, --floors and other layouts than methods and scenes need results",
            fix="leave them out, or name results",
        )
    asked.check_options(layout)
    protocol, columns = scores_of(asked.protocol)
    every_score = asked.every_score or bool(asked.scores)
    scores = [column for column in columns if every_score or column.headline]
    for name in asked.scores or ():
        check_score(name, scores, "--score")
    table = MethodTable(
        f"{protocol.name} v{protocol.version}",
        protocol.benchmark,
        protocol.track,
        _chosen(scores, asked.scores),
        {scene.id: scene.title for scene in protocol.scenes},
        {},
        (),
    )
    table = _next_to_published(asked, layout, table)
    if not table.rows:
        raise UsageError(
            f"nothing is published on {table.benchmark} ({table.track})",
            where=f"--protocol {asked.protocol}",
            expected="a protocol of a benchmark of a paper's tables: "
            + ", ".join(published_benchmarks(table.track)),
            fix="see `airzoo-bench protocols`",
        )
    if not asked.scores:
        printed = {key for row in table.rows for part in row.values.values() for key in part}
        table = replace(table, scores=tuple(s for s in table.scores if s.key in printed))
    is_methods = layout is Layout.METHODS
    made = (
        methods_layout(table, asked.scene)
        if is_methods
        else scenes_layout(table, average=asked.average, queries=asked.queries)
    )
    return _marked(asked, made, columns)


def _next_to_published(asked: TableRequest, layout: Layout, table: MethodTable) -> MethodTable:
    by_scene = layout is Layout.SCENES or asked.scene is not None
    return with_published(
        table,
        published_tables(table.benchmark, table.track),
        by_scene=by_scene,
        average=asked.average and asked.scene is None,
        elsewhere=published_benchmarks(table.track, by_scene=by_scene),
    )


def _marked(asked: TableRequest, made: Table, scores: Sequence[ScoreColumn]) -> Table:
    """Sort a table, mark its best values, add gains and citations, and rename at last."""
    made = _in_digits(asked, _sorted(asked, made, scores))
    made = marks.mark_best(made, second=asked.second)
    # Among reported rows alone there is nothing to tell apart.
    if len({bool(row.reported) for row in made.rows if not row.floor}) > 1:
        rule = "the best of each score is that of the rows that were scored here"
        made = replace(made, notes=(rule, *made.notes), legend=(rule, *made.legend))
    made = marks.highlight(made, asked.highlight or ())
    baselines = marks.parse_baselines(made, asked.baseline or ())
    if asked.cite:
        files = published_sources().items()
        sources = {name: read_source_file(path).citations for name, path in files}
        made = marks.add_citations(made, asked.cite, sources)
    return marks.rename(marks.add_gains(made, baselines), asked.rename or ())


def _in_digits(asked: TableRequest, made: Table) -> Table:
    return made if asked.decimals is None else marks.with_decimals(made, asked.decimals)


def _sorted(asked: TableRequest, made: Table, columns: Sequence[ScoreColumn]) -> Table:
    wanted = asked.sort
    if wanted is not None and wanted != marks.BY_NAME:
        shown = {column.title for column in made.columns}
        scores = [score for score in columns if score.title in shown]
        hidden = wanted in named_scores(columns)
        check_score(wanted, scores, "--sort", f"add --score {wanted!r} to show it" * hidden)
        wanted = named_scores(scores)[wanted].title
    return made if wanted is None else marks.sort_rows(made, wanted, AVERAGE)
