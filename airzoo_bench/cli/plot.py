"""``airzoo-bench plot``: pictures of methods side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from airzoo_bench.cli.breakdown import parse_bins
from airzoo_bench.cli.common import say
from airzoo_bench.errors import UsageError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from airzoo_bench.records import Scored
    from airzoo_bench.result import ScoreColumn

__all__ = ["Kind", "plot"]


class Kind(StrEnum):
    """What is drawn."""

    RECALL = "recall"
    ERRORS = "errors"
    THRESHOLDS = "thresholds"
    INTERVALS = "intervals"
    SCENES = "scenes"
    CONDITION = "condition"


def plot(
    kind: Annotated[Kind, typer.Argument(help="What to draw.")],
    results: Annotated[list[Path], typer.Argument(help="One or more result.json.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="A .png, .svg or .pdf.")],
    score: Annotated[
        str | None, typer.Option(help="Key or title (default: the first that fits).")
    ] = None,
    by: Annotated[
        str | None, typer.Option(help="For condition: a column, such as weather.")
    ] = None,
    bins: Annotated[
        str | None, typer.Option(help="For condition: inner edges, such as 50,100.")
    ] = None,
    up_to: Annotated[
        int | None, typer.Option(min=1, help="For recall: the largest K (default: all kept).")
    ] = None,
) -> None:
    """Draw recall over K, error curves, precision and recall over d, intervals, scenes, conditions.

    Example: airzoo-bench plot recall results/*/result.json -o recall.pdf

    Example: airzoo-bench plot condition results/*/result.json --by altitude_m -o altitude.svg
    """
    from airzoo_bench.records import read_scored
    from airzoo_bench.report import draw
    from airzoo_bench.report.figures import save_figure
    from airzoo_bench.statistics.compatibility import check_comparable

    if (by is None) != (kind is not Kind.CONDITION):
        raise UsageError(
            "--by and the kind 'condition' belong together",
            expected="such as `airzoo-bench plot condition ... --by weather`",
        )
    edges = None if bins is None else parse_bins(bins)
    methods = read_scored(results)
    check_comparable(methods)
    drawing: dict[Kind, Callable[[Sequence[Scored], ScoreColumn], Figure]] = {
        Kind.RECALL: lambda these, _: draw.recall(these, up_to),
        Kind.ERRORS: draw.errors,
        Kind.THRESHOLDS: lambda these, _: draw.thresholds(these),
        Kind.INTERVALS: draw.intervals,
        Kind.SCENES: draw.scenes,
        Kind.CONDITION: lambda these, chosen: draw.condition(these, chosen, by or "", edges),
    }
    chosen = draw.choose_score(methods, score, of_errors=kind is Kind.ERRORS)
    save_figure(drawing[kind](methods, chosen), out)
    say(f"drew {out}")
