"""``airzoo-bench compare``, ``breakdown``, ``plot`` and ``report``: results and their records."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from airzoo_bench.cli import common as cli
from airzoo_bench.core.errors import UsageError

# The options that each kind of picture takes.
_PLOTS = {
    "recall": "up_to",
    "errors": "score",
    "thresholds": "",
    "condition": "by bins score",
    "map": "scene data",
    "query": "query data",
    "cloud": "scene",
}
ByOption = cli.option("A column of the records, such as weather or altitude_m.")
BinsOption = Annotated[
    cli.Text, cli.option("Inner edges of a number's bins, such as 50,100 (default: round ones).")
]


def compare(
    results: cli.ResultsArgument,
    form: cli.FormatOption = cli.Format.TERMINAL,
    score: cli.ScoresOption = None,
    every: cli.AllOption = False,
    reference: Annotated[
        cli.Text, cli.option("The method to compare with, or 'best' (default: the first).")
    ] = None,
    scene: cli.SceneOption = None,
) -> None:
    """Compare methods query by query: differences, intervals, tests, a verdict in words.

    With one result, print its intervals.

    Example: airzoo-bench compare results/mine/result.json results/theirs/result.json

    Example: airzoo-bench compare results/*/result.json --reference Mine
    """
    from airzoo_bench.api.results import compare as compare_results

    if every and score:
        raise UsageError("--all and --score exclude each other", fix="leave one of them out")
    if len(results) == 1 and reference:
        raise UsageError("--reference needs two or more results", fix="name another")
    with cli.working("comparing"):
        found = compare_results(results, score or (), every=every, reference=reference, scene=scene)
    cli.show(found.table, form)


def breakdown(
    results: cli.ResultsArgument,
    by: Annotated[str, ByOption],
    bins: BinsOption = None,
    score: cli.ScoresOption = None,
    form: cli.FormatOption = cli.Format.TERMINAL,
) -> None:
    """Print scores by weather, altitude or any other column of the records.

    With one result each column is a score, and a single score has 95 % intervals. With several
    results each column is a method, for the first score or each --score.

    Example: airzoo-bench breakdown results/mine/result.json --by weather

    Example: airzoo-bench breakdown results/*/result.json --by altitude_m --bins 50,100 --score R@1
    """
    from airzoo_bench.results.comparison import check_same_queries, choose_scores, score_keys
    from airzoo_bench.results.records import read_methods, read_records
    from airzoo_bench.results.result import read_result, result_paths
    from airzoo_bench.statistics.samples import ResamplingConfig
    from airzoo_bench.tables.breakdown import breakdown_table, check_column

    edges, wanted = _parse_bins(bins), score or []
    paths = result_paths(results)
    methods = read_methods(paths, {by, *score_keys(read_result(paths[0]), wanted)})
    check_same_queries(methods)
    if by not in methods[0].records:
        check_column(read_records(paths[0], methods[0].result), by)
    scores = choose_scores(methods, wanted)
    if len(methods) > 1 and not wanted:
        scores = scores[:1]
    plan = ResamplingConfig() if len(methods) == len(scores) == 1 else None
    cli.show(breakdown_table(methods, scores, by, bins=edges, resampling=plan), form)


def _parse_bins(text: str | None) -> list[float] | None:
    try:
        return None if text is None else [float(part) for part in text.split(",")]
    except ValueError:
        raise UsageError(f"--bins {text!r} are no numbers", expected="such as 50,100") from None


def plot(
    kind: Annotated[str, typer.Argument(metavar="KIND", help="One of those above.")],
    results: cli.ResultsArgument,
    out: Annotated[Path, cli.option("The .png, .svg or .pdf to save.", "--out", "-o")],
    score: Annotated[cli.Text, cli.option("Key or title (default: the first that fits).")] = None,
    scene: cli.SceneOption = None,
    up_to: Annotated[int | None, cli.option("The largest K (default: all kept).", min=1)] = None,
    by: Annotated[cli.Text, ByOption] = None,
    bins: BinsOption = None,
    query: Annotated[cli.Text, cli.option("The id of the query.")] = None,
    data: cli.DataOption = None,
    width: Annotated[
        cli.Text, cli.option("Such as 3.3in or 8.4cm (default: what the content needs).")
    ] = None,
) -> None:
    """Draw results as a picture.

    \b
    recall      recall at K over K (--up-to)
    errors      the share of queries with an error (--score) below a value
    thresholds  precision, recall and F1 of reconstruction over distances
    condition   a score in groups of queries (--by, --bins)
    map         hits and misses of retrieval, or arrows of matching's errors
    query       photo and first tiles, or matches coloured by residual (--query)
    cloud       predicted and true cloud coloured by their errors

    The last three take one run; arrows, matches and clouds need one that was scored with
    --figures. Failures are infinite errors: their curve never reaches 100 %.

    Example: airzoo-bench plot recall results/*/result.json -o recall.pdf --up-to 20

    Example: airzoo-bench plot condition results/*/result.json --by altitude_m -o altitude.svg

    Example: airzoo-bench plot query results/mymethod --query city/0001 -o query.png
    """  # noqa: D301 - \b keeps the lines of a list
    from airzoo_bench.core.files import check_output_file
    from airzoo_bench.report.draw import picture
    from airzoo_bench.report.figures import Sheet, check_ending, parse_length, save_figure
    from airzoo_bench.results.result import result_paths

    cli.check_choice("airzoo-bench plot", kind, list(_PLOTS))
    values: dict[str, Any] = {"score": score, "scene": scene, "up_to": up_to, "by": by}
    values |= {"query": query, "bins": bins, "data": data}
    given = {name: value for name, value in values.items() if value is not None}
    takes = _PLOTS[kind].split()
    needed = [name for name in ("by", "query") if name in takes and name not in given]
    if needed or not given.keys() <= {*takes}:
        flags = ", ".join(f"--{name.replace('_', '-')}" for name in takes)
        what = f"needs --{needed[0]}" if needed else "takes other options"
        raise UsageError(f"plot {kind} {what}", expected=f"of these: {flags}")
    check_ending(out)
    check_output_file(out)
    if "bins" in takes:
        given["bins"] = _parse_bins(bins)
    if "data" in takes:
        given["data"] = cli.resolve_data(data)
    with cli.working(f"drawing {out}"):
        sheet = Sheet(parse_length(width))
        save_figure(picture(kind, result_paths(results), sheet, **given), out)
    cli.say(f"drew {out}")


def report(
    results: cli.ResultsArgument,
    out: Annotated[Path, cli.option("The .html to write.", "--out", "-o")] = Path("report.html"),
    data: cli.DataOption = None,
    pictures: Annotated[
        int, cli.option("How many of the hardest queries to show.", min=0, max=100)
    ] = 12,
) -> None:
    """Write a report: tables, curves, maps, clouds, the hardest queries, settings.

    Results of one protocol and truth are shown side by side; others get their own parts. Maps and
    photos are added where the benchmark folder is there; matches, arrows of errors and clouds where
    runs were scored with --figures.

    Example: airzoo-bench report results/*/result.json -o report.html
    """
    if out.suffix.lower() not in (".html", ".htm"):  # before slow imports
        raise UsageError("a report is a page", where=out, expected="a name that ends in .html")
    from airzoo_bench.core.files import atomic_write, check_output_file
    from airzoo_bench.report.page import make_report
    from airzoo_bench.results.result import result_paths

    check_output_file(out)
    wrote = "replaced" if out.exists() else "wrote"
    page, notes = make_report(
        result_paths(results),
        data=cli.resolve_data(data),
        data_was_named=data is not None,
        pictures=pictures,
        progress=cli.progress,
    )
    with atomic_write(out, "w") as stream:
        stream.write(page)
    for note in notes:
        cli.say(note)
    cli.say(f"{wrote} {out} ({out.stat().st_size / 1e6:.1f} MB)")
