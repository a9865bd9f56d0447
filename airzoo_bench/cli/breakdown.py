"""``airzoo-bench breakdown``: scores by a condition of the queries."""

from __future__ import annotations

from typing import Annotated

import typer

from airzoo_bench.cli.common import Format, FormatOption, ScoresOption, examples, show
from airzoo_bench.cli.locations import ResultsArgument
from airzoo_bench.core.errors import UsageError

__all__ = ["EXAMPLES", "breakdown", "parse_bins"]

EXAMPLES = examples(
    "breakdown results/mine/result.json --by weather",
    "breakdown results/*/result.json --by altitude_m --bins 50,100 --score R@1",
)


def breakdown(
    results: ResultsArgument,
    by: Annotated[
        str, typer.Option("--by", help="A column of the records, such as weather or altitude_m.")
    ],
    bins: Annotated[
        str | None,
        typer.Option(help="Inner edges of a number's bins, such as 50,100 (default: round ones)."),
    ] = None,
    score: ScoresOption = None,
    intervals: Annotated[
        bool,
        typer.Option(
            "--intervals",
            help="Show 95 % intervals next to the values; always, where the table is "
            "one score of one result.",
        ),
    ] = False,
    form: FormatOption = Format.TERMINAL,
) -> None:
    """Print scores by weather, altitude or any other column of the records.

    One result gives a column a score; several give a column a method, of the first score unless
    some are named.
    """
    from airzoo_bench.results.comparable import check_same_queries, choose_scores, score_keys
    from airzoo_bench.results.files import result_paths, results_here
    from airzoo_bench.results.records import read_records, read_scored
    from airzoo_bench.results.result import read_result
    from airzoo_bench.statistics.samples import ResamplingConfig
    from airzoo_bench.tables.breakdown import breakdown_table, check_column

    edges = None if bins is None else parse_bins(bins)
    wanted = score or []
    paths = result_paths(results_here(results))
    keys = score_keys(read_result(paths[0]), wanted)
    methods = read_scored(paths, {by, *keys})
    check_same_queries(methods)
    if by not in methods[0].records:
        check_column(read_records(paths[0], methods[0].result), by)
    scores = choose_scores(methods, wanted)
    if len(methods) > 1 and not wanted:
        scores = scores[:1]
    with_intervals = intervals or len(methods) == len(scores) == 1
    plan = ResamplingConfig() if with_intervals else None
    show(breakdown_table(methods, scores, by, bins=edges, resampling=plan), form)


def parse_bins(text: str) -> list[float]:
    """Turn ``50,100`` into numbers."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise UsageError(f"--bins {text!r} are no numbers", expected="such as 50,100") from None
