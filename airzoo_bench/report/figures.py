"""Drawing and writing figures: no window, no state, the same bytes for the same numbers."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import atomic_write
from airzoo_bench.core.optional_imports import default_style
from airzoo_bench.tables.model import plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "COLOURS",
    "FORMATS",
    "NO_ROOM",
    "any_letters",
    "check_ending",
    "figure_bytes",
    "label_text",
    "lacking_letters",
    "name_text",
    "new_canvas",
    "new_figure",
    "save_figure",
    "series_style",
]

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's colours, which colour-blind readers can tell apart."""

FORMATS = ("png", "svg", "pdf")
"""What `save_figure` writes, by the ending of the file."""

NO_ROOM = "constrained_layout not applied"
"""How Matplotlib's warning begins where labels leave no room for axes."""

_DPI = 150
_PLACE_DIGITS = 5
_LINES = ("-", "--", "-.", ":")
_MARKERS = ("o", "s", "^", "D", "v", "P", "X")
_LONGEST = 48
_NO_NAME = "(no name)"
# SVG keeps text as text, and names its parts by a fixed salt.
_FILES = {"svg.hashsalt": "airzoo-bench", "svg.fonttype": "none", "pdf.fonttype": 42}
# Neither the time of day nor the version of Matplotlib stands in the file.
_METADATA: dict[str, dict[str, None]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


@default_style()
def new_figure(width_in: float = 6.0, height_in: float = 4.0) -> tuple[Figure, Axes]:
    """Return a figure and its axes."""
    figure = new_canvas(width_in, height_in)
    return figure, figure.add_subplot()


@default_style()
def new_canvas(width_in: float, height_in: float) -> Figure:
    """Return an empty figure, without pyplot's global state."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


@contextmanager
def any_letters() -> Iterator[None]:
    """Ignore Matplotlib's warnings about letters that the font lacks; they are drawn as boxes."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        warnings.filterwarnings("ignore", "Matplotlib currently does not support", UserWarning)
        yield


def lacking_letters(figure: Figure) -> str:
    """Return the letters in a picture's texts that the font lacks, each once."""
    with default_style():
        from matplotlib.font_manager import FontProperties, findfont, get_font
        from matplotlib.text import Text

        font = get_font(findfont(FontProperties()))
        texts: list[Any] = figure.findobj(Text)
    letters = dict.fromkeys(letter for text in texts for letter in text.get_text())
    return "".join(c for c in letters if c != "\n" and not font.get_char_index(ord(c)))


def figure_bytes(
    figure: Figure, form: str, settings: dict[str, Any] | None = None, dpi: int | None = None
) -> bytes:
    """Render a figure."""
    stream = io.BytesIO()
    with default_style(_FILES | (settings or {})), any_letters():
        warnings.filterwarnings("ignore", NO_ROOM, UserWarning)
        _settle(figure)
        figure.savefig(stream, format=form, dpi=dpi or _DPI, metadata=_METADATA[form])
    return stream.getvalue()


def check_ending(path: Path) -> str:
    """Return the format that a file's suffix names: one of `FORMATS`."""
    form = path.suffix.lower().removeprefix(".")
    if form not in FORMATS:
        raise UsageError(
            f"a picture cannot be written as {path.suffix or 'a file without an ending'}",
            where=path,
            expected="a file that ends in " + ", ".join(f".{name}" for name in FORMATS),
        )
    return form


def _settle(figure: Figure) -> None:
    """Round the positions of axes."""
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for axes in figure.axes:
        x, y, width, height = np.round(axes.get_position(original=True).bounds, _PLACE_DIGITS)
        axes.set_position((float(x), float(y), float(width), float(height)))


def save_figure(
    figure: Figure, path: Path, settings: dict[str, Any] | None = None, dpi: int | None = None
) -> None:
    """Write a figure atomically; the suffix, ``.png``, ``.svg`` or ``.pdf``, gives the format."""
    content = figure_bytes(figure, check_ending(path), settings, dpi)
    with atomic_write(path) as stream:
        stream.write(content)


def label_text(name: str) -> str:
    """Return a name as Matplotlib shows it literally, on one line, cut where it is very long."""
    line = plain(name)
    short = line if len(line) <= _LONGEST else line[: _LONGEST - 1] + "…"
    return short.replace("$", r"\$")


def name_text(name: str) -> str:
    """Return a method's name on one line, or a placeholder if it is blank."""
    return plain(name) or _NO_NAME


def series_style(number: int) -> dict[str, Any]:
    """Return colour, line and marker of a series; the first 196 combinations are all different."""
    return {
        "color": COLOURS[number % len(COLOURS)],
        "linestyle": _LINES[number // len(COLOURS) % len(_LINES)],
        "marker": _MARKERS[(number + number // len(COLOURS)) % len(_MARKERS)],
    }
