"""``airzoo-bench compare``: whether one method is really better than another."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from airzoo_bench.cli.common import Format, FormatOption, examples, show
from airzoo_bench.core.errors import UsageError

if TYPE_CHECKING:
    from airzoo_bench.tables.model import Table

__all__ = ["EXAMPLES", "PANELS", "compare"]

EXAMPLES = examples(
    "compare results/mine/result.json results/theirs/result.json",
    "compare results/*/result.json --method Mine",
)

PANELS = {
    "What is compared": ("score", "every", "reference", "method", "scene", "most_different"),
    "Output": ("form",),
}


def compare(
    results: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="RESULTS",
            help="Two or more result.json, or their folders; of one, its intervals are printed. "
            "Paths or URLs.",
        ),
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
    method: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Instead: is NAME better than each of the others? Differences, verdicts and wins "
            "are NAME's.",
        ),
    ] = None,
    scene: Annotated[str | None, typer.Option(help="This scene only, by id or title.")] = None,
    most_different: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Instead of tests: list this many queries on which the first score differs most, "
            "with the value of every method and, for two methods, the conditions.",
        ),
    ] = None,
) -> None:
    """Compare methods query by query: differences, intervals, tests, a verdict in words."""
    from airzoo_bench.results.files import results_here

    given, scores = results or [], score or []
    _check(given, every and bool(scores), reference or method, most_different)
    paths = results_here(given)
    if most_different is not None:
        asked = (paths, scores, every, reference, method, scene)
        show(_differences(*asked, most_different), form)
        return
    from airzoo_bench.api import comparison

    found = comparison.compare(
        paths,
        scores,
        every=every,
        reference=reference,
        method=method,
        scene=scene,
    )
    show(found.table, form)


def _check(paths: list[str], twice: bool, named: str | None, most_different: int | None) -> None:
    """Refuse options that exclude each other; `twice` is --all with --score."""
    if not paths:
        raise UsageError(
            "nothing to compare",
            expected="result files",
            fix="airzoo-bench compare a/result.json b/result.json",
        )
    if twice:
        raise UsageError("--all and --score exclude each other", fix="leave one of them out")
    if len(paths) == 1 and (named or most_different):
        raise UsageError(
            "--reference, --method and --most-different need two or more results",
            fix="name another result, or leave the option out",
        )
    if len(paths) > 2 and named and most_different:
        raise UsageError(
            "--most-different of more than two results has no reference",
            expected="two results, or neither --reference nor --method: the best is then compared "
            "with the worst",
        )


def _differences(
    paths: list[Path],
    scores: list[str],
    every: bool,
    reference: str | None,
    method: str | None,
    scene: str | None,
    most: int,
) -> Table:
    from airzoo_bench.api.comparison import Request
    from airzoo_bench.results.comparison import find_one
    from airzoo_bench.tables.comparison import differences_table

    asked = Request.of(paths, scores, every=every, scene=scene, every_column=True)
    one = find_one(asked.methods, reference, method, asked.scores[0], asked.scene)
    base = one if method is None else 1 - one
    return differences_table(asked.methods, asked.scores, most, asked.scene, base=base)
