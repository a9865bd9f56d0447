"""``airzoo-bench table``: results as a table to print or to put into a paper."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import Format, FormatOption, show

__all__ = ["table"]


def table(
    results: Annotated[list[Path], typer.Argument(help="One or more result.json.")],
    form: FormatOption = Format.TERMINAL,
    scene: Annotated[
        str | None, typer.Option(help="With several results: this scene instead of the average.")
    ] = None,
    every_score: Annotated[
        bool, typer.Option("--all", help="Print every score, not the paper's only.")
    ] = False,
) -> None:
    """Print one result by scene, or several side by side by method.

    Example: airzoo-bench table results/*/result.json --format latex
    """
    from airzoo_bench.result import read_result
    from airzoo_bench.tables.build import methods_table, scenes_table

    loaded = [read_result(path) for path in results]
    if len(loaded) == 1 and scene is None:
        show(scenes_table(loaded[0], every_score=every_score), form)
    else:
        show(methods_table(loaded, every_score=every_score, scene=scene), form)
