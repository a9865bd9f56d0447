"""``airzoo-bench plot``: pictures of methods side by side, a command a kind."""

from __future__ import annotations

from functools import partial
from inspect import Parameter
from pathlib import Path
from typing import Annotated, Any

import typer

from airzoo_bench.cli.built import parameter, with_parameters
from airzoo_bench.cli.common import LightGroup, SceneOption, examples, in_panels, say, working
from airzoo_bench.cli.locations import DataOption, ResultsArgument, resolve_data
from airzoo_bench.cli.results import parse_bins


def _option(name: str, kind: Any, help_text: str, default: Any = None, **more: Any) -> Parameter:
    flag = f"--{name.replace('_', '-')}"
    return parameter(name, Annotated[kind, typer.Option(flag, help=help_text, **more)], default)


_OUT = Annotated[Path, typer.Option("--out", "-o", help="The .png, .svg or .pdf to save.")]
_SCORE = _option("score", str | None, "Key or title (default: the first that fits).")
_SCENE = parameter("scene", SceneOption, None)
_DATA = parameter("data", DataOption, None)
_LAST = (
    _option("width", str | None, "Such as 3.3in or 8.4cm (default: what the content needs)."),
    _option("bare", bool, "Print the notes to stderr, for the caption.", False),
)
# Of each kind, a function of `airzoo_bench.report.draw`: its help, an example, its options.
_KINDS: dict[str, tuple[str, str, tuple[Parameter, ...]]] = {
    "recall": (
        "Draw recall at K over K for each method of retrieval, as the mean over scenes.\n\n"
        "Each curve goes as far as the method's longest list.",
        "-o recall.pdf --up-to 20",
        (_option("up_to", int | None, "The largest K (default: all kept).", min=1), _SCENE),
    ),
    "errors": (
        "Draw for each method the share of queries with an error below a value.\n\n"
        "The score is an error in metres or degrees. Failures are infinite: their curve never "
        "reaches 100 %.",
        "--score rotation_deg -o errors.pdf",
        (_SCORE, _SCENE),
    ),
    "thresholds": (
        "Draw precision, recall and F1 of reconstruction over the protocol's distances.",
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
        "-o scenes.svg",
        (_SCORE,),
    ),
    "condition": (
        "Draw a score of each method in groups of queries, with 95 % intervals.",
        "--by altitude_m -o altitude.svg",
        (
            _option("by", str, "A column of the records, such as weather.", Parameter.empty),
            _option("bins", str | None, "Inner edges of a number, such as 50,100."),
            _SCORE,
            _SCENE,
        ),
    ),
    "map": (
        "Draw a scene's map with hits and misses of retrieval, or arrows of matching's errors."
        "\n\nTakes one run. Arrows need a run that was scored with --figures and are magnified.",
        "-o map.png",
        (_SCENE, _DATA),
    ),
    "query": (
        "Draw a query: its photo and first tiles, or its matches coloured by residual.\n\n"
        "Takes one run. Matches need a run that was scored with --figures.",
        "--query city/0001 -o query.png",
        (_option("query", str, "The id of the query.", Parameter.empty), _DATA),
    ),
    "cloud": (
        "Draw predicted and true cloud, coloured by their errors, with precision and recall.\n\n"
        "Takes one run that was scored with --figures.",
        "-o cloud.png",
        (_SCENE,),
    ),
}

app = typer.Typer(cls=LightGroup, no_args_is_help=True, help="Draw results as pictures.")


@app.callback(epilog=examples("plot recall results/*/result.json -o recall.pdf --width 3.3in"))
def _group() -> None:
    """Draw results as pictures; each kind has its own help."""


def _draw(
    kind: str, results: list[str], out: Path, width: str | None, bare: bool, **more: Any
) -> None:
    from airzoo_bench.core.files import check_output_file
    from airzoo_bench.report.draw import picture
    from airzoo_bench.report.figures import Sheet, check_ending, parse_length, save_figure
    from airzoo_bench.results.files import results_here

    check_ending(out)
    check_output_file(out)
    if "bins" in more:
        more["bins"] = parse_bins(more["bins"])
    if "data" in more:
        more["data"] = resolve_data(more["data"])
    aside: list[str] = []
    sheet = Sheet(parse_length(width), aside=aside if bare else None)
    with working(f"drawing {out}"):
        save_figure(picture(kind, results_here(results), sheet, **more), out)
    say("\n".join([f"drew {out}", *aside]))


for _kind, (_summary, _example, _own) in _KINDS.items():
    _named = "results/mymethod" if _kind in ("map", "query", "cloud") else "results/*/result.json"
    _all = [parameter("results", ResultsArgument), parameter("out", _OUT), *_own, *_LAST]
    _all.sort(key=lambda one: one.default is not Parameter.empty)
    app.command(_kind, cls=in_panels({}), epilog=examples(f"plot {_kind} {_named} {_example}"))(
        with_parameters(partial(_draw, _kind), _all, _summary)
    )
