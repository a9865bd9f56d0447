"""``airzoo-bench plot``: pictures of methods side by side, a command a kind."""

from __future__ import annotations

import re
from functools import partial
from inspect import Parameter
from pathlib import Path
from typing import Annotated, Any

import typer

from airzoo_bench.cli.breakdown import parse_bins
from airzoo_bench.cli.built import parameter, with_parameters
from airzoo_bench.cli.common import (
    LightGroup,
    SceneOption,
    check_output,
    examples,
    say,
    say_replaced,
    working,
)
from airzoo_bench.cli.locations import ResultsArgument
from airzoo_bench.core.errors import UsageError

__all__ = ["app", "parse_length"]

_LETTERS_SAID = 10
_LEAST_IN = {"--width": 2.0, "--height": 1.0}
_MOST_IN = 40.0
_CM = 2.54


def _option(name: str, kind: Any, help_text: str, default: Any = None, **more: Any) -> Parameter:
    flags = [f"--{name.replace('_', '-')}"] if kind is bool else []
    return parameter(name, Annotated[kind, typer.Option(*flags, help=help_text, **more)], default)


_OUT = Annotated[Path, typer.Option("--out", "-o", help="The .png, .svg or .pdf to save.")]
_SCORE = _option("score", str | None, "Key or title (default: the first that fits).")
_SCENE = parameter("scene", SceneOption, None)
_SIZE = "(default: what the content needs)."
_LAST = (
    _option("width", str | None, f"Such as 3.3in or 8.4cm {_SIZE}"),
    _option("height", str | None, f"Such as 2.4in {_SIZE}"),
    _option("dpi", int | None, "Dots per inch of a .png (default: 150).", min=30, max=1200),
    _option("title", str, "Written above (default: none).", ""),
    _option("bare", bool, "Say the small print on stderr, for the caption.", False),
)
# Of each kind, a function of `airzoo_bench.report.draw`: its help, an example, its options.
_KINDS: dict[str, tuple[str, str, tuple[Parameter, ...]]] = {
    "recall": (
        "Draw recall at K over K, a curve a method, the mean over scenes. Of retrieval.\n\n"
        "Each curve goes as far as the method's longest list.",
        "-o recall.pdf --up-to 20",
        (_option("up_to", int | None, "The largest K (default: all kept).", min=1), _SCENE),
    ),
    "errors": (
        "Draw the share of queries whose error is below a value, a curve a method.\n\n"
        "The score is an error in metres or degrees. Failures are infinite: their curve never "
        "reaches 100 %.",
        "--score rotation_deg -o errors.pdf",
        (_SCORE, _SCENE),
    ),
    "thresholds": (
        "Draw precision, recall and F1 over the protocol's distances. Of reconstruction.",
        "-o thresholds.pdf",
        (_SCENE,),
    ),
    "intervals": (
        "Draw a score of each method with its 95 % interval, the best on top.",
        "--score R@5 -o intervals.png",
        (_SCORE, _SCENE),
    ),
    "scenes": (
        "Draw a score by method and scene as coloured cells: brighter is better.",
        '-o scenes.svg --title "By scene"',
        (_SCORE,),
    ),
    "condition": (
        "Draw a score in groups of queries, with 95 % intervals, a marker a method and group.",
        "--by altitude_m -o altitude.svg",
        (
            _option("by", str, "A column of the records, such as weather.", Parameter.empty),
            _option("bins", str | None, "Inner edges of a number, such as 50,100."),
            _SCORE,
            _SCENE,
        ),
    ),
}

app = typer.Typer(cls=LightGroup, no_args_is_help=True, help="Draw results as pictures.")


@app.callback(epilog=examples("plot recall results/*/result.json -o recall.pdf --width 3.3in"))
def _group() -> None:
    """Draw results as pictures; each kind has its own help."""


def _draw(
    kind: str,
    results: list[str],
    out: Path,
    width: str | None,
    height: str | None,
    dpi: int | None,
    title: str,
    bare: bool,
    score: str | None = None,
    scene: str | None = None,
    **more: Any,
) -> None:
    """Read the results, draw and save."""
    from airzoo_bench.report import draw
    from airzoo_bench.report.figures import check_ending, lacking_letters, save_figure
    from airzoo_bench.report.sheet import Sheet, check_room
    from airzoo_bench.results.comparable import check_same_queries
    from airzoo_bench.results.files import results_here
    from airzoo_bench.results.records import read_scored

    paths = results_here(results)
    check_output(out, paths)
    if check_ending(out) != "png" and dpi is not None:
        fix = "leave it out, or save a .png"
        raise UsageError(f"--dpi is for .png, and {out} is drawn in lines and letters", fix=fix)
    if more.get("bins") is not None:
        more["bins"] = parse_bins(more["bins"])
    aside: list[str] = []
    sheet = Sheet(
        parse_length(width, "--width"),
        title,
        height_in=parse_length(height, "--height"),
        aside=aside if bare else None,
    )
    say_replaced(out)
    methods = read_scored(paths)
    check_same_queries(methods)
    if scene is not None:
        methods = draw.of_scene(methods, scene)
    chosen = draw.choose_score(methods, score, of_errors=kind == "errors")
    with working(f"drawing {out}"):
        of = (methods, chosen) if _SCORE in _KINDS[kind][2] else (methods,)
        figure = getattr(draw, kind)(*of, sheet=sheet, **more)
        check_room(figure)
        save_figure(figure, out, dpi=dpi)
    say("\n".join([f"drew {out}", *aside]))
    letters = "" if out.suffix.lower() == ".svg" else lacking_letters(figure)
    if letters:
        shown = " ".join(letters[:_LETTERS_SAID]) + " ..." * (len(letters) > _LETTERS_SAID)
        say(
            f"{out}: boxes stand for what the font, DejaVu Sans, lacks: {shown}; other names, or "
            "an .svg, which keeps letters for the reader's fonts, show them"
        )


for _kind, (_summary, _example, _own) in _KINDS.items():
    _first = (
        parameter("results", ResultsArgument),
        parameter("out", _OUT),
        *(one for one in _own if one.default is Parameter.empty),
    )
    _rest = [one for one in _own if one.default is not Parameter.empty]
    app.command(_kind, epilog=examples(f"plot {_kind} results/*/result.json {_example}"))(
        with_parameters(partial(_draw, _kind), (*_first, *_rest, *_LAST), _summary)
    )


def parse_length(text: str | None, option: str = "--width") -> float | None:
    """Convert ``8.4cm`` or ``3.3in`` to inches; None stays None."""
    if text is None:
        return None
    found = re.fullmatch(r"(\d+(?:\.\d*)?|\.\d+)\s*(cm|in)", text.strip().lower())
    if not found:
        raise UsageError(f"{option} {text!r} is no {option[2:]}", expected="such as 3.3in or 8.4cm")
    length = float(found[1]) / (_CM if found[2] == "cm" else 1.0)
    least = _LEAST_IN[option]
    if not least <= length <= _MOST_IN:
        raise UsageError(
            f"{option} {text} is too {'small' if length < least else 'large'}",
            expected=f"between {least:g}in and {_MOST_IN:g}in",
        )
    return length
