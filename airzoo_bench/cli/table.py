"""``airzoo-bench table``: results as a table to print or to put into a paper."""

from __future__ import annotations

from typing import Annotated

import typer

from airzoo_bench.cli.common import Format, FormatOption, examples, show
from airzoo_bench.cli.table_request import Layout, TableRequest, layout_named
from airzoo_bench.core.errors import UsageError, agreeing

__all__ = ["EXAMPLES", "PANELS", "table"]

EXAMPLES = examples(
    "table results/*/result.json --format latex",
    "table */result.json --layout scenes --published -f latex --fit",
    "table --published --protocol uav-visloc-retrieval --layout scenes",
)

PANELS = {
    "Rows and columns": (
        *("layout", "scene", "every_score", "scores", "sort", "highlight", "floors", "rename"),
        *("queries", "average"),
    ),
    "Statistics": ("intervals", "second", "baseline"),
    "Published numbers": ("published", "protocol"),
    "Output": ("form", "decimals"),
    "LaTeX": ("cite", "fit"),
}


def table(
    results: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="RESULTS", help="One or more result.json, or their folders: paths or URLs."
        ),
    ] = None,
    form: FormatOption = Format.TERMINAL,
    layout: Annotated[
        Layout | None,
        typer.Option(
            parser=layout_named,
            metavar=f"[{'|'.join(Layout)}]",
            help="result: a row a scene; methods: a row a method; scenes: methods by scenes side "
            "by side; benchmarks: methods by benchmarks (default: result for one, methods for "
            "several of one protocol, else benchmarks).",
        ),
    ] = None,
    scene: Annotated[
        str | None, typer.Option(help="With methods: this scene instead of the average.")
    ] = None,
    every_score: Annotated[
        bool, typer.Option("--all", help="Print every score, not the paper's only.")
    ] = False,
    scores: Annotated[
        list[str] | None, typer.Option("--score", help="Print this score only; repeatable.")
    ] = None,
    published: Annotated[
        bool, typer.Option("--published", help="Add rows of published numbers, marked as such.")
    ] = False,
    protocol: Annotated[
        str | None,
        typer.Option(help="With --published, instead of results: print what is published on it."),
    ] = None,
    second: Annotated[
        bool, typer.Option("--second", help="Underline the second best of each score.")
    ] = False,
    baseline: Annotated[
        list[str] | None,
        typer.Option(
            help="NAME: write gains over it, of the highlighted rows if there are any; "
            "or METHOD=NAME. Repeatable."
        ),
    ] = None,
    highlight: Annotated[
        list[str] | None, typer.Option(help="Colour the row of this method; repeatable.")
    ] = None,
    cite: Annotated[
        list[str] | None,
        typer.Option(help="LaTeX: METHOD=KEY, a .toml file of such, or airzoo-paper; repeatable."),
    ] = None,
    intervals: Annotated[
        bool, typer.Option("--intervals", help="Show 95 % intervals next to the values.")
    ] = False,
    floors: Annotated[
        bool,
        typer.Option(
            "--floors", help="Add rows for what needs no method: chance level, the prior itself."
        ),
    ] = False,
    sort: Annotated[
        str | None,
        typer.Option(
            metavar="SCORE",
            help="Put the best methods by this score on top, or with 'method' go by their names.",
        ),
    ] = None,
    decimals: Annotated[
        int | None,
        typer.Option(
            min=0, max=6, help="Digits behind the point (default: 2).", show_default=False
        ),
    ] = None,
    queries: Annotated[
        bool, typer.Option("--queries", help="With scenes: show their numbers of queries.")
    ] = False,
    average: Annotated[
        bool, typer.Option(help="With scenes: the average over them.", show_default=False)
    ] = True,
    rename: Annotated[
        list[str] | None,
        typer.Option(
            help="OLD=NEW: another name for a method, scene, benchmark or score, as the table "
            "shows it; methods of different benchmarks with one name share a row. Repeatable."
        ),
    ] = None,
    fit: Annotated[
        bool, typer.Option("--fit", help="LaTeX: shrink a table that is wider than the line.")
    ] = False,
) -> None:
    """Print one result by scene, or several side by side by method."""
    from airzoo_bench.cli.table_making import make_table
    from airzoo_bench.results.files import results_here

    request = TableRequest(
        results=tuple(results_here(results or ())),
        protocol=protocol,
        layout=layout,
        scene=scene,
        every_score=every_score,
        scores=tuple(scores or ()),
        published=published,
        second=second,
        baselines=tuple(baseline or ()),
        highlighted=tuple(highlight or ()),
        citations=tuple(cite or ()),
        intervals=intervals,
        queries=queries,
        average=average,
        renamed=tuple(rename or ()),
        floors=floors,
        sort=sort,
        decimals=decimals,
    )
    if form is not Format.LATEX:
        _check_no_latex({"--fit": fit, "--cite": cite})
    show(make_table(request), form, fit=fit)


def _check_no_latex(given: dict[str, object]) -> None:
    odd = [name for name, value in given.items() if value]
    if odd:
        are = agreeing(len(odd), "is", "are")
        raise UsageError(f"{' and '.join(odd)} {are} for LaTeX", fix="add --format latex")
