"""Tables for a terminal: wide ones in pieces, never with numbers cut off or wrapped."""

from __future__ import annotations

import io
import textwrap
from functools import cached_property

from rich import box
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from airzoo_bench.tables.model import Table, as_asked, by_width, plain

__all__ = ["TERMINAL_WIDTH", "terminal"]

TERMINAL_WIDTH = 80
"""Where nothing is known of the terminal, or there is none."""

_EDGE = 2  # blanks at either end of a line
_PADDING = 3  # between columns
_WITHIN = 2  # between columns of a group
_NARROWEST = 40


def terminal(table: Table, *, width: int = TERMINAL_WIDTH, styled: bool = False) -> str:
    """Lay out a table as text."""
    shown = [_line(table.title, width, styled)] if table.title else []
    for asked in as_asked(table):
        for piece in by_width(asked, _Layout(asked).width_of, width - 2 * _EDGE, _PADDING):
            out, layout = io.StringIO(), _Layout(piece)
            room = max(_NARROWEST, layout.width)
            console = Console(file=out, width=room, force_terminal=styled, highlight=False)
            console.print(layout.drawn())
            shown.append(out.getvalue())
    return "".join(shown) + "".join(_line(note, width, styled, _EDGE) for note in table.all_notes)


def _line(text: str, width: int, wrapped: bool, indent: int = 0) -> str:
    if not wrapped:
        return f"{' ' * indent}{plain(text)}\n"
    lines = textwrap.wrap(
        plain(text),
        max(width, _NARROWEST),
        initial_indent=" " * indent,
        subsequent_indent=" " * (indent + _EDGE),
        break_long_words=False,
        break_on_hyphens=False,
    )
    return "".join(f"{line}\n" for line in lines)


class _Layout:
    """A table's columns as they are drawn: a group is one column with parts."""

    def __init__(self, table: Table) -> None:
        self.table = table
        self.columns = [*([index] for index in range(table.leading_columns)), *table.units()]
        self.texts = table.texts()
        self.titles = [plain(column.heading) for column in table.columns]

    @cached_property
    def widths(self) -> list[int]:
        return [max(map(cell_len, texts)) for texts in zip(self.titles, *self.texts, strict=True)]

    def width_of(self, indices: list[int]) -> int:
        """Measure columns that stand together under one title."""
        parts = [self.widths[index] for index in indices]
        return max(sum(parts) + _WITHIN * (len(parts) - 1), cell_len(self._group(indices)))

    @property
    def width(self) -> int:
        widths = [self.width_of(indices) for indices in self.columns]
        return sum(widths) + _PADDING * (len(widths) - 1) + 2 * _EDGE

    def _group(self, indices: list[int]) -> str:
        return plain(self.table.columns[indices[0]].group)

    def drawn(self) -> RichTable:
        """Return the table for a console."""
        shown = RichTable(box=box.SIMPLE_HEAD)
        for indices in self.columns:
            left = self._group(indices) or self.table.is_text(indices[0])
            side = "left" if left else "right"
            title = self._title(indices)
            shown.add_column(title, justify=side, no_wrap=True, vertical="bottom")  # type: ignore[arg-type]
        for number, row in enumerate(self.table.rows):
            if row.is_apart(self.table.rows[number - 1] if number else None):
                shown.add_section()
            floor = "italic bright_black" if row.floor else None
            style = "on grey23" if row.highlighted else floor
            shown.add_row(*(self._body(indices, number) for indices in self.columns), style=style)
        return shown

    def _title(self, indices: list[int]) -> Text:
        group, titles = self._group(indices), [self.titles[index] for index in indices]
        if not group:
            return Text(titles[0])
        width = self.width_of(indices)
        above = _to_width(group, width - (width - cell_len(group)) // 2)
        within = (self.widths[index] for index in indices)
        below = (" " * _WITHIN).join(map(_to_width, titles, within))
        return Text(f"{above}\n{_to_width(below, width)}")

    def _body(self, indices: list[int], number: int) -> Text:
        line, grouped = Text(), bool(self._group(indices))
        for place, index in enumerate(indices):
            cell, text = self.table.rows[number].cells[index], self.texts[number][index]
            value = cell.text(self.table.columns[index].decimals)
            width = self.widths[index] if grouped else 0
            line.append(" " * (width - cell_len(text) + _WITHIN * bool(place)))
            line.append(value, style="bold" if cell.best else "underline" if cell.second else "")
            line.append(text.removeprefix(value), style="bright_black")
        if grouped:
            line.pad_left(self.width_of(indices) - line.cell_len)
        return line


def _to_width(text: str, width: int) -> str:
    return " " * (width - cell_len(text)) + text
