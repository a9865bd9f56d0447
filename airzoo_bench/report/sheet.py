"""Around a picture: its width, a title on demand, the legend, and small print below."""

from __future__ import annotations

import math
import textwrap
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import UsageError, counted
from airzoo_bench.core.optional_imports import default_style
from airzoo_bench.report.figures import (
    NO_ROOM,
    any_letters,
    label_text,
    name_text,
    series_style,
)
from airzoo_bench.tables.model import plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.legend import Legend

__all__ = [
    "LEAST_PT",
    "MOST_IN_LEGEND",
    "Sheet",
    "check_room",
    "finish",
    "slant",
    "wrapped",
]

MOST_IN_LEGEND = 40
"""More methods than these are drawn, but not named."""

LEAST_PT = 6.0
"""The smallest letters of a picture, as publishers ask for."""

_NARROW_IN = 5.0
_LEAST_PICTURE_IN = 0.7
_POINTS = 72.0
_GAP_IN = 0.06
_LINE = 1.3
_SMALL = 0.72
_FEWEST = 10
_LOWEST_IN = 0.15
_LETTER = 0.53  # the mean width of a letter, in sizes of the font


@dataclass(frozen=True)
class Sheet:
    """How a picture is laid out, and what is written around it.

    Attributes
    ----------
    width_in : float, optional
        Inches; where it is not given, as wide as the content asks for.
    title : str
        Above the picture; empty for none.
    notes : tuple of str
        Small print below.
    height_in : float, optional
        Inches, of all that is drawn; where it is not given, what the content needs.
    aside : list of str, optional
        Takes the small print, which is then left out of the picture.
    """

    width_in: float | None = None
    title: str = ""
    notes: tuple[str, ...] = ()
    height_in: float | None = None
    aside: list[str] | None = None

    def wide(self, usual: float) -> float:
        """Return the width in inches: the one asked for, else the usual one of the content."""
        return usual if self.width_in is None else self.width_in

    def font(self, usual: float) -> float:
        """Return the size of the font in points: smaller where a picture fills one column."""
        return 9.5 if self.wide(usual) >= _NARROW_IN else 7.5

    def noting(self, *notes: str) -> Sheet:
        """Return the sheet with more small print; empty notes are none."""
        more = tuple(note for note in notes if note)
        return replace(self, notes=(*self.notes, *more))


def finish(figure: Figure, sheet: Sheet, names: Sequence[str] = (), *, lines: bool = True) -> None:
    """Set the size of text, and write legend, small print and title around the picture."""
    size = sheet.font(figure.get_figwidth())
    _set_fonts(figure, size)
    if len(names) > MOST_IN_LEGEND:
        more = counted(len(names) - MOST_IN_LEGEND, "more method")
        sheet = sheet.noting(f"not named: {more}")
    small = max(LEAST_PT, _SMALL * size)
    notes = _wrapped(figure, sheet.notes, small) if sheet.aside is None else []
    if sheet.aside is not None:
        sheet.aside.extend(sheet.notes)
    with any_letters():
        legend = _add_legend(figure, names[:MOST_IN_LEGEND], lines, size - 1)
        key = legend.get_window_extent().height / figure.dpi if legend else 0.0
    below = len(notes) * small * _LINE / _POINTS + (_GAP_IN if notes else 0.0)
    title = _wrapped(figure, [sheet.title], size)
    above = (_LINE * len(title) + 0.3 * bool(title)) * size / _POINTS + 0.5 * _GAP_IN
    _make_room(figure, (below + key, above), _GAP_IN if legend else 0.0, sheet.height_in)
    height = figure.get_figheight()
    if legend:
        legend.set_bbox_to_anchor((0.5, below / height), transform=figure.transFigure)
    _write(figure, "\n".join(title), notes, size, small)


def _make_room(
    figure: Figure, around: tuple[float, float], gap: float, wanted: float | None
) -> None:
    """Let the figure grow by inches below and above, or to a height; axes keep out of them."""
    below, above = around
    height = figure.get_figheight() + below + above if wanted is None else wanted
    if height - below - above - gap < _LEAST_PICTURE_IN:
        raise UsageError(
            f"--height: {height:g} inches leave no room for the picture",
            expected=f"at least {below + above + gap + _LEAST_PICTURE_IN:.1f}in",
            fix="give a larger --height, or leave out the small print by --bare",
        )
    figure.set_figheight(height)
    bottom = (below + gap) / height
    engine: Any = figure.get_layout_engine()
    engine.set(rect=(0, bottom, 1, 1 - bottom - above / height))


