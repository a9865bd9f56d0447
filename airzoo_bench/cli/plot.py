"""``airzoo-bench plot``: pictures of methods side by side, a command a kind."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from inspect import Parameter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from airzoo_bench.cli.breakdown import parse_bins
from airzoo_bench.cli.built import parameter, with_parameters
from airzoo_bench.cli.common import LightGroup, check_output, examples, say, say_replaced, working
from airzoo_bench.core.errors import UsageError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["app", "parse_length"]

_LETTERS_SAID = 10
_LEAST_IN = {"--width": 2.0, "--height": 1.0}
_MOST_IN = 40.0
_CM = 2.54


def _option(kind: Any, help_text: str, *names: str, **more: Any) -> Any:
    return Annotated[kind, typer.Option(*names, help=help_text, **more)]


_RESULTS = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="RESULTS",
        help="One or more result.json, or their folders: paths or URLs; required.",
    ),
]
_OUT = _option(Path | None, "The file to save: a .png, .svg or .pdf; required.", "--out", "-o")
_FIRST = (parameter("results", _RESULTS, None), parameter("out", _OUT, None))
_SCORE = parameter(
    "score", _option(str | None, "Key or title (default: the first that fits)."), None
)
_SCENE = parameter("scene", _option(str | None, "This scene only, by id or title."), None)
_SIZE = "(default: what the content needs)."
_LAST = (
    parameter("width", _option(str | None, f"Such as 3.3in or 8.4cm {_SIZE}"), None),
    parameter("height", _option(str | None, f"Such as 2.4in {_SIZE}"), None),
    parameter(
        "dpi",
        _option(int | None, "Dots per inch of a .png (default: 150).", min=30, max=1200),
        None,
    ),
    parameter("title", _option(str, "Written above (default: none)."), ""),
    parameter(
        "bare", _option(bool, "Say the small print on stderr, for the caption.", "--bare"), False
    ),
)


@dataclass(frozen=True)
class _Kind:
    """A kind of picture: a command, and the function of that name in `airzoo_bench.report.draw`.

    `own` are options that not all kinds have; `prepare` makes the function's arguments of them.
    """

    name: str
    summary: str
    example: str
    own: Sequence[Parameter]
    prepare: Callable[..., dict[str, Any]] = dict


def _groups(by: str | None, bins: str | None) -> dict[str, Any]:
    if by is None:
        raise UsageError(
            "plot condition needs --by, the column of the records to group by",
            expected="such as `airzoo-bench plot condition ... --by weather`",
        )
    return {"by": by, "bins": None if bins is None else parse_bins(bins)}


_KINDS = (
    _Kind(
        "recall",
        """Draw recall at K over K, a curve a method, the mean over scenes. Of retrieval.

        Each curve goes as far as the method's longest list.
        """,
        "-o recall.pdf --up-to 20",
        (
            parameter(
                "up_to", _option(int | None, "The largest K (default: all kept).", min=1), None
            ),
            _SCENE,
        ),
    ),
    _Kind(
        "errors",
        """Draw the share of queries whose error is below a value, a curve a method.

        The score is an error in metres or degrees. Failures are infinite: their curve never
        reaches 100 %.
        """,
        "--score rotation_deg -o errors.pdf",
        (_SCORE, _SCENE),
    ),
    _Kind(
        "thresholds",
        "Draw precision, recall and F1 over the protocol's distances. Of reconstruction.",
        "-o thresholds.pdf",
        (_SCENE,),
    ),
    _Kind(
        "intervals",
        "Draw a score of each method with its 95 % interval, the best on top.",
        "--score R@5 -o intervals.png",
        (_SCORE, _SCENE),
    ),
    _Kind(
        "scenes",
        "Draw a score by method and scene as coloured cells: brighter is better.",
        '-o scenes.svg --title "By scene"',
        (_SCORE,),
    ),
    _Kind(
        "condition",
        "Draw a score in groups of queries, with 95 % intervals, a marker a method and group.",
        "--by altitude_m -o altitude.svg",
        (
            parameter(
                "by",
                _option(str | None, "A column of the records, such as weather; required."),
                None,
            ),
            parameter(
                "bins", _option(str | None, "Inner edges of a number, such as 50,100."), None
            ),
            _SCORE,
            _SCENE,
        ),
        _groups,
    ),
)


class _Group(LightGroup):
    """Commands by kind of picture, with an own message for an unknown one."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        known, kind = self.list_commands(ctx), args[0]
        if kind in known:
            return super().resolve_command(ctx, args)
        from airzoo_bench.core.validation import nearest

        is_file = Path(kind).exists() or kind.endswith(".json")
        raise UsageError(
            f"{kind!r} is no kind of picture{nearest(kind.lower(), known)}",
            expected="one of " + ", ".join(known),
            fix="name the kind before the results" if is_file else None,
        )


