"""``airzoo-bench compare``: whether one method is really better than another."""

from __future__ import annotations

from dataclasses import dataclass
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


@dataclass(frozen=True)
class _Request:
    """What is to be compared."""

    paths: list[Path]
    scores: list[str]
    every: bool
    reference: str | None
    scene: str | None
    most_different: int | None
    plan: Plan


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
    every: Annotated[
        bool, typer.Option("--all", help="Every score, not the paper's only.")
    ] = False,
    reference: Annotated[
        str | None,
        typer.Option(help="The method to compare with, or 'best' (default: the first)."),
    ] = None,
    scene: Annotated[str | None, typer.Option(help="This scene only, by id or title.")] = None,
    most_different: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Instead of the tests, list so many queries: those on which the first score "
            "differs most, with every method's value and, of two, their conditions.",
        ),
    ] = None,
    interval: Annotated[
        IntervalMethod, typer.Option(help="Which bootstrap interval.")
    ] = IntervalMethod.BCA,
    resamples: Annotated[
        int,
        typer.Option(
            min=100, max=1_000_000, help="Of the bootstrap, and patterns of the permutation test."
        ),
    ] = 10_000,
    seed: Annotated[int, typer.Option(min=0, help="Of resamples and patterns.")] = 0,
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
    request = _Request(results or [], score or [], every, reference, scene, most_different, plan)
    _check(request)
    show(_answer(request), form)


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


def _check(request: _Request) -> None:
    if not request.paths:
        raise UsageError(
            "nothing to compare",
            expected="result files, or --printed",
            mend="airzoo-bench compare a/result.json b/result.json",
        )
    if request.every and request.scores:
        raise UsageError("--all and --score exclude each other", mend="leave one of them out")
    if len(request.paths) == 1 and (request.reference or request.most_different):
        raise UsageError(
            "--reference and --most-different need two or more results",
            mend="name another result, or leave the option out",
        )
    if len(request.paths) > 2 and request.reference and request.most_different:
        raise UsageError(
            "--most-different of more than two results has no reference",
            expected="two results, or no --reference: the best is then held against the worst",
        )


def _answer(request: _Request) -> Table:
    from airzoo_bench.records import read_scored
    from airzoo_bench.result import read_result
    from airzoo_bench.result_files import result_paths
    from airzoo_bench.statistics import comparison
    from airzoo_bench.statistics.comparison_layout import comparison_table
    from airzoo_bench.statistics.compatibility import (
        check_comparable,
        choose_scores,
        find_scene,
        score_keys,
    )
    from airzoo_bench.statistics.differences import differences_table
    from airzoo_bench.statistics.layout import intervals_table

    paths = result_paths(request.paths)
    keys = score_keys(read_result(paths[0]), request.scores, every=request.every)
    methods = read_scored(paths, None if request.most_different else keys)
    check_comparable(methods)
    scores = choose_scores(methods, request.scores, every=request.every)
    scene, plan = find_scene(methods[0], request.scene), request.plan
    if len(methods) == 1:
        found = comparison.score_intervals(methods[0], scores, plan, scene)
        return intervals_table(methods[0], scores, found, plan, scene)
    base = comparison.find_reference(methods, request.reference, scores[0])
    if request.most_different is not None:
        return differences_table(methods, scores, request.most_different, scene, base=base)
    reference = methods[base].name
    return comparison_table(
        comparison.compare(methods, scores, reference=reference, scene=scene, plan=plan)
    )
