"""The style of all pictures: palette, canvas, legend and small print, and the same bytes again."""

from __future__ import annotations

import io
import re
import textwrap
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError, counted
from airzoo_bench.core.files import atomic_write
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.results.records import Method
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.tables.layouts import UNITS
from airzoo_bench.tables.model import plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure


COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Okabe and Ito's colours, which colour-blind readers can tell apart."""

FORMATS = ("png", "svg", "pdf")
"""What `save_figure` writes, by the ending of the file."""

NARROW_IN = 5.0
"""Narrower pictures fill a column of a paper: they have smaller letters and fewer inches."""

_PALETTE = "viridis"  # even steps of lightness, for print and colour-blind readers
_BEYOND = (213, 94, 0)  # vermilion: at the limit or farther
_LINES, _MARKERS = ("-", "--", "-.", ":"), ("o", "s", "^", "D", "v", "P", "X")
_LONGEST = 48
_LEAST_IN, _MOST_IN = 2.0, 40.0
_LETTER_EM = 0.53
# SVG keeps text as text; neither the time of day nor the version of Matplotlib is in a file.
_FILES = {"svg.hashsalt": "airzoo-bench", "svg.fonttype": "none", "pdf.fonttype": 42}
_METADATA: dict[str, dict[str, None]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
# Tables have room for a word; a picture found alone must say what was measured.
_ERRORS = {
    "error_m": "translation error",
    "horizontal_m": "horizontal error",
    "vertical_m": "vertical error",
    "rotation_deg": "rotation error",
    "distance_m": "distance of the first tile",
    "chamfer_m": "Chamfer distance",
    "accuracy_m": "accuracy",
    "completeness_m": "completeness",
}


@dataclass(frozen=True)
class Sheet:
    """How wide a picture is, in inches, and the small print below it."""

    width_in: float | None = None  # where it is not given, what the content needs
    notes: tuple[str, ...] = ()

    def wide(self, usual: float) -> float:
        """Return the width in inches: the one asked for, else the usual one of the content."""
        return usual if self.width_in is None else self.width_in

    def noting(self, *notes: str) -> Sheet:
        """Return the sheet with more small print; empty notes are none."""
        return replace(self, notes=(*self.notes, *filter(None, notes)))


@contextmanager
def default_style(changes: Any = None) -> Iterator[None]:
    """Draw with Matplotlib's default settings, whatever ``matplotlibrc`` or program has set."""
    import matplotlib as mpl

    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(changes or {})
        yield


@default_style()
def new_canvas(width_in: float, height_in: float) -> Figure:
    """Return an empty figure, without pyplot's global state."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), layout="constrained")


def finish(figure: Figure, sheet: Sheet, names: Sequence[str] = (), *, lines: bool = True) -> None:
    """Set the size of text; let the figure grow by the legend above and small print below."""
    from matplotlib.lines import Line2D

    width, height = figure.get_figwidth(), figure.get_figheight()
    size = 9.5 if width >= NARROW_IN else 7.5
    for axes in figure.axes:
        for text in (axes.xaxis.label, axes.yaxis.label, axes.title):
            text.set_fontsize(size)
        axes.tick_params(axis="both", which="both", labelsize=size - 1)
    if sheet.notes:
        small = max(6.0, 0.72 * size)
        letters = int(0.96 * width * 72 / (small * _LETTER_EM))
        rows = [row for note in sheet.notes for row in textwrap.wrap(plain(note), letters)]
        said = "\n".join(rows).replace("$", r"\$")
        figure.supxlabel(said, fontsize=small, color="0.3", x=0.01, ha="left")
        height += len(rows) * small * 1.25 / 72
    if names:
        style = {"markersize": 4.5, "linewidth": 1.4} | ({} if lines else {"linestyle": "none"})
        handles = [Line2D([], [], **series_style(n) | style) for n in range(len(names))]
        labels = [label_text(name) for name in names]
        widest = max(map(len, labels)) * _LETTER_EM * (size - 1) / 72 + 0.5
        columns = int(np.clip(width / widest, 1, min(4, len(names))))
        place: Any = {"loc": "outside upper center", "frameon": False, "borderaxespad": 0.1}
        place |= {"handlelength": 2.6 if lines else 1.2, "labelspacing": 0.35}
        figure.legend(handles, labels, ncols=columns, fontsize=size - 1, **place)
        height += (-(-len(names) // columns) * 1.45 + 0.8) * (size - 1) / 72
    figure.set_figheight(height)


def parse_length(text: str | None) -> float | None:
    """Convert a width such as ``8.4cm`` or ``3.3in`` to inches; None stays None."""
    if text is None:
        return None
    found = re.fullmatch(r"(\d+(?:\.\d*)?|\.\d+)\s*(cm|in)", text.strip().lower())
    length = float(found[1]) / (2.54 if found[2] == "cm" else 1.0) if found else 0.0
    if not _LEAST_IN <= length <= _MOST_IN:
        expected = f"such as 3.3in or 8.4cm, between {_LEAST_IN:g}in and {_MOST_IN:g}in"
        raise UsageError(f"--width {text!r} is no width that can be drawn", expected=expected)
    return length


def figure_bytes(figure: Figure, form: str, dpi: int = 150, *, clear: bool = False) -> bytes:
    """Render a figure as one of `FORMATS` or as ``jpg``, clear or on white."""
    stream = io.BytesIO()
    with default_style(_FILES), warnings.catch_warnings():
        # Letters that the font lacks are drawn as boxes.
        for said in ("Glyph .* missing", "Matplotlib currently does not", "constrained_layout not"):
            warnings.filterwarnings("ignore", said, UserWarning)
        figure.draw_without_rendering()
        figure.set_layout_engine(None)  # a placeholder would draw everything once more
        for axes in figure.axes:  # rounded, so that files are the same again
            axes.set_position(np.round(axes.get_position(original=True).bounds, 5).tolist())
        options: Any = {"metadata": _METADATA.get(form), "transparent": clear}
        figure.savefig(stream, format=form, dpi=dpi, **options)
    return stream.getvalue()


def check_ending(path: Path) -> str:
    """Return the format that a file's suffix names: one of `FORMATS`."""
    form = path.suffix.lower().removeprefix(".")
    if form not in FORMATS:
        what = f"a picture cannot be written as {path.suffix or 'a file without an ending'}"
        expected = "a file that ends in " + ", ".join(f".{name}" for name in FORMATS)
        raise UsageError(what, where=path, expected=expected)
    return form


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure atomically; the suffix, ``.png``, ``.svg`` or ``.pdf``, gives the format."""
    content = figure_bytes(figure, check_ending(path))
    with atomic_write(path) as stream:
        stream.write(content)


def label_text(name: str) -> str:
    """Return a name as Matplotlib shows it literally, on one line, cut where it is very long."""
    line = plain(name) or "(no name)"
    return (line if len(line) <= _LONGEST else line[: _LONGEST - 1] + "…").replace("$", r"\$")


def series_style(number: int) -> dict[str, Any]:
    """Return colour, line and marker of a series; the first 196 combinations are all different."""
    return {
        "color": COLOURS[number % len(COLOURS)],
        "linestyle": _LINES[number // len(COLOURS) % len(_LINES)],
        "marker": _MARKERS[(number + number // len(COLOURS)) % len(_MARKERS)],
    }


def error_colours(errors: Floats, limit: float) -> NDArray[np.uint8]:
    """Colour errors (N,) as (N, 3): dark to bright up to the limit, vermilion from there on."""
    return error_palette()[error_codes(errors, limit)]


def error_codes(errors: Floats, limit: float) -> NDArray[np.int64]:
    """Return the rows of errors (N,) in `error_palette`."""
    return np.where(errors >= limit, 255, np.minimum(errors / limit * 255, 254)).astype(np.int64)


def error_palette() -> NDArray[np.uint8]:
    """Return the 256 colours of errors; the last one is for errors at the limit or beyond."""
    from matplotlib import colormaps

    table = colormaps[_PALETTE](np.linspace(0, 1, 255))[:, :3]
    return np.asarray(np.vstack([(table * 255).round(), _BEYOND]), np.uint8)


def add_error_bar(figure: Figure, axes: Any, limit: float, label: str) -> None:
    """Add the colour bar of `error_colours`, beside one of the axes or several."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    colours = colormaps[_PALETTE].with_extremes(over=COLOURS[1])
    shown = ScalarMappable(Normalize(0, limit), colours)
    figure.colorbar(shown, ax=axes, label=label, extend="max", shrink=0.85, pad=0.02)


def error_label(score: ScoreColumn) -> str:
    """Name what one query or scene has, with its unit: ``translation error [m]``."""
    return f"{_ERRORS.get(score.key, score.title)} [{UNITS[score.unit]}]"


def axis_label(score: ScoreColumn) -> str:
    """Name a score with its unit: ``R@1 [%]``, ``median translation error [m]``."""
    is_median = score.average == "median" and score.key in _ERRORS
    return f"median {error_label(score)}" if is_median else error_label(score)


def over_scenes(methods: Sequence[Method]) -> str:
    """Return what labels add if values are means over several scenes."""
    return ", mean over scenes" if len(methods[0].result.scenes) > 1 else ""


def noted(methods: Sequence[Method], sheet: Sheet | None) -> Sheet:
    """Return the sheet, or a new one; its small print begins with where the numbers come from."""
    given, result = sheet or Sheet(), methods[0].result
    truth, protocol = result.truth, result.protocol
    titles = list(truth.scene_titles.values())
    measured = f"scene {titles[0]}" if len(titles) == 1 else counted(len(titles), "scene")
    if result.unit == "query":
        measured = f"{counted(len(methods[0].records), 'query')} in {measured}"
    source = (
        f"benchmark {truth.benchmark}, version {truth.version}; protocol {protocol.name}, "
        f"version {protocol.version}: {measured}"
    )
    return replace(given, notes=(source, *given.notes))
