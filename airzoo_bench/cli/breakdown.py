"""``airzoo-bench breakdown``: scores by a condition of the queries."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import Format, FormatOption, show
from airzoo_bench.errors import UsageError

__all__ = ["breakdown", "parse_bins"]


def breakdown(
    results: Annotated[list[Path], typer.Argument(help="One or more result.json.")],
    by: Annotated[
        str, typer.Option("--by", help="A column of the records, such as weather or altitude_m.")
    ],
    bins: Annotated[
        str | None,
        typer.Option(help="Inner edges of a number's bins, such as 50,100 (default: round ones)."),
    ] = None,
    score: Annotated[
        list[str] | None,
        typer.Option(help="Key or title, repeatable (default: the paper's scores)."),
    ] = None,
    form: FormatOption = Format.TERMINAL,
    resamples: Annotated[int, typer.Option(min=100, max=1_000_000)] = 10_000,
    seed: Annotated[int, typer.Option(min=0)] = 0,
) -> None:
    """Print scores by weather, altitude or any other column of the records.

    One result gives a column a score; several give a column a method, by one score. One result
    and one score give its 95 % intervals too.

    Example: airzoo-bench breakdown results/mine/result.json --by weather

    Example: airzoo-bench breakdown results/*/result.json --by altitude_m --bins 50,100 --score R@1
    """
    from airzoo_bench.records import read_scored
    from airzoo_bench.report.conditions import breakdown_table
    from airzoo_bench.statistics.compatibility import check_comparable, choose_scores
    from airzoo_bench.statistics.samples import Plan

    edges = None if bins is None else parse_bins(bins)
    methods = read_scored(results)
    check_comparable(methods)
    scores = choose_scores(methods, score or [])
    plan = Plan(resamples, seed)
    show(breakdown_table(methods, scores, by, bins=edges, plan=plan), form)


def parse_bins(text: str) -> list[float]:
    """Turn ``50,100`` into numbers.

    Raises
    ------
    UsageError
        A part is not a number.
    """
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise UsageError(f"--bins {text!r} are no numbers", expected="such as 50,100") from None
