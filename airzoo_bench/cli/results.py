"""``airzoo-bench compare``, ``breakdown`` and ``report``: results and their records."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import (
    AllOption,
    Format,
    FormatOption,
    SceneOption,
    ScoresOption,
    progress,
    say,
    show,
)
from airzoo_bench.cli.locations import DataOption, ResultsArgument, resolve_data
from airzoo_bench.core.errors import UsageError


def compare(
    results: ResultsArgument,
    form: FormatOption = Format.TERMINAL,
    score: ScoresOption = None,
    every: AllOption = False,
    reference: Annotated[
        str | None,
        typer.Option(help="The method to compare with, or 'best' (default: the first)."),
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Instead: is NAME better than each of the others? Differences, verdicts and wins "
            "are NAME's.",
        ),
    ] = None,
    scene: SceneOption = None,
) -> None:
    """Compare methods query by query: differences, intervals, tests, a verdict in words.

    With one result, print its intervals.
    """
    from airzoo_bench.api.results import compare as compare_results

    if every and score:
        raise UsageError("--all and --score exclude each other", fix="leave one of them out")
    if len(results) == 1 and (reference or method):
        raise UsageError("--reference and --method need two or more results", fix="name another")
    found = compare_results(
        results, score or (), every=every, reference=reference, method=method, scene=scene
    )
    show(found.table, form)


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
    form: FormatOption = Format.TERMINAL,
) -> None:
    """Print scores by weather, altitude or any other column of the records.

    With one result each column is a score, and a single score has 95 % intervals. With several
    results each column is a method, for the first score or each --score.
    """
    from airzoo_bench.results.comparable import check_same_queries, choose_scores, score_keys
    from airzoo_bench.results.files import result_paths, results_here
    from airzoo_bench.results.records import read_records, read_scored
    from airzoo_bench.results.result import read_result
    from airzoo_bench.statistics.samples import ResamplingConfig
    from airzoo_bench.tables.breakdown import breakdown_table, check_column

    edges, wanted = parse_bins(bins), score or []
    paths = result_paths(results_here(results))
    methods = read_scored(paths, {by, *score_keys(read_result(paths[0]), wanted)})
    check_same_queries(methods)
    if by not in methods[0].records:
        check_column(read_records(paths[0], methods[0].result), by)
    scores = choose_scores(methods, wanted)
    if len(methods) > 1 and not wanted:
        scores = scores[:1]
    plan = ResamplingConfig() if len(methods) == len(scores) == 1 else None
    show(breakdown_table(methods, scores, by, bins=edges, resampling=plan), form)


def parse_bins(text: str | None) -> list[float] | None:
    """Turn ``50,100`` into numbers."""
    try:
        return None if text is None else [float(part) for part in text.split(",")]
    except ValueError:
        raise UsageError(f"--bins {text!r} are no numbers", expected="such as 50,100") from None


def report(
    results: ResultsArgument,
    out: Annotated[Path, typer.Option("--out", "-o", help="The .html to write.")] = Path(
        "report.html"
    ),
    data: DataOption = None,
    pictures: Annotated[
        int, typer.Option(min=0, max=100, help="How many of the hardest queries to show.")
    ] = 12,
) -> None:
    """Write a report: tables, curves, maps, clouds, the hardest queries, settings.

    Results of one protocol and truth are shown side by side; others get their own parts. Maps and
    photos are added where the benchmark folder is there; matches, arrows of errors and clouds where
    runs were scored with --figures.
    """
    from airzoo_bench.core.files import atomic_write, check_output_file
    from airzoo_bench.report.page import make_report
    from airzoo_bench.results.files import results_here

    if out.suffix.lower() not in (".html", ".htm"):
        raise UsageError("a report is a page", where=out, expected="a name that ends in .html")
    check_output_file(out)
    made = make_report(
        results_here(results),
        data=resolve_data(data),
        data_was_named=data is not None,
        pictures=pictures,
        progress=progress,
    )
    with atomic_write(out, "w") as stream:
        stream.write(made.page)
    for note in made.notes:
        say(note)
    say(f"wrote {out} ({out.stat().st_size / 1e6:.1f} MB)")
