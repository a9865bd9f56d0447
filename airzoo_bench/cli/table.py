"""``airzoo-bench table``: results as a table to print or to put into a paper."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import typer

from airzoo_bench.cli import common as cli
from airzoo_bench.core.errors import UsageError

if TYPE_CHECKING:
    from airzoo_bench.results.result import Result
    from airzoo_bench.tables.layouts import MethodTable
_ROWS, _VALUES = cli.ROWS, "Values"


class _Part(NamedTuple):
    """The methods of one protocol, with their results and files."""

    table: MethodTable
    results: Sequence[Result] = ()
    paths: Sequence[Path] = ()


def table(
    results: Annotated[
        list[str],
        typer.Argument(
            metavar="RESULTS",
            help="One or more result.json, or their folders: paths or URLs. With --published also "
            "names of protocols, for what papers print on them.",
        ),
    ],
    layout: Annotated[
        Literal["result", "methods", "scenes", "benchmarks"] | None,
        cli.option(
            "result: a row by scene; methods: a row by method; scenes: methods by scenes side by "
            "side; benchmarks: methods by benchmarks, those of one name in a row (default: result "
            "for one, methods for several of one protocol, else benchmarks).",
            panel=_ROWS,
        ),
    ] = None,
    scene: Annotated[
        cli.Text, cli.option("With methods: this scene instead of the average.", panel=_ROWS)
    ] = None,
    every: cli.AllOption = False,
    scores: cli.ScoresOption = None,
    published: Annotated[
        bool,
        cli.option("Add rows of published numbers, with a dagger.", "--published", panel=_ROWS),
    ] = False,
    floors: Annotated[
        bool,
        cli.option("Add rows for the chance level and the prior itself.", "--floors", panel=_ROWS),
    ] = False,
    intervals: Annotated[
        bool, cli.option("Show 95 % intervals next to the values.", "--intervals", panel=_VALUES)
    ] = False,
    decimals: Annotated[
        int | None, cli.option("Digits after the point (default: 2).", panel=_VALUES, min=0, max=6)
    ] = None,
    baseline: Annotated[
        cli.Texts,
        cli.option(
            "NAME: write gains over it, of the highlighted rows if there are any; or METHOD=NAME. "
            "Repeatable.",
            panel=_VALUES,
        ),
    ] = None,
    highlight: Annotated[
        cli.Texts,
        cli.option("Colour a row; gains are then of such rows; repeatable.", panel=_VALUES),
    ] = None,
    cite: Annotated[
        cli.Texts,
        cli.option(
            "LaTeX: a .toml file of keys by method, or airzoo-paper; repeatable.", panel="Output"
        ),
    ] = None,
    form: cli.FormatOption = cli.Format.TERMINAL,
) -> None:
    """Print one result by scene, or several results side by side.

    Example: airzoo-bench table results/*/result.json --format latex

    Example: airzoo-bench table */result.json --layout scenes --published -f latex

    Example: airzoo-bench table uav-visloc-retrieval --published --layout scenes
    """
    asked = SimpleNamespace(**locals())
    from airzoo_bench.results.comparison import check_score, scores_by_name
    from airzoo_bench.tables import layouts, marks

    parts = _read_parts(asked)
    chosen, wanted, tables = _choose_layout(asked, parts), scores or (), []
    for name in wanted:
        check_score(name, [c for part in parts for c in part.table.scores], "--score")
    for part in parts:
        known = scores_by_name(part.table.scores)
        own = tuple(dict.fromkeys(known[name] for name in wanted if name in known))
        if own or not wanted:
            scored = replace(part.table, scores=own or part.table.scores)
            tables.append(_add_rows(asked, chosen, part._replace(table=scored)))
    if not any(one.rows for one in tables):
        titles = ", ".join(one.title for one in tables)
        raise UsageError(f"nothing is published on {titles} for layout {chosen}")
    if chosen == "result":
        made = layouts.scenes_table(parts[0].results[0], floors=floors, methods=tables[0])
    elif chosen == "benchmarks":
        made = layouts.benchmarks_layout(tables)
    elif chosen == "methods":
        made = layouts.methods_layout(tables[0], scene)
    else:
        made = layouts.scenes_layout(tables[0])
    if decimals is not None:
        made = marks.with_decimals(made, decimals)
    if chosen != "result":
        made = marks.highlight(marks.mark_best(made), highlight or ())
        made = marks.add_gains(marks.add_citations(made, cite or ()), baseline or ())
    cli.show(made, form)


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
        what = f"layout {layout} does not go with these results or options"
        expected = "result: one result alone; methods, scenes: of one protocol; --scene: methods"
        raise UsageError(what, expected=expected)
    return layout


def _read_parts(asked: Any) -> list[_Part]:
    """Read the results by protocol, and protocols for the numbers that are published on them."""
    from airzoo_bench.core.registry import load_track
    from airzoo_bench.protocol.model import load_protocol, shipped_protocols
    from airzoo_bench.results.result import read_result, result_paths
    from airzoo_bench.tables.layouts import empty_table, method_table

    protocols, one_table = shipped_protocols(), asked.layout in ("methods", "scenes")
    names = [name for name in asked.results if name in protocols and not Path(name).exists()]
    if names and not asked.published:
        fix = "add --published for what papers print on it"
        raise UsageError("a protocol, not a result", where=names[0], fix=fix)
    wanted = asked.scores or (None if asked.every else ())
    groups: dict[str, list[tuple[Any, Path]]] = {}
    # What cannot share the table that is asked for is named by `method_table`.
    for path in result_paths([one for one in asked.results if one not in names], protocols):
        result = read_result(path)
        groups.setdefault("" if one_table else result.protocol.name, []).append((result, path))
    parts = []
    for pairs in groups.values():
        some, files = zip(*pairs, strict=True)
        parts.append(_Part(method_table(some, paths=files, wanted=wanted), some, files))
    for protocol in (load_protocol(protocols[name]) for name in names):
        columns = load_track(protocol.track).scores(protocol)
        scores = [column for column in columns if asked.every or asked.scores or column.headline]
        parts.append(_Part(empty_table(protocol, scores)))
    return parts


def _add_rows(asked: Any, layout: str, part: _Part) -> MethodTable:
    """Add intervals, published rows and floors, where they are asked for."""
    from airzoo_bench.results.comparison import find_scene
    from airzoo_bench.tables.layouts import with_floors, with_published
    from airzoo_bench.tables.published import OVERALL, published_values

    table, results = part.table, part.results
    scenes = [OVERALL if asked.scene is None else find_scene(table.scenes, asked.scene)]
    if layout in ("result", "scenes"):
        scenes = [*table.scenes, OVERALL]
    if asked.intervals and results:
        from airzoo_bench.results.records import Method, read_records  # which need pandas
        from airzoo_bench.statistics.samples import ResamplingConfig
        from airzoo_bench.tables.comparison import with_intervals

        triples = zip(table.rows, results, part.paths, strict=True)
        methods = [Method(row.method, result, read_records(path)) for row, result, path in triples]
        table = with_intervals(table, methods, ResamplingConfig(), scenes)
    if asked.published:
        values = published_values(table.benchmark, table.track)
        used = results[0].protocol.fingerprint if results else ""
        table = with_published(table, values, scenes, used)
    if not results and not asked.scores:
        printed = {key for row in table.rows for values in row.values.values() for key in values}
        table = replace(table, scores=tuple(s for s in table.scores if s.key in printed))
    if asked.floors and results and layout != "result":
        table = with_floors(table, results)
    return table