def _write(figure: Figure, title: str, notes: Sequence[str], size: float, small: float) -> None:
    edge, gap = _GAP_IN / figure.get_figwidth(), 0.5 * _GAP_IN / figure.get_figheight()
    style: Any = {"fontsize": small, "color": "0.3", "va": "bottom", "linespacing": 1.15}
    if notes:
        figure.text(edge, gap, "\n".join(notes), **style)
    if title:
        figure.text(0.5, 1 - gap, title, fontsize=size, va="top", ha="center")


@default_style()
def check_room(figure: Figure) -> None:
    """Refuse a picture whose labels leave no room for its axes."""
    try:
        with any_letters():
            warnings.filterwarnings("error", NO_ROOM, UserWarning)
            figure.draw_without_rendering()
        lowest = min(axes.get_position().height for axes in figure.axes) * figure.get_figheight()
    except UserWarning:
        lowest = 0.0
    if lowest < _LOWEST_IN:
        raise UsageError(
            f"{figure.get_figwidth():g} by {figure.get_figheight():.2g} inches are too little for "
            "this picture's labels",
            fix="give a larger --width or --height, or fewer results",
        )


def wrapped(label: str, room_in: float, size: float) -> str:
    """Break the label of an axis into lines that are no longer than the axis."""
    return "\n".join(textwrap.wrap(label, max(10, int(room_in * _POINTS / (size * _LETTER)))))


def slant(axes: Axes, longest: int, slot_pt: float, size: float) -> None:
    """Slant the names below an axis, and let the figure grow to fit them."""
    turn = 45 if slot_pt > 1.8 * size else 90
    for text in axes.get_xticklabels():
        text.set(rotation=turn, ha="right", va="center", rotation_mode="anchor")
    figure = axes.get_figure(root=True)
    if figure is not None:
        more = longest * _LETTER * size * math.sin(math.radians(turn)) / _POINTS
        figure.set_figheight(figure.get_figheight() + more)


def _set_fonts(figure: Figure, size: float) -> None:
    for axes in figure.axes:
        axes.xaxis.label.set_fontsize(size)
        axes.yaxis.label.set_fontsize(size)
        axes.title.set_fontsize(size)
        axes.tick_params(axis="both", which="both", labelsize=size - 1)


def _wrapped(figure: Figure, notes: Sequence[str], size: float) -> list[str]:
    """Break texts into lines that are no wider than the figure, dollars escaped."""
    return [line for note in notes for line in _fitted(figure, plain(note), size)]


def _fitted(figure: Figure, note: str, size: float) -> list[str]:
    room = figure.get_figwidth() - 1.25 * _GAP_IN
    letters = int(room * _POINTS / (size * _LETTER))
    while True:
        lines = [line.replace("$", r"\$") for line in textwrap.wrap(note, max(_FEWEST, letters))]
        if letters <= _FEWEST or _width_in(figure, lines, size) <= room:
            return lines
        letters -= 1


def _width_in(figure: Figure, lines: Sequence[str], size: float) -> float:
    text = figure.text(0, 0, "\n".join(lines), fontsize=size)
    with any_letters():
        width = float(text.get_window_extent().width / figure.dpi)
    text.remove()
    return width


def _add_legend(figure: Figure, names: Sequence[str], lines: bool, size: float) -> Legend | None:
    """Add the legend in as many columns as are no wider than the figure."""
    from matplotlib.lines import Line2D

    if not names:
        return None
    plain = {} if lines else {"linestyle": "none"}
    handles = [
        Line2D([], [], markersize=4.5, linewidth=1.4, **(series_style(number) | plain))
        for number in range(len(names))
    ]
    width = figure.get_figwidth() * figure.dpi
    for columns in range(min(4, len(names)), 0, -1):
        legend = figure.legend(
            handles,
            [label_text(name_text(name)) for name in names],
            loc="lower center",
            bbox_to_anchor=(0.5, 0.0),
            ncols=columns,
            fontsize=size,
            frameon=False,
            borderpad=0.2,
            borderaxespad=0.0,
            handlelength=2.6 if lines else 1.2,
            labelspacing=0.35,
        )
        if columns == 1 or legend.get_window_extent().width <= width:
            return legend
        legend.remove()
    return None
