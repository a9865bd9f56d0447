"""``airzoo-bench report``: one HTML file with everything that results tell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from airzoo_bench.cli.common import check_output, examples, progress, say, say_replaced
from airzoo_bench.cli.locations import DataOption, ResultsArgument, resolve_data
from airzoo_bench.core.errors import UsageError

_HEAD_BYTES = 4096
_GENERATOR = b'<meta name="generator" content="airzoo-bench '

EXAMPLES = examples("report results/*/result.json -o report.html")


def report(
    results: ResultsArgument,
    out: Annotated[Path, typer.Option("--out", "-o", help="The .html to write.")] = Path(
        "report.html"
    ),
    data: DataOption = None,
    title: Annotated[str, typer.Option(help="Title of the page.")] = "Results",
    pictures: Annotated[
        int, typer.Option(min=0, max=100, help="How many of the hardest queries to show.")
    ] = 12,
) -> None:
    """Write a report: tables, curves, maps, clouds, the hardest queries, settings.

    Results of one protocol and truth stand side by side; others get parts of their own. Maps and
    photos are added where the benchmark folder is there; matches, arrows of errors and clouds where
    runs were scored with --figures.
    """
    from airzoo_bench.core.files import atomic_write
    from airzoo_bench.report.page import make_report
    from airzoo_bench.results.files import results_here

    paths = results_here(results)
    check_output(out, paths, (".html", ".htm"))
    _check_replaced(out)
    say_replaced(out)
    made = make_report(
        paths,
        data=resolve_data(data),
        data_was_named=data is not None,
        title=title,
        pictures=pictures,
        progress=progress,
    )
    with atomic_write(out, "w") as stream:
        stream.write(made.page)
    for note in made.notes:
        say(note)
    say(f"wrote {out} ({out.stat().st_size / 1e6:.1f} MB)")


def _check_replaced(out: Path) -> None:
    """Refuse to replace a page that is not a report."""
    if not out.is_file():
        return
    with out.open("rb") as stream:
        start = stream.read(_HEAD_BYTES)
    if start and _GENERATOR not in start:
        raise UsageError(
            "is there already, and is no report of airzoo-bench",
            where=out,
            fix="name another file with --out",
        )
