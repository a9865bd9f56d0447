"""The one model of tables, which keeps values apart from how they are shown."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Literal

_DAGGER, _REPORTED = "†", "reported, not re-scored"
_LARGEST = 1e9  # shown with all its digits
_WIDEST = 10  # columns of scores side by side on a page


def show_number(value: float, decimals: int, sign: Literal["-", "+"] = "-") -> str:
    """Return a number with `decimals` digits after the point, an infinite one as ``inf``."""
    # Powers of ten keep the width of a large number bounded.
    kind = "e" if _LARGEST <= abs(value) < math.inf else "f"
    return f"{value:{sign}z.{decimals}{kind}}"


def plain(text: str) -> str:
    """Put a text on one line and replace what does not print."""
    line = " ".join(text.split())
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in line)


@dataclass(frozen=True)
class Column:
    """A column's title and how its numbers are shown.

    `higher_is_better` is None for what is not a score. `group` stands above neighbouring columns,
    such as a scene.
    """

    title: str
    unit: str = ""
    higher_is_better: bool | None = None
    decimals: int = 2
    group: str = ""

    @property
    def heading(self) -> str:
        """Title, unit and direction, such as ``R@1 [%] ↑``; a note has units of grouped columns."""
        unit = f" [{self.unit}]" if self.unit and not self.group else ""
        return self.title + unit + {None: "", True: " ↑", False: " ↓"}[self.higher_is_better]


@dataclass(frozen=True)
class Cell:
    """A value, whether it is the best of its column, and what follows it.

    `gain` is the difference from the baseline's printed value, `uncertainty` an interval; a note
    says what `mark` means. A number below `least` is shown as less than it, since a p-value is
    never 0.0000; one that says nothing is `hidden` outside JSON.
    """

    value: float | int | str | None
    best: bool = False
    gain: float | None = None
    uncertainty: tuple[float, float] | None = None
    mark: str = ""
    least: float = 0.0
    hidden: bool = False

    def text(self, decimals: int) -> str:
        """Return the value as it is shown; a missing one is a dash, an infinite one says so."""
        if self.value is None or self.hidden:
            return "–"
        if isinstance(self.value, str | int):
            return plain(str(self.value))
        if 0 <= self.value < self.least:
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
    if they were not scored here. A `floor` is what scores without a method, such as chance: set
    apart, and never the best. `cite` are keys of a bibliography, for LaTeX.
    """

    cells: tuple[Cell, ...]
    summary: bool = False
    highlighted: bool = False
    reported: str = ""
    floor: bool = False
    cite: str = ""

    @property
    def is_own(self) -> bool:
        """Whether its method was scored here."""
        return not (self.reported or self.floor)

    @property
    def standing(self) -> str:
        """The mark of reported rows and floors; empty for methods scored here."""
        reported = f"{_REPORTED}: {self.reported}" if self.reported else ""
        return "what scores without a method" if self.floor else reported

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

    The `leading` columns, by default all before the first score, say what a row is. LaTeX has the
    `narrow` table instead, which fits a column of a paper, where there is one.
    """

    title: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...] = ()
    leading: int | None = None
    narrow: Table | None = None

    @property
    def all_notes(self) -> tuple[str, ...]:
        """The notes, after what the dagger of reported rows means, where there are any."""
        parts = [part for row in self.rows for part in row.reported.split("; ") if part]
        sources = "; ".join(dict.fromkeys(parts))
        return (*([f"{_DAGGER} {_REPORTED}: {sources}"] if sources else []), *self.notes)

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
        values = (row.cells[column].value for row in self.rows)
        return column == 0 or any(isinstance(value, str) and value for value in values)

    def cell_texts(self, row: Row) -> list[tuple[Cell, str, str]]:
        """Return the cells of a row, each with its value and what follows it as texts."""
        found = []
        for index, (cell, column) in enumerate(zip(row.cells, self.columns, strict=True)):
            dagger = [_DAGGER] if row.reported and not index else []
            suffix = " ".join([*cell.suffix(column.decimals), *dagger])
            found.append((cell, cell.text(column.decimals), suffix))
        return found

    def texts(self) -> list[list[str]]:
        """Return the text of every cell, with its mark, interval and gain."""
        return [
            [f"{v} {more}".rstrip() for _, v, more in self.cell_texts(row)] for row in self.rows
        ]

    def units(self) -> list[list[int]]:
        """Return the columns that stay together: neighbours of one group, else each by itself."""
        rest = range(self.leading_columns, len(self.columns))
        return [
            unit
            for group, indices in groupby(rest, key=lambda index: self.columns[index].group)
            for unit in ([list(indices)] if group else [[index] for index in indices])
        ]

    def take(self, chosen: Sequence[int]) -> Table:
        """Return the table of the leading columns and some others.

        Methods that have nothing in groups of columns are left out of them.
        """
        leading = self.leading_columns
        kept = [*range(leading), *chosen]
        rows = (
            replace(row, cells=tuple(row.cells[i] for i in kept))
            for row in self.rows
            if not self.has_groups or any(row.cells[i].value is not None for i in chosen)
        )
        columns = tuple(self.columns[i] for i in kept)
        return replace(self, columns=columns, rows=tuple(rows), leading=leading)

    def pieces(self) -> list[Table]:
        """Split a table with groups of columns into what fits a page."""
        if not self.has_groups:
            return [self]
        parts: list[list[int]] = []
        for unit in self.units():
            if parts and len(parts[-1]) + len(unit) <= _WIDEST:
                parts[-1] += unit
            else:
                parts.append(unit)
        return [self.take(part) for part in parts]