app = typer.Typer(cls=_Group, invoke_without_command=True)


@app.callback(
    epilog=examples("plot recall results/*/result.json -o recall.pdf --width 3.3in"),
)
def plot(ctx: typer.Context) -> None:
    """Draw results as pictures; each KIND has its own help."""
    if ctx.invoked_subcommand is None:
        kinds = ", ".join(kind.name for kind in _KINDS)
        raise _lacking("recall", f"a kind, one of {kinds}", "results", "-o, the file to save")


def _draw(
    kind: _Kind,
    results: list[str] | None,
    out: Path | None,
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
    from airzoo_bench.report.figures import save_figure
    from airzoo_bench.report.sheet import Sheet, check_room
    from airzoo_bench.results.comparable import check_same_queries
    from airzoo_bench.results.records import read_scored

    given, file = _checked(kind, results, out, dpi)
    asked = kind.prepare(**more)
    aside: list[str] = []
    sheet = Sheet(
        parse_length(width, "--width"),
        title,
        height_in=parse_length(height, "--height"),
        aside=aside if bare else None,
    )
    say_replaced(file)
    methods = read_scored(given)
    check_same_queries(methods)
    if scene is not None:
        methods = draw.of_scene(methods, scene)
    chosen = draw.choose_score(methods, score, of_errors=kind.name == "errors")
    with working(f"drawing {file}"):
        of = (methods, chosen) if _SCORE in kind.own else (methods,)
        figure = getattr(draw, kind.name)(*of, sheet=sheet, **asked)
        check_room(figure)
        save_figure(figure, file, dpi=dpi)
    say("\n".join([f"drew {file}", *aside]))
    _say_lacking_letters(figure, file)


for _kind in _KINDS:
    app.command(
        _kind.name, epilog=examples(f"plot {_kind.name} results/*/result.json {_kind.example}")
    )(with_parameters(partial(_draw, _kind), (*_FIRST, *_kind.own, *_LAST), _kind.summary))


def _checked(
    kind: _Kind, results: list[str] | None, out: Path | None, dpi: int | None
) -> tuple[list[Path], Path]:
    """Return results and output file, or raise an error that says what is missing."""
    from airzoo_bench.report.figures import check_ending
    from airzoo_bench.results.files import results_here

    if not results or out is None:
        needed = {"results": results, "-o, the file to save": out}
        raise _lacking(kind.name, *(what for what, value in needed.items() if not value))
    paths = results_here(results)
    check_output(out, paths)
    if check_ending(out) != "png" and dpi is not None:
        raise UsageError(
            f"--dpi is for .png, and {out} is drawn in lines and letters",
            fix="leave it out, or save a .png",
        )
    return paths, out


def parse_length(text: str | None, option: str = "--width") -> float | None:
    """Convert ``8.4cm`` or ``3.3in`` to inches; None stays None.

    Raises
    ------
    UsageError
        It is no length, or beyond 2 to 40 inches of width, 1 to 40 of height.
    """
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


def _say_lacking_letters(figure: Figure, file: Path) -> None:
    from airzoo_bench.report.figures import lacking_letters

    letters = "" if file.suffix.lower() == ".svg" else lacking_letters(figure)
    if letters:
        shown = " ".join(letters[:_LETTERS_SAID]) + " ..." * (len(letters) > _LETTERS_SAID)
        say(
            f"{file}: boxes stand for what the font, DejaVu Sans, lacks: {shown}; other names, or "
            "an .svg, which keeps letters for the reader's fonts, show them"
        )


def _lacking(kind: str, *parts: str) -> UsageError:
    """Return the error for a call without its required parts, with a complete example."""
    by = " --by weather" if kind == "condition" else ""
    return UsageError(
        "plot needs " + "; and ".join(parts),
        expected=f"such as `airzoo-bench plot {kind} results/*/result.json{by} -o {kind}.png`",
    )
