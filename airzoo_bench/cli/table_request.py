"""The options of ``airzoo-bench table``, and whether they fit together."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from airzoo_bench.cli.common import AllOption, Format, FormatOption, ScoresOption
from airzoo_bench.core.errors import UsageError

if TYPE_CHECKING:
    from airzoo_bench.results.result import Result

__all__ = ["Layout", "TableRequest"]


class Layout(StrEnum):
    """How results are laid out."""

    RESULT = "result"
    METHODS = "methods"
    SCENES = "scenes"
    BENCHMARKS = "benchmarks"


def _layout_named(text: str) -> Layout:
    """Return the layout of a name, or offer the nearest."""
    from airzoo_bench.core.validation import nearest

    names = [str(layout) for layout in Layout]
    if text not in names:
        raise UsageError(
            f"there is no layout {text[:80]!r}{nearest(text[:80], names)}",
            where="--layout",
            expected="one of " + ", ".join(names),
        )
    return Layout(text)


def _option(help_text: str, *names: str, metavar: str | None = None) -> typer.models.OptionInfo:
    option: typer.models.OptionInfo = typer.Option(*names, help=help_text, metavar=metavar)
    return option


@dataclass(frozen=True)
class TableRequest:
    """The options of the command."""

    results: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="RESULTS", help="One or more result.json, or their folders: paths or URLs."
        ),
    ] = None
    form: FormatOption = Format.TERMINAL
    layout: Annotated[
        Layout | None,
        typer.Option(
            parser=_layout_named,
            metavar=f"[{'|'.join(Layout)}]",
            help="result: a row a scene; methods: a row a method; scenes: methods by scenes side "
            "by side; benchmarks: methods by benchmarks (default: result for one, methods for "
            "several of one protocol, else benchmarks).",
        ),
    ] = None
    scene: Annotated[
        str | None, _option("With methods: this scene instead of the average.", "--scene")
    ] = None
    every_score: AllOption = False
    scores: ScoresOption = None
    published: Annotated[
        bool, _option("Add rows of published numbers, marked as such.", "--published")
    ] = False
    protocol: Annotated[
        str | None,
        _option("With --published, instead of results: print what is published on it."),
    ] = None
    second: Annotated[bool, _option("Underline the second best of each score.", "--second")] = False
    baseline: Annotated[
        list[str] | None,
        _option(
            "NAME: write gains over it, of the highlighted rows if there are any; or METHOD=NAME. "
            "Repeatable."
        ),
    ] = None
    highlight: Annotated[list[str] | None, _option("Colour this method's row; repeatable.")] = None
    cite: Annotated[
        list[str] | None,
        _option("LaTeX: METHOD=KEY, a .toml file of such, or airzoo-paper; repeatable."),
    ] = None
    intervals: Annotated[
        bool, _option("Show 95 % intervals next to the values.", "--intervals")
    ] = False
    floors: Annotated[
        bool,
        _option("Add rows for what needs no method: chance level, the prior itself.", "--floors"),
    ] = False
    sort: Annotated[
        str | None,
        _option(
            "Put the best methods by this score on top, or with 'method' go by their names.",
            metavar="SCORE",
        ),
    ] = None
    decimals: Annotated[
        int | None, typer.Option(min=0, max=6, help="Digits behind the point (default: 2).")
    ] = None
    queries: Annotated[
        bool, _option("With scenes: show their numbers of queries.", "--queries")
    ] = False
    average: Annotated[
        bool, typer.Option(help="With scenes: the average over them.", show_default=False)
    ] = True
    rename: Annotated[
        list[str] | None,
        _option(
            "OLD=NEW: another name for a method, scene, benchmark or score, as the table shows it; "
            "methods of different benchmarks with one name share a row. Repeatable."
        ),
    ] = None
    fit: Annotated[bool, _option("LaTeX: shrink a table that is wider than the line.", "--fit")] = (
        False
    )

    def layout_for(self, results: list[Result]) -> Layout:
        """Return the layout of results, and refuse options that do not go with it."""
        names = {result.protocol.name for result in results}
        layout = self.layout
        if layout is None and len(names) > 1:
            layout = Layout.BENCHMARKS
        elif layout is None:
            # One result has nothing to be compared with, unless reported rows are asked for.
            alone = len(results) == 1 and not self.published and self.scene is None
            layout = Layout.RESULT if alone else Layout.METHODS
        if layout is Layout.RESULT and len(results) > 1:
            raise UsageError(
                f"layout result shows one result, and here are {len(results)} results",
                fix="choose --layout methods, scenes or benchmarks",
            )
        if layout in (Layout.METHODS, Layout.SCENES) and len(names) > 1:
            raise UsageError(
                f"layout {layout} is for results of one protocol, and these are of {len(names)}",
                fix="choose --layout benchmarks, or name results of one protocol only",
            )
        self.check_options(layout)
        return layout

    def check_options(self, layout: Layout) -> None:
        """Refuse options that a layout does not have."""
        among_methods = ("second", "baseline", "published", "highlight", "cite", "sort")
        wrong = {
            "--scene": self.scene and layout is not Layout.METHODS,
            "--queries": self.queries and layout is not Layout.SCENES,
            "--no-average": not self.average and layout is not Layout.SCENES,
            **{
                f"--{name}": getattr(self, name) and layout is Layout.RESULT
                for name in among_methods
            },
        }
        for name, is_wrong in wrong.items():
            if is_wrong:
                raise UsageError(
                    f"{name} does not go with layout {layout}",
                    fix="choose another --layout: methods, scenes or benchmarks",
                )
