"""The one table model: values apart from how they are shown."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

__all__ = [
    "FLOOR",
    "REPORTED",
    "Between",
    "Cell",
    "Column",
    "PlusMinus",
    "Row",
    "Table",
    "Uncertainty",
    "is_wide",
    "plain",
    "share_to_percent",
    "show_number",
]

_LARGEST = 1e9  # shown with all its digits
REPORTED = "reported, not re-scored"
"""What every row says whose numbers somebody else has printed."""

FLOOR = "what scores without a method"
"""What rows are called that are of no method."""

_DAGGER = "†"


def share_to_percent(value: float) -> float:
    """Turn a share into percent."""
    return 100.0 * value


def is_wide(value: float | int | str | None) -> bool:
    """Whether a number is so large that only powers of ten keep its width bounded."""
    return isinstance(value, float) and abs(value) >= _LARGEST


def show_number(value: float, decimals: int, sign: Literal["-", "+"] = "-") -> str:
    """Return a number with so many digits after the point, an infinite one as ``inf``."""
    if math.isinf(value):
        return "inf" if value > 0 else "-inf"
    return f"{value:{sign}z.{decimals}{'e' if is_wide(value) else 'f'}}"


@dataclass(frozen=True)
class Between:
    """An interval, shown as ``[a, b]``."""

    low: float
    high: float

    def text(self, decimals: int) -> str:
        """Return what is shown after the value."""
        return f"[{show_number(self.low, decimals)}, {show_number(self.high, decimals)}]"


@dataclass(frozen=True)
class PlusMinus:
    """Half the width of a symmetrical interval, or a standard error, shown as ``± h``."""

    half: float

    def text(self, decimals: int) -> str:
        """Return what is shown after the value."""
        return f"± {show_number(self.half, decimals)}"


Uncertainty = Between | PlusMinus


@dataclass(frozen=True)
class Column:
    """A column's title and how its numbers are shown.

    Attributes
    ----------
    unit : str
        Shown after the title; empty for none.
    higher_is_better : bool or None
        None for what is not a score.
    decimals : int
        How many digits follow the point.
    group : str
        What stands above neighbouring columns of one group, such as a scene; empty for none.
    block : str
        Columns of different blocks, such as tracks, never stand side by side where a format
        breaks a table.
    """

    title: str
    unit: str = ""
    higher_is_better: bool | None = None
    decimals: int = 2
    group: str = ""
    block: str = ""

    @property
    def title_suffix(self) -> str:
        """What follows the title: unit and direction; the unit of grouped columns is a note's."""
        unit = f" [{self.unit}]" if self.unit and not self.group else ""
        arrow = {None: "", True: " ↑", False: " ↓"}[self.higher_is_better]
        return f"{unit}{arrow}"

    @property
    def heading(self) -> str:
        """Title, unit and direction, such as ``R@1 [%] ↑``."""
        return f"{self.title}{self.title_suffix}"


@dataclass(frozen=True)
class Cell:
    """A value, its rank in the column, and what follows it.

    Attributes
    ----------
    best, second : bool
        Whether it is the best or the second best of its column.
    gain : float, optional
        The difference from the baseline's printed value.
    uncertainty : Between or PlusMinus, optional
        In the unit of the value.
    mark : str
        Stands behind the value; a note says what it means.
    cite : str
        Keys of a bibliography, for LaTeX.
    least : float
        A number below it is shown as less than it: a p-value is never 0.0000.
    """

    value: float | int | str | None
    best: bool = False
    second: bool = False
    gain: float | None = None
    uncertainty: Uncertainty | None = None
    mark: str = ""
    cite: str = ""
    least: float = 0.0

    @property
    def is_too_small(self) -> bool:
        """Whether it is a number that is shown as less than another."""
        return isinstance(self.value, float) and 0 <= self.value < self.least

    def text(self, decimals: int) -> str:
        """Return the value as it is shown; a missing one is a dash, an infinite one says so."""
        if self.value is None:
            return "–"
        if isinstance(self.value, str | int):
            return plain(str(self.value))
        if self.is_too_small:
            return f"<{show_number(self.least, decimals)}"
        return show_number(self.value, decimals)

    def suffix(self, decimals: int) -> list[str]:
        """Return what follows the value: mark, uncertainty, then gain."""
        parts = [self.mark] * bool(self.mark)
        parts += [] if self.uncertainty is None else [self.uncertainty.text(decimals)]
        return (
            parts if self.gain is None else [*parts, f"({show_number(self.gain, decimals, '+')})"]
        )


@dataclass(frozen=True)
class Row:
    """A row's cells.

    Attributes
    ----------
    summary : bool
        Set apart from the rows above it.
    highlighted : bool
        On a coloured ground where the format has one.
    reported : str
        Where the numbers were printed, if they were not scored here; such a row is marked with a
        dagger, and the table says what that means.
    floor : bool
        What scores without a method, such as chance: set apart, and never the best.
    """

    cells: tuple[Cell, ...]
    summary: bool = False
    highlighted: bool = False
    reported: str = ""
    floor: bool = False

    @property
    def is_own(self) -> bool:
        """Whether it is of a method that was scored here."""
        return not (self.reported or self.floor)

    def is_apart(self, above: Row | None) -> bool:
        """Whether a rule stands between it and the row above."""
        kind = (self.summary, self.floor)
        return any(kind) and (above is None or kind != (above.summary, above.floor))


@dataclass(frozen=True)
class Table:
    """A title, columns, rows, and notes that belong to the numbers.

    Attributes
    ----------
    groups_per_block : int
        How many groups of columns stand side by side where a format breaks a wide table.
    fixed : bool
        Whether so many do whatever their width, and no more on a terminal and in HTML either.
    legend : tuple of str
        Those of the notes without which the numbers mislead: LaTeX prints them under the table,
        and the others as comments.
    leading : int, optional
        How many columns say what a row is, which every block repeats; where it is not given, all
        before the first score.
    """

    title: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...] = ()
    groups_per_block: int = 2
    leading: int | None = None
    fixed: bool = False
    legend: tuple[str, ...] = ()

    def texts(self) -> list[list[str]]:
        """Return every cell as it is shown, with what follows its value."""
        return [
            [
                " ".join([cell.text(column.decimals), *cell.suffix(column.decimals)])
                + (f" {_DAGGER}" if row.reported and not index else "")
                for index, (cell, column) in enumerate(zip(row.cells, self.columns, strict=True))
            ]
            for row in self.rows
        ]

    @property
    def dagger_note(self) -> tuple[str, ...]:
        """What the dagger of reported rows means, where there are any."""
        parts = [part for row in self.rows for part in row.reported.split("; ") if part]
        sources = "; ".join(dict.fromkeys(parts))
        return (f"{_DAGGER} {REPORTED}: {sources}",) if sources else ()

    @property
    def all_notes(self) -> tuple[str, ...]:
        """The notes, after what the dagger of reported rows means."""
        return (*self.dagger_note, *self.notes)

    def is_text(self, column: int) -> bool:
        """Whether a column holds words, which stand at its left, and not numbers."""
        return column == 0 or any(isinstance(row.cells[column].value, str) for row in self.rows)


def plain(text: str) -> str:
    """Put a text on one line and replace what does not print."""
    printed = (
        c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in " ".join(text.split())
    )
    return "".join(printed)
