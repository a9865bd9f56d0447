"""``airzoo-bench plot``: pictures of methods side by side, a command a kind."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from airzoo_bench.cli.breakdown import parse_bins
from airzoo_bench.cli.common import examples
from airzoo_bench.cli.plot_call import (
    BareOption,
    Call,
    DpiOption,
    HeightOption,
    OutOption,
    ResultsArgument,
    SceneOption,
    ScoreOption,
    TitleOption,
    WidthOption,
    lacking,
)
from airzoo_bench.core.errors import UsageError

__all__ = ["app"]


class _Kinds(TyperGroup):
    """The commands, by the names of kinds; another name gets a message of ours."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        known = self.list_commands(ctx)
        if args[0] not in known:
            raise _unknown_kind(args[0], known)
        return super().resolve_command(ctx, args)


app = typer.Typer(cls=_Kinds, invoke_without_command=True)


@app.callback(
    epilog=examples("plot recall results/*/result.json -o recall.pdf --width 3.3in"),
)
def plot(ctx: typer.Context) -> None:
    """Draw results as pictures; each KIND has its own help."""
    if ctx.invoked_subcommand is None:
        kinds = ", ".join(ctx.command.list_commands(ctx))  # type: ignore[attr-defined]
        raise lacking("recall", f"a kind, one of {kinds}", "results", "-o, the file to save")


@app.command(
    epilog=examples("plot recall results/*/result.json -o recall.pdf --up-to 20"),
)
def recall(
    results: ResultsArgument = None,
    out: OutOption = None,
    up_to: Annotated[
        int | None, typer.Option(min=1, help="The largest K (default: all kept).")
    ] = None,
    scene: SceneOption = None,
    width: WidthOption = None,
    height: HeightOption = None,
    dpi: DpiOption = None,
    title: TitleOption = "",
    bare: BareOption = False,
) -> None:
    """Draw recall at K over K, a curve a method, the mean over scenes. Of retrieval.

    Each curve goes as far as the method's longest list.
    """
    from airzoo_bench.report import draw

    call = Call("recall", results, out, width, height, dpi, title, bare, scene)
    call.draw(lambda methods, _, sheet: draw.recall(methods, up_to, sheet))


@app.command(
    epilog=examples("plot errors results/*/result.json --score rotation_deg -o errors.pdf"),
)
def errors(
    results: ResultsArgument = None,
    out: OutOption = None,
    score: ScoreOption = None,
    scene: SceneOption = None,
    width: WidthOption = None,
    height: HeightOption = None,
    dpi: DpiOption = None,
    title: TitleOption = "",
    bare: BareOption = False,
) -> None:
    """Draw the share of queries whose error is below a value, a curve a method.

    The score is an error in metres or degrees. Failures are infinite: their curve never reaches
    100 %.
    """
    from airzoo_bench.report import draw

    call = Call("errors", results, out, width, height, dpi, title, bare, scene)
    call.draw(draw.errors, score)


@app.command(
    epilog=examples("plot thresholds results/*/result.json -o thresholds.pdf"),
)
def thresholds(
    results: ResultsArgument = None,
    out: OutOption = None,
    scene: SceneOption = None,
    width: WidthOption = None,
    height: HeightOption = None,
    dpi: DpiOption = None,
    title: TitleOption = "",
    bare: BareOption = False,
) -> None:
    """Draw precision, recall and F1 over the protocol's distances. Of reconstruction."""
    from airzoo_bench.report import draw

    call = Call("thresholds", results, out, width, height, dpi, title, bare, scene)
    call.draw(lambda methods, _, sheet: draw.thresholds(methods, sheet))


@app.command(
    epilog=examples("plot intervals results/*/result.json --score R@5 -o intervals.png"),
)
def intervals(
    results: ResultsArgument = None,
    out: OutOption = None,
    score: ScoreOption = None,
    scene: SceneOption = None,
    width: WidthOption = None,
    height: HeightOption = None,
    dpi: DpiOption = None,
    title: TitleOption = "",
    bare: BareOption = False,
) -> None:
    """Draw a score of each method with its 95 % interval, the best on top."""
    from airzoo_bench.report import draw

    call = Call("intervals", results, out, width, height, dpi, title, bare, scene)
    call.draw(draw.intervals, score)


@app.command(
    epilog=examples('plot scenes results/*/result.json -o scenes.svg --title "By scene"'),
)
def scenes(
    results: ResultsArgument = None,
    out: OutOption = None,
    score: ScoreOption = None,
    width: WidthOption = None,
    height: HeightOption = None,
    dpi: DpiOption = None,
    title: TitleOption = "",
    bare: BareOption = False,
) -> None:
    """Draw a score by method and scene as coloured cells: brighter is better."""
    from airzoo_bench.report import draw

    call = Call("scenes", results, out, width, height, dpi, title, bare)
    call.draw(draw.scenes, score)


@app.command(
    epilog=examples("plot condition results/*/result.json --by altitude_m -o altitude.svg"),
)
def condition(
    results: ResultsArgument = None,
    out: OutOption = None,
    by: Annotated[
        str | None, typer.Option(help="A column of the records, such as weather; required.")
    ] = None,
    bins: Annotated[
        str | None, typer.Option(help="Inner edges of a number, such as 50,100.")
    ] = None,
    score: ScoreOption = None,
    scene: SceneOption = None,
    width: WidthOption = None,
    height: HeightOption = None,
    dpi: DpiOption = None,
    title: TitleOption = "",
    bare: BareOption = False,
) -> None:
    """Draw a score in groups of queries, with 95 % intervals, a marker a method and group."""
    from airzoo_bench.report import draw

    if by is None and results and out is not None:
        raise UsageError(
            "plot condition needs --by, the column of the records to group by",
            expected="such as `airzoo-bench plot condition ... --by weather`",
        )
    edges = None if bins is None else parse_bins(bins)
    call = Call("condition", results, out, width, height, dpi, title, bare, scene)
    call.draw(
        lambda methods, chosen, sheet: draw.condition(methods, chosen, by or "", edges, sheet),
        score,
    )


def _unknown_kind(kind: str, known: list[str]) -> UsageError:
    from airzoo_bench.core.validation import nearest

    is_file = Path(kind).exists() or kind.endswith(".json")
    return UsageError(
        f"{kind!r} is no kind of picture{nearest(kind.lower(), known)}",
        expected="one of " + ", ".join(known),
        fix="name the kind before the results" if is_file else None,
    )
