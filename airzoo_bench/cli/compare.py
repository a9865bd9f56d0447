"""``airzoo-bench compare``: whether one method is really better than another."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from airzoo_bench.cli.common import Format, FormatOption, show
from airzoo_bench.errors import UsageError

if TYPE_CHECKING:
    from airzoo_bench.statistics.samples import Plan
    from airzoo_bench.tables.model import Table

__all__ = ["compare"]


class IntervalMethod(StrEnum):
    """How intervals are taken from resamples."""

    BCA = "bca"
    PERCENTILE = "percentile"


def compare(
    results: Annotated[
        list[Path] | None,
        typer.Argument(help="Two or more result.json; of one, its intervals are printed."),
    ] = None,
    form: FormatOption = Format.TERMINAL,
    score: Annotated[
        list[str] | None,
        typer.Option(help="Key or title, repeatable (default: the paper's scores)."),
    ] = None,
    reference: Annotated[
        str | None,
        typer.Option(help="The method to compare with, or 'best' (default: the first)."),
    ] = None,
    scene: Annotated[str | None, typer.Option(help="Compare on this scene only.")] = None,
    most_different: Annotated[
        int | None,
        typer.Option(min=1, help="Print so many queries where the methods differ most."),
    ] = None,
    interval: Annotated[
        IntervalMethod, typer.Option(help="Which bootstrap interval.")
    ] = IntervalMethod.BCA,
    resamples: Annotated[int, typer.Option(min=100, max=1_000_000)] = 10_000,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    printed: Annotated[
        tuple[str, str] | None,
        typer.Option(help="Two printed hit rates in percent, instead of results."),
    ] = None,
    queries: Annotated[
        int | None, typer.Option(min=1, help="With --printed: on how many queries.")
    ] = None,
) -> None:
    """Compare methods query by query: differences, intervals, tests, a verdict in words.

    Example: airzoo-bench compare results/mine/result.json results/theirs/result.json

    Example: airzoo-bench compare --printed 96.21 94.32 --queries 264
    """
    from airzoo_bench.statistics.samples import Plan

    if printed is not None or queries is not None:
        show(_printed(results, printed, queries), form)
        return
    plan = Plan(resamples, seed, interval.value)
    show(_compared(results or [], score or [], reference, scene, most_different, plan), form)


def _printed(
    results: list[Path] | None, printed: tuple[str, str] | None, queries: int | None
) -> Table:
    from airzoo_bench.statistics.layout import bounds_table
    from airzoo_bench.statistics.printed import printed_bounds

    if results or printed is None or queries is None:
        raise UsageError(
            "--printed and --queries belong together, and leave no place for results",
            expected="such as --printed 96.21 94.32 --queries 264",
        )
    return bounds_table(*printed, printed_bounds(*printed, queries))


def _compared(
    paths: list[Path],
    wanted: list[str],
    reference: str | None,
    scene: str | None,
    most_different: int | None,
    plan: Plan,
) -> Table:
    from airzoo_bench.records import read_scored
    from airzoo_bench.statistics.comparison import compare as compare_methods
    from airzoo_bench.statistics.comparison import score_intervals
    from airzoo_bench.statistics.compatibility import check_comparable, choose_scores, find_scene
    from airzoo_bench.statistics.layout import (
        comparison_table,
        differences_table,
        intervals_table,
    )

    if not paths:
        raise UsageError(
            "nothing to compare",
            expected="result files, or --printed",
            mend="airzoo-bench compare a/result.json b/result.json",
        )
    if len(paths) == 1 and (reference or scene or most_different):
        raise UsageError(
            "--reference, --scene and --most-different need two or more results",
            mend="name another result, or leave the option out",
        )
    methods = read_scored(paths)
    check_comparable(methods)
    scores = choose_scores(methods, wanted)
    if len(methods) == 1:
        return intervals_table(methods[0], scores, score_intervals(methods[0], scores, plan), plan)
    if most_different is not None:
        place = find_scene(methods[0], scene)
        return differences_table(methods, scores, most_different, place)
    return comparison_table(
        compare_methods(methods, scores, reference=reference, scene=scene, plan=plan)
    )
