"""``airzoo-bench compare``: whether one method is really better than another."""

from __future__ import annotations

from typing import Annotated

import typer

from airzoo_bench.cli.common import (
    AllOption,
    Format,
    FormatOption,
    SceneOption,
    ScoresOption,
    examples,
    show,
)
from airzoo_bench.cli.locations import ResultsArgument
from airzoo_bench.core.errors import UsageError

__all__ = ["EXAMPLES", "compare"]

EXAMPLES = examples(
    "compare results/mine/result.json results/theirs/result.json",
    "compare results/*/result.json --method Mine",
)


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
    most_different: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Instead of tests: list this many queries on which two methods differ most by the "
            "first score, with their conditions.",
        ),
    ] = None,
) -> None:
    """Compare methods query by query: differences, intervals, tests, a verdict in words.

    Of one result, its intervals are printed.
    """
    from airzoo_bench.api import results as face
    from airzoo_bench.results.comparable import find_scene
    from airzoo_bench.results.comparison import find_one
    from airzoo_bench.results.files import results_here
    from airzoo_bench.tables.comparison import differences_table

    paths, scores = results_here(results), score or []
    if every and scores:
        raise UsageError("--all and --score exclude each other", fix="leave one of them out")
    if len(paths) == 1 and (reference or method):
        raise UsageError(
            "--reference and --method need two or more results",
            fix="name another result, or leave the option out",
        )
    if most_different and len(paths) != 2:
        raise UsageError(
            f"--most-different compares two results, and here are {len(paths)}",
            fix="name two results",
        )
    if most_different is None:
        found = face.compare(
            paths, scores, every=every, reference=reference, method=method, scene=scene
        )
        show(found.table, form)
        return
    methods, chosen = face.methods_of(paths, scores, every=every, all_columns=True)
    where = scene and find_scene(methods[0].result.truth.scene_titles, scene)
    one = find_one(methods, reference, method, chosen[0], where)
    base = one if method is None else 1 - one
    show(differences_table(methods, chosen, most_different, where, base=base), form)
