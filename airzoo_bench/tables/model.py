"""The one table model: values apart from how they are shown, and wide tables in pieces."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Literal, NamedTuple

REPORTED = "reported, not re-scored"
"""The mark of rows with numbers that somebody else has printed."""

FLOOR = "what scores without a method"
"""The mark of rows without a method."""

_DAGGER = "†"
_LARGEST = 1e9  # shown with all its digits
_WIDEST = 12  # columns of scores
_PAPERS = 2  # groups abreast that a paper shrinks to its page
_PAGE = 50.0  # width of a page of two columns, in em
_LETTER, _GAP = 0.5, 1.2  # of a table on it


def share_to_percent(value: float) -> float:
    """Turn a share into percent."""
    return 100.0 * value


def show_number(value: float, decimals: int, sign: Literal["-", "+"] = "-") -> str:
    """Return a number with `decimals` digits after the point, an infinite one as ``inf``."""
    if math.isinf(value):
        return "inf" if value > 0 else "-inf"
    # Powers of ten keep the width of a large number bounded.
    return f"{value:{sign}z.{decimals}{'e' if abs(value) >= _LARGEST else 'f'}}"


def plain(text: str) -> str:
    """Put a text on one line and replace what does not print."""
    line = " ".join(text.split())
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in line)


class Between(NamedTuple):
    """An interval, shown as ``[a, b]``."""

    low: float
    high: float


@dataclass(frozen=True)
class Column:
    """A column's title and how its numbers are shown.

    `higher_is_better` is None for what is not a score. `group` stands above neighbouring columns,
    such as a scene. Columns of different blocks, such as tracks, never stand side by side where a
    format breaks a table.
    """

    title: str
    unit: str = ""
    higher_is_better: bool | None = None
    decimals: int = 2
    group: str = ""
    block: str = ""

    @property
    def title_suffix(self) -> str:
        """The unit and direction behind the title; a note has the unit of grouped columns."""
        unit = f" [{self.unit}]" if self.unit and not self.group else ""
        return unit + {None: "", True: " ↑", False: " ↓"}[self.higher_is_better]

    @property
    def heading(self) -> str:
        """Title, unit and direction, such as ``R@1 [%] ↑``."""
        return f"{self.title}{self.title_suffix}"


@dataclass(frozen=True)
class Cell:
    """A value, its rank in the column, and what follows it.

    `gain` is the difference from the baseline's printed value; a note says what `mark` means;
    `cite` are keys of a bibliography, for LaTeX. A number below `least` is shown as less than it: a
    p-value is never 0.0000.
    """

    value: float | int | str | None
    best: bool = False
    second: bool = False
    gain: float | None = None
    uncertainty: Between | None = None
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
        parts = [self.mark] if self.mark else []
        if self.uncertainty is not None:
            limits = ", ".join(show_number(limit, decimals) for limit in self.uncertainty)
            parts.append(f"[{limits}]")
        if self.gain is not None:
            parts.append(f"({show_number(self.gain, decimals, '+')})")
        return parts


@dataclass(frozen=True)
class Row:
    """A row's cells.

    A `summary` is set apart from the rows above it. `reported` says where the numbers were printed,
    if they were not scored here; such a row is marked with a dagger. A `floor` is what scores
    without a method, such as chance: set apart, and never the best.
    """

    cells: tuple[Cell, ...]
    summary: bool = False
    highlighted: bool = False
    reported: str = ""
    floor: bool = False

    @property
    def is_own(self) -> bool:
        """Whether its method was scored here."""
        return not (self.reported or self.floor)

    @property
    def standing(self) -> str:
        """The mark of reported rows and floors; empty for methods scored here."""
        return FLOOR if self.floor else f"{REPORTED}: {self.reported}" if self.reported else ""

    @property
    def name(self) -> str:
        """The text of the first column."""
        return str(self.cells[0].value)

    def is_apart(self, above: Row | None) -> bool:
        """Whether there is a rule between it and the row above."""
        kind = (self.summary, self.floor)
        return any(kind) and (above is None or kind != (above.summary, above.floor))


@dataclass(frozen=True)
class Table:
    """A title, columns, rows, and notes that belong to the numbers.

    A format that breaks a wide table puts `groups_per_block` groups of columns side by side, fewer
    where they are too wide, or all where it is None. Every piece repeats the `leading` columns, by
    default all before the first score. LaTeX prints the notes in `legend` under the table, since
    numbers mislead without them, and the others as comments.
    """

    title: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...] = ()
    groups_per_block: int | None = 2
    leading: int | None = None
    legend: tuple[str, ...] = ()

    def texts(self) -> list[list[str]]:
        """Return the text of every cell, with its mark, interval and gain."""
        return [
            [
                " ".join([cell.text(column.decimals), *cell.suffix(column.decimals)])
                + (f" {_DAGGER}" if row.reported and not index else "")
                for index, (cell, column) in enumerate(zip(row.cells, self.columns, strict=True))
            ]
            for row in self.rows
        ]

    def text_widths(self) -> list[int]:
        """Return how many letters the widest text of each column has."""
        titles = [column.heading for column in self.columns]
        return [max(map(len, texts)) for texts in zip(titles, *self.texts(), strict=True)]

    @property
    def dagger_note(self) -> tuple[str, ...]:
        """The note that explains the dagger of reported rows, where there are any."""
        parts = [part for row in self.rows for part in row.reported.split("; ") if part]
        sources = "; ".join(dict.fromkeys(parts))
        return (f"{_DAGGER} {REPORTED}: {sources}",) if sources else ()

    @property
    def all_notes(self) -> tuple[str, ...]:
        """The notes, after what the dagger of reported rows means."""
        return (*self.dagger_note, *self.notes)

    @property
    def has_groups(self) -> bool:
        """Whether some columns have a title above theirs."""
        return any(column.group for column in self.columns)

    @property
    def leading_columns(self) -> int:
        """How many columns say what a row is."""
        if self.leading is not None:
            return self.leading
        scores = (i for i, column in enumerate(self.columns) if column.higher_is_better is not None)
        return next(scores, len(self.columns))

    def is_text(self, column: int) -> bool:
        """Whether a column holds words, aligned to the left, and not numbers."""
        return column == 0 or any(isinstance(row.cells[column].value, str) for row in self.rows)

    def units(self) -> list[list[int]]:
        """Return the columns that stay together: neighbours of one group, else each by itself."""
        rest = range(self.leading_columns, len(self.columns))
        return [
            unit
            for group, indices in groupby(rest, key=lambda index: self.columns[index].group)
            for unit in ([list(indices)] if group else [[index] for index in indices])
        ]


def take_columns(table: Table, pieces: Sequence[Sequence[list[int]]]) -> list[Table]:
    """Return a table of each piece's columns, the leading ones before them.

    Methods that have nothing in a piece of groups are left out of it.
    """
    if len(pieces) < 2:
        return [table]
    leading = table.leading_columns

    def is_filled(row: Row) -> bool:
        return any(cell.value is not None for cell in row.cells[leading:])

    made = []
    for piece in pieces:
        indices = [*range(leading), *(i for unit in piece for i in unit)]
        rows = [replace(row, cells=tuple(row.cells[i] for i in indices)) for row in table.rows]
        filled = [
            row
            for whole, row in zip(table.rows, rows, strict=True)
            if not table.has_groups or is_filled(row) or not is_filled(whole)
        ]
        columns = tuple(table.columns[i] for i in indices)
        made.append(replace(table, columns=columns, rows=tuple(filled or rows)))
    return made


def by_block(table: Table) -> list[Table]:
    """Split a table between columns of different blocks; leave any other whole."""
    runs = groupby(table.units(), key=lambda unit: table.columns[unit[0]].block)
    return take_columns(table, [list(members) for _, members in runs])


def by_count(table: Table) -> list[Table]:
    """Split a table with groups of columns into pieces that fit a page."""
    return [piece for part in by_block(table) for piece in _counted(part)]


def _counted(table: Table) -> list[Table]:
    units, most = table.units(), table.groups_per_block
    if not table.has_groups or most is None:
        return [table]
    step = max(1, min(most, _WIDEST // max(map(len, units))))
    while True:
        starts = range(0, len(units), step)
        pieces = take_columns(table, [units[at : at + step] for at in starts])
        widths = [sum(_LETTER * n + _GAP for n in piece.text_widths()) for piece in pieces]
        if step <= _PAPERS or max(widths) <= _PAGE:
            return pieces
        step -= 1
