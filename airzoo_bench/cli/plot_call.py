"""A call of ``airzoo-bench plot``: the options that all kinds have, and from results to a file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from airzoo_bench.cli.common import check_output, say, say_replaced, working
from airzoo_bench.core.errors import UsageError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from airzoo_bench.report.sheet import Sheet
    from airzoo_bench.results.records import Scored
    from airzoo_bench.results.result import ScoreColumn

__all__ = [
    "BareOption",
    "Call",
    "DpiOption",
    "HeightOption",
    "OutOption",
    "ResultsArgument",
    "SceneOption",
    "ScoreOption",
    "TitleOption",
    "WidthOption",
    "lacking",
]

_LETTERS_SAID = 10

ResultsArgument = Annotated[
    list[Path] | None,
    typer.Argument(metavar="RESULTS", help="One or more result.json, or their folders; required."),
]
OutOption = Annotated[
    Path | None,
    typer.Option("--out", "-o", help="The file to save: a .png, .svg or .pdf; required."),
]
ScoreOption = Annotated[
    str | None, typer.Option(help="Key or title (default: the first that fits).")
]
SceneOption = Annotated[str | None, typer.Option(help="This scene only, by id or title.")]
WidthOption = Annotated[
    str | None, typer.Option(help="Such as 3.3in or 8.4cm (default: what the content needs).")
]
HeightOption = Annotated[
    str | None, typer.Option(help="Such as 2.4in (default: what the content needs).")
]
DpiOption = Annotated[
    int | None,
    typer.Option(min=30, max=1200, help="Dots per inch of a .png (default: 150)."),
]
TitleOption = Annotated[str, typer.Option(help="Written above (default: none).")]
BareOption = Annotated[
    bool, typer.Option("--bare", help="Say the small print on stderr, for the caption.")
]


@dataclass(frozen=True)
class Call:
    """What the options that all kinds have ask for."""

    kind: str
    results: list[Path] | None
    out: Path | None
    width: str | None
    height: str | None
    dpi: int | None
    title: str
    bare: bool
    scene: str | None = None

    def draw(
        self,
        drawing: Callable[[Sequence[Scored], ScoreColumn, Sheet], Figure],
        score: str | None = None,
    ) -> None:
        """Read the results, draw and save; `drawing` gets the score that was asked for."""
        from airzoo_bench.report import draw
        from airzoo_bench.report.figures import save_figure
        from airzoo_bench.report.sheet import check_room
        from airzoo_bench.results.records import read_scored
        from airzoo_bench.statistics.compatibility import check_comparable

        given, file = self._checked()
        aside: list[str] = []
        sheet = self._sheet(aside)
        say_replaced(file)
        methods = read_scored(given)
        check_comparable(methods)
        if self.scene is not None:
            methods = draw.of_scene(methods, self.scene)
        chosen = draw.choose_score(methods, score, of_errors=self.kind == "errors")
        with working(f"drawing {file}"):
            figure = drawing(methods, chosen, sheet)
            check_room(figure)
            save_figure(figure, file, dpi=self.dpi)
        say("\n".join([f"drew {file}", *aside]))
        _say_lacking_letters(figure, file)

    def _checked(self) -> tuple[list[Path], Path]:
        """Return what must be given, or say what is missing and how it looks."""
        from airzoo_bench.report.figures import check_ending

        if not self.results or self.out is None:
            needed = {"results": self.results, "-o, the file to save": self.out}
            raise lacking(self.kind, *(what for what, value in needed.items() if not value))
        check_output(self.out, self.results)
        if check_ending(self.out) != "png" and self.dpi is not None:
            raise UsageError(
                f"--dpi is for .png, and {self.out} is drawn in lines and letters",
                fix="leave it out, or save a .png",
            )
        return self.results, self.out

    def _sheet(self, aside: list[str]) -> Sheet:
        from airzoo_bench.report.lengths import parse_length
        from airzoo_bench.report.sheet import Sheet

        return Sheet(
            None if self.width is None else parse_length(self.width, "--width"),
            self.title,
            height_in=None if self.height is None else parse_length(self.height, "--height"),
            aside=aside if self.bare else None,
        )


def _say_lacking_letters(figure: Figure, file: Path) -> None:
    from airzoo_bench.report.figures import lacking_letters

    letters = "" if file.suffix.lower() == ".svg" else lacking_letters(figure)
    if letters:
        say(_no_glyphs(letters, file))


def _no_glyphs(letters: str, file: Path) -> str:
    shown = " ".join(letters[:_LETTERS_SAID]) + (" ..." if len(letters) > _LETTERS_SAID else "")
    return (
        f"{file}: boxes stand for what the font, DejaVu Sans, lacks: {shown}; other names, or an "
        ".svg, which keeps letters for the reader's fonts, show them"
    )


def lacking(kind: str, *parts: str) -> UsageError:
    """Make the fault of a call that lacks parts, with how a whole one looks."""
    by = " --by weather" if kind == "condition" else ""
    return UsageError(
        "plot needs " + "; and ".join(parts),
        expected=f"such as `airzoo-bench plot {kind} results/*/result.json{by} -o {kind}.png`",
    )
