"""Drawing and writing figures: no window, no state, the same bytes for the same numbers."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.errors import UsageError
from airzoo_bench.files import atomic_write
from airzoo_bench.tables.model import plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "COLOURS",
    "FORMATS",
    "figure_bytes",
    "label_text",
    "new_figure",
    "save_figure",
    "series_style",
]

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's colours, which colour-blind readers can tell apart."""

FORMATS = ("png", "svg", "pdf")
"""What `save_figure` writes, by the ending of the file."""

_DPI = 150
_LINES = ("-", "--", "-.", ":")
_MARKERS = ("o", "s", "^", "D", "v", "P", "X")
_LONGEST = 48
# Neither the time of day nor the version of Matplotlib stands in the file.
_METADATA: dict[str, dict[str, None]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


def new_figure(width_in: float = 6.0, height_in: float = 4.0) -> tuple[Figure, Axes]:
    """Return a figure and its axes, without pyplot's global state."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.add_subplot()


def figure_bytes(figure: Figure, form: str) -> bytes:
    """Render a figure.

    Parameters
    ----------
    figure : Figure
    form : str
        One of `FORMATS`.
    """
    import matplotlib

    stream = io.BytesIO()
    # SVG keeps text as text, and names its parts by a fixed salt.
    style = matplotlib.rc_context(
        {"svg.hashsalt": "airzoo-bench", "svg.fonttype": "none", "pdf.fonttype": 42}
    )
    with style, warnings.catch_warnings():
        # A name in letters that the font lacks is shown as boxes, which is no reason to stop.
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        warnings.filterwarnings("ignore", "Matplotlib currently does not support", UserWarning)
        figure.savefig(stream, format=form, dpi=_DPI, metadata=_METADATA[form])
    return stream.getvalue()


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure as its path ends, ``.png``, ``.svg`` or ``.pdf``, whole or not at all.

    Raises
    ------
    UsageError
        It ends otherwise.
    """
    form = path.suffix.lower().removeprefix(".")
    if form not in FORMATS:
        raise UsageError(
            f"a picture cannot be written as {path.suffix or 'a file without an ending'}",
            where=path,
            expected="a file that ends in " + ", ".join(f".{name}" for name in FORMATS),
        )
    content = figure_bytes(figure, form)
    with atomic_write(path) as stream:
        stream.write(content)


def label_text(name: str) -> str:
    """Return a name as Matplotlib shows it literally, on one line, cut where it is very long."""
    line = plain(name)
    short = line if len(line) <= _LONGEST else line[: _LONGEST - 1] + "…"
    return short.replace("$", r"\$")


def series_style(number: int) -> dict[str, Any]:
    """Return colour, line and marker of a series: no two of the first 28 agree in all."""
    return {
        "color": COLOURS[number % len(COLOURS)],
        "linestyle": _LINES[number // len(COLOURS) % len(_LINES)],
        "marker": _MARKERS[(number + number // len(COLOURS)) % len(_MARKERS)],
    }
