"""Tables for a terminal: wide ones in blocks, never with numbers cut off or wrapped."""

from __future__ import annotations

import io
import textwrap
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from rich.cells import cell_len

from airzoo_bench.tables.blocks import as_asked, by_width, leading_columns, units
from airzoo_bench.tables.model import Cell, Table, plain

if TYPE_CHECKING:
    from rich.table import Table as RichTable
    from rich.text import Text

__all__ = ["TERMINAL_WIDTH", "terminal"]

TERMINAL_WIDTH = 80
"""Where nothing is known of the terminal, or there is none."""

_EDGE = 2  # blanks at either end of a line
_PADDING = 3  # between columns
_FLOOR = "italic bright_black"
_WITHIN = 2  # between columns of a group


def terminal(table: Table, *, width: int = TERMINAL_WIDTH, styled: bool = False) -> str:
    """Lay out a table as text."""
    from rich.console import Console

    room = width - 2 * _EDGE
    shown = _text(plain(table.title), width, styled) if table.title else ""
    pieces = [
        piece
        for asked in as_asked(table)
        for piece in by_width(asked, _Layout(asked).width_of, room, _PADDING)
    ]
    for piece in pieces:
        out = io.StringIO()
        part = _Layout(piece)
        console = Console(
            file=out, width=max(40, part.needed), force_terminal=styled, highlight=False
        )
        console.print(part.drawn())
        shown += out.getvalue()
    notes = [_text(plain(note), width, styled, indent=_EDGE) for note in table.all_notes]
    return shown + "".join(notes)


def _text(text: str, width: int, wrapped: bool, *, indent: int = 0) -> str:
    first = " " * indent
    if not wrapped:
        return f"{first}{text}\n"
    lines = textwrap.wrap(
        text,
        max(width, 40),
        initial_indent=first,
        subsequent_indent=first + " " * _EDGE,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return "".join(f"{line}\n" for line in lines)


@dataclass(frozen=True)
class _Layout:
    """A table's columns as they are drawn: a group is one column with parts."""

    table: Table

    @cached_property
    def columns(self) -> list[list[int]]:
        leading = [[index] for index in range(leading_columns(self.table))]
        return [*leading, *units(self.table)]

    @cached_property
    def texts(self) -> list[list[str]]:
        return self.table.texts()

    @cached_property
    def widths(self) -> list[int]:
        return [self.width_of(indices) for indices in self.columns]

    def width_of(self, indices: list[int]) -> int:
        """Measure columns that stand together under one title."""
        parts = [self._part_widths[index] for index in indices]
        group = cell_len(plain(self.table.columns[indices[0]].group))
        return max(sum(parts) + _WITHIN * (len(parts) - 1), group)

    @property
    def needed(self) -> int:
        return sum(self.widths) + _PADDING * (len(self.widths) - 1) + 2 * _EDGE

    def drawn(self) -> RichTable:
        """Return the table for a console."""
        from rich import box
        from rich.table import Table as RichTable

        shown = RichTable(box=box.SIMPLE_HEAD)
        for indices in self.columns:
            left = self._is_grouped(indices) or self.table.is_text(indices[0])
            shown.add_column(
                self._titles(indices),
                justify="left" if left else "right",
                no_wrap=True,
                vertical="bottom",
            )
        for number, row in enumerate(self.table.rows):
            if row.is_apart(self.table.rows[number - 1] if number else None):
                shown.add_section()
            style = "on grey23" if row.highlighted else _FLOOR if row.floor else None
            shown.add_row(*(self._body(indices, number) for indices in self.columns), style=style)
        return shown

    def _titles(self, indices: list[int]) -> Text:
        from rich.text import Text

        titles = [plain(self.table.columns[index].heading) for index in indices]
        if not self._is_grouped(indices):
            return Text(titles[0])
        width = self.width_of(indices)
        group = plain(self.table.columns[indices[0]].group)
        above = _to_width(group, width - (width - cell_len(group)) // 2)
        below = (" " * _WITHIN).join(map(_to_width, titles, self._within(indices)))
        return Text(f"{above}\n{_to_width(below, width)}")

    def _body(self, indices: list[int], number: int) -> Text:
        from rich.text import Text

        line = Text()
        widths = self._within(indices) if self._is_grouped(indices) else [0]
        for place, (index, width) in enumerate(zip(indices, widths, strict=True)):
            cell, text = self.table.rows[number].cells[index], self.texts[number][index]
            value = cell.text(self.table.columns[index].decimals)
            line.append(" " * (width - cell_len(text) + _WITHIN * bool(place)))
            line.append(value, style=_style(cell))
            line.append(text.removeprefix(value), style="bright_black")
        if self._is_grouped(indices):
            line.pad_left(self.width_of(indices) - line.cell_len)
        return line

    def _within(self, indices: list[int]) -> list[int]:
        return [self._part_widths[index] for index in indices]

    @cached_property
    def _part_widths(self) -> list[int]:
        titles = [plain(column.heading) for column in self.table.columns]
        return [max(map(cell_len, column)) for column in zip(titles, *self.texts, strict=True)]

    def _is_grouped(self, indices: list[int]) -> bool:
        return bool(self.table.columns[indices[0]].group)


def _to_width(text: str, width: int) -> str:
    return " " * (width - cell_len(text)) + text


def _style(cell: Cell) -> str:
    return "bold" if cell.best else "underline" if cell.second else ""
