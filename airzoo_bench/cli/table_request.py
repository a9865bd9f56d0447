"""The options of ``airzoo-bench table``, and whether they fit together."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Any

import typer

from airzoo_bench.cli.common import AllOption, Format, FormatOption, ScoresOption
from airzoo_bench.core.errors import UsageError


class Layout(StrEnum):
    """How results are laid out."""

    RESULT = "result"
    METHODS = "methods"
    SCENES = "scenes"
    BENCHMARKS = "benchmarks"


def _option(help_text: str, *names: str, **bounds: Any) -> typer.models.OptionInfo:
    option: typer.models.OptionInfo = typer.Option(*names, help=help_text, **bounds)
    return option


Texts = list[str] | None


@dataclass(frozen=True)
class TableRequest:
    """The options of the command."""

    results: Annotated[
        list[str],
        typer.Argument(
            metavar="RESULTS",
            help="One or more result.json, or their folders: paths or URLs. With --published also "
            "names of protocols, for what papers print on them.",
        ),
    ]
    form: FormatOption = Format.TERMINAL
    layout: Annotated[
        Layout | None,
        _option(
            "result: a row a scene; methods: a row a method; scenes: methods by scenes side by "
            "side; benchmarks: methods by benchmarks (default: result for one, methods for "
            "several of one protocol, else benchmarks)."
        ),
    ] = None
    scene: Annotated[
        str | None, _option("With methods: this scene instead of the average.", "--scene")
    ] = None
    every: AllOption = False
    scores: ScoresOption = None
    published: Annotated[
        bool, _option("Add rows of published numbers, marked as such.", "--published")
    ] = False
    floors: Annotated[
        bool,
        _option("Add rows for what needs no method: chance level, the prior itself.", "--floors"),
    ] = False
    rename: Annotated[
        Texts,
        _option(
            "OLD=NEW: another name for a method; methods of different benchmarks with one name "
            "share a row. Repeatable."
        ),
    ] = None
    intervals: Annotated[
        bool, _option("Show 95 % intervals next to the values.", "--intervals")
    ] = False
    decimals: Annotated[
        int | None, _option("Digits behind the point (default: 2).", min=0, max=6)
    ] = None
    second: Annotated[bool, _option("Underline the second best of each score.", "--second")] = False
    baseline: Annotated[
        Texts,
        _option(
            "NAME: write gains over it, of the highlighted rows if there are any; or METHOD=NAME. "
            "Repeatable."
        ),
    ] = None
    highlight: Annotated[Texts, _option("Colour this method's row; repeatable.")] = None
    cite: Annotated[
        Texts, _option("LaTeX: METHOD=KEY, a .toml file of such, or airzoo-paper; repeatable.")
    ] = None

    def layout_for(self, protocols: int, results: int) -> Layout:
        """Return the layout for so many results; refuse what does not go with it."""
        among_methods = ("scene", "published", "second", "baseline", "highlight", "cite")
        asked = [f"--{name}" for name in among_methods if getattr(self, name)]
        layout = self.layout
        if layout is None and protocols > 1:
            layout = Layout.BENCHMARKS
        elif layout is None:
            # One result has nothing to be compared with, unless that is asked for.
            layout = Layout.METHODS if asked or results > 1 else Layout.RESULT
        wrong = ""
        if layout is Layout.RESULT and (asked or results > 1):
            wrong = f"layout result shows one result alone, and here are {results} "
            wrong += f"results {' '.join(asked)}".rstrip()
        elif self.scene and layout is not Layout.METHODS:
            wrong = f"--scene does not go with layout {layout}"
        elif layout in (Layout.METHODS, Layout.SCENES) and protocols > 1:
            wrong = f"layout {layout} is for one protocol, and here are {protocols}"
        if wrong:
            others = [str(one) for one in Layout if one is not layout]
            raise UsageError(wrong, fix=f"choose --layout {', '.join(others)}")
        if self.cite and self.form is not Format.LATEX:
            raise UsageError("--cite is for LaTeX", fix="add --format latex")
        return layout
