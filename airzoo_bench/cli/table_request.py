"""The options of ``airzoo-bench table``."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Any

import typer

from airzoo_bench.cli.common import AllOption, Format, FormatOption, ScoresOption

Texts = list[str] | None


class Layout(StrEnum):
    """How results are laid out."""

    RESULT = "result"
    METHODS = "methods"
    SCENES = "scenes"
    BENCHMARKS = "benchmarks"


def _option(help_text: str, *names: str, **bounds: Any) -> Any:
    return typer.Option(*names, help=help_text, **bounds)


@dataclass(frozen=True)
class TableRequest:
    """The options of the command."""

    results: list[str]
    layout: Annotated[
        Layout | None,
        _option(
            "result: a row by scene; methods: a row by method; scenes: methods by scenes side by "
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
        bool, _option("Add rows of published numbers, with a dagger.", "--published")
    ] = False
    floors: Annotated[
        bool,
        _option("Add rows without a method: the chance level, the prior itself.", "--floors"),
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
        int | None, _option("Digits after the point (default: 2).", min=0, max=6)
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
        Texts, _option("LaTeX: METHOD=KEY, a .toml file of these, or airzoo-paper; repeatable.")
    ] = None
    form: FormatOption = Format.TERMINAL
