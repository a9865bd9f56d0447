"""``airzoo-bench plot``: pictures of methods side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from airzoo_bench.cli.breakdown import parse_bins
from airzoo_bench.cli.common import check_output, say, working
from airzoo_bench.errors import UsageError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from airzoo_bench.records import Scored
    from airzoo_bench.result import ScoreColumn

__all__ = ["Kind", "plot"]


_LETTERS_SAID = 10


class Kind(StrEnum):
    """What is drawn."""

    RECALL = "recall"
    ERRORS = "errors"
    THRESHOLDS = "thresholds"
    INTERVALS = "intervals"
    SCENES = "scenes"
    CONDITION = "condition"


_FITS = {
    "--score": (Kind.ERRORS, Kind.INTERVALS, Kind.SCENES, Kind.CONDITION),
    "--by": (Kind.CONDITION,),
    "--bins": (Kind.CONDITION,),
    "--up-to": (Kind.RECALL,),
    "--scene": tuple(kind for kind in Kind if kind is not Kind.SCENES),
}


def plot(
    kind: Annotated[
        str | None, typer.Argument(metavar="KIND", help=f"One of {', '.join(Kind)}.")
    ] = None,
    results: Annotated[
        list[Path] | None,
        typer.Argument(metavar="RESULTS", help="One or more result.json, or their folders."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="The file to save: a .png, .svg or .pdf; required."),
    ] = None,
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
    width: Annotated[
        str | None, typer.Option(help="Such as 3.3in or 8.4cm (default: what the content needs).")
    ] = None,
    height: Annotated[
        str | None, typer.Option(help="Such as 2.4in (default: what the content needs).")
    ] = None,
    title: Annotated[str, typer.Option(help="Written above (default: none).")] = "",
    scene: Annotated[str | None, typer.Option(help="This scene only, by id or title.")] = None,
    bare: Annotated[
        bool, typer.Option("--bare", help="Say the small print on stderr, for the caption.")
    ] = False,
) -> None:
    """Draw recall over K, error curves, precision and recall over d, intervals, scenes, conditions.

    Example: airzoo-bench plot recall results/*/result.json -o recall.pdf --width 3.3in

    Example: airzoo-bench plot errors results/*/result.json --score rotation_deg -o errors.pdf

    Example: airzoo-bench plot thresholds results/*/result.json -o thresholds.pdf

    Example: airzoo-bench plot intervals results/*/result.json --score R@5 -o intervals.png

    Example: airzoo-bench plot scenes results/*/result.json -o scenes.svg --title "By scene"

    Example: airzoo-bench plot condition results/*/result.json --by altitude_m -o altitude.svg
    """
    from airzoo_bench.records import read_scored
    from airzoo_bench.report import draw
    from airzoo_bench.report.figures import check_ending, lacking_letters, save_figure
    from airzoo_bench.report.lengths import parse_length
    from airzoo_bench.report.sheet import Sheet, check_room
    from airzoo_bench.statistics.compatibility import check_comparable

    chosen_kind, given, file = _checked_call(kind, results or [], out)
    _check_options(
        chosen_kind,
        {"--score": score, "--by": by, "--bins": bins, "--up-to": up_to, "--scene": scene},
    )
    check_output(file, given)
    check_ending(file)
    edges = None if bins is None else parse_bins(bins)
    aside: list[str] = []
    sheet = Sheet(
        None if width is None else parse_length(width, "--width"),
        title,
        height_in=None if height is None else parse_length(height, "--height"),
        aside=aside if bare else None,
    )
    methods = read_scored(given)
    check_comparable(methods)
    if scene is not None:
        methods = draw.of_scene(methods, scene)
    drawing: dict[Kind, Callable[[Sequence[Scored], ScoreColumn], Figure]] = {
        Kind.RECALL: lambda these, _: draw.recall(these, up_to, sheet),
        Kind.ERRORS: lambda these, score: draw.errors(these, score, sheet),
        Kind.THRESHOLDS: lambda these, _: draw.thresholds(these, sheet),
        Kind.INTERVALS: lambda these, score: draw.intervals(these, score, sheet),
        Kind.SCENES: lambda these, score: draw.scenes(these, score, sheet),
        Kind.CONDITION: lambda these, score: draw.condition(these, score, by or "", edges, sheet),
    }
    chosen = draw.choose_score(methods, score, of_errors=chosen_kind is Kind.ERRORS)
    with working(f"drawing {file}"):
        figure = drawing[chosen_kind](methods, chosen)
        check_room(figure)
        save_figure(figure, file)
    say("\n".join([f"drew {file}", *aside]))
    letters = "" if file.suffix.lower() == ".svg" else lacking_letters(figure)
    if letters:
        say(_no_glyphs(letters, file))


def _no_glyphs(letters: str, file: Path) -> str:
    shown = " ".join(letters[:_LETTERS_SAID]) + (" ..." if len(letters) > _LETTERS_SAID else "")
    return (
        f"{file}: boxes stand for what the font, DejaVu Sans, lacks: {shown}; other names, or an "
        ".svg, which keeps letters for the reader's fonts, show them"
    )


def _checked_call(
    kind: str | None, results: list[Path], out: Path | None
) -> tuple[Kind, list[Path], Path]:
    """Return what must be given, or say what is missing and how it looks."""
    chosen = None if kind is None else _checked_kind(kind)
    if chosen is None or not results or out is None:
        needed = {
            f"a kind, one of {', '.join(Kind)}": chosen,
            "results": results,
            "-o, the file to save": out,
        }
        example = chosen or Kind.RECALL
        by = " --by weather" if example is Kind.CONDITION else ""
        raise UsageError(
            "plot needs " + "; and ".join(what for what, value in needed.items() if not value),
            expected=f"such as `airzoo-bench plot {example} results/*/result.json{by} "
            f"-o {example}.png`",
        )
    return chosen, results, out


def _checked_kind(kind: str) -> Kind:
    if kind not in list(Kind):
        from airzoo_bench.validation import nearest

        known = [one.value for one in Kind]
        is_file = Path(kind).exists() or kind.endswith(".json")
        raise UsageError(
            f"{kind!r} is no kind of picture{nearest(kind.lower(), known)}",
            expected="one of " + ", ".join(known),
            mend="name the kind before the results" if is_file else None,
        )
    return Kind(kind)


def _check_options(kind: Kind, given: dict[str, object]) -> None:
    if kind is Kind.CONDITION and given["--by"] is None:
        raise UsageError(
            "plot condition needs --by, the column of the records to group by",
            expected="such as `airzoo-bench plot condition ... --by weather`",
        )
    for option, value in given.items():
        if value is not None and kind not in _FITS[option]:
            raise UsageError(
                f"{option} does not go with the kind {kind.value!r}",
                expected="the kind " + " or ".join(fitting.value for fitting in _FITS[option]),
            )
