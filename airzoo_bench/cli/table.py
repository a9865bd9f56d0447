"""``airzoo-bench table``: results as a table to print or to put into a paper."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Annotated, Literal

import typer

from airzoo_bench.cli import common as cli

_ROWS, _VALUES = cli.ROWS, "Values"


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
        cli.option(
            "Add rows without a method: the chance level, the prior itself.",
            "--floors",
            panel=_ROWS,
        ),
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
        cli.Texts, cli.option("Colour this method's row; repeatable.", panel=_VALUES)
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
    from airzoo_bench.cli.table_making import make_table

    cli.show(make_table(SimpleNamespace(**locals())), form)
