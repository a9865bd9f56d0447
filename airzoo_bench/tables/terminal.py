"""Tables for a terminal: wide ones in pieces, never with numbers cut off or wrapped."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence

from rich.cells import cell_len

from airzoo_bench.tables.model import Table, by_block, plain, take_columns

TERMINAL_WIDTH = 80
"""Where nothing is known of the terminal, or there is none."""

_EDGE = 2  # blanks at either end of a line
_PADDING = 3  # between columns
_WITHIN = 2  # between columns of a group
_NARROWEST = 40
# Escape codes of a terminal.
_BOLD, _UNDERLINE, _GREY, _ITALIC_GREY, _ON_GREY = "1", "4", "90", "3;90", "48;5;237"


def terminal(table: Table, *, width: int = TERMINAL_WIDTH, styled: bool = False) -> str:
    """Lay out a table as text, with bold values and wrapped notes where it is `styled`."""
    lines = _wrapped(table.title, width if styled else None)
    for block in by_block(table):
        for piece in _by_width(block, width - 2 * _EDGE):
            lines += _Layout(piece, styled).lines()
    for note in table.all_notes:
        lines += _wrapped(note, width if styled else None, " " * _EDGE)
    return "".join(f"{line}\n" for line in lines)


def _wrapped(text: str, width: int | None, indent: str = "") -> list[str]:
    if width is None:
        return [indent + plain(text)] if text else []
    return textwrap.wrap(
        plain(text),
        max(width, _NARROWEST),
        initial_indent=indent,
        subsequent_indent=indent + " " * _EDGE,
        break_long_words=False,
        break_on_hyphens=False,
    )


def _by_width(table: Table, room: int) -> list[Table]:
    """Split a table into pieces that fit a width, wherever a single score does."""
    layout = _Layout(table)
    taken = sum(layout.width_of([i]) + _PADDING for i in range(table.leading_columns))
    # A very long name must not put every score into a piece of its own.
    left = max(room - taken, room // 2)

    def halves(unit: list[int]) -> list[list[int]]:
        if len(unit) == 1 or layout.width_of(unit) <= left:
            return [unit]
        middle = (len(unit) + 1) // 2
        return [*halves(unit[:middle]), *halves(unit[middle:])]

    pieces: list[list[list[int]]] = []
    used = 0
    for unit in [part for whole in table.units() for part in halves(whole)]:
        width = layout.width_of(unit)
        used += _PADDING + width
        if not pieces or used > left:
            pieces.append([])
            used = width
        pieces[-1].append(unit)
    return take_columns(table, pieces)


class _Layout:
    """A table's columns as they are drawn: columns of a group are closer, under its title."""

    def __init__(self, table: Table, styled: bool = False) -> None:
        self.table, self.styled = table, styled
        self.units = [*([index] for index in range(table.leading_columns)), *table.units()]
        self.texts = table.texts()
        self.titles = [plain(column.heading) for column in table.columns]
        columns = zip(self.titles, *self.texts, strict=True)
        self.widths = [max(map(cell_len, texts)) for texts in columns]

    def group_of(self, unit: Sequence[int]) -> str:
        return plain(self.table.columns[unit[0]].group)

    def width_of(self, unit: Sequence[int]) -> int:
        """Return the width of columns under one title."""
        width = sum(self.widths[i] for i in unit) + _WITHIN * (len(unit) - 1)
        return max(width, cell_len(self.group_of(unit)))

    def lines(self) -> Iterator[str]:
        """Draw titles, a rule and rows between two blank lines."""
        width = sum(self.width_of(unit) + _PADDING for unit in self.units) - _PADDING + 2 * _EDGE
        yield " " * width
        if self.table.has_groups:
            yield self._line([self._above(unit) for unit in self.units], _BOLD)
        yield self._line([self._within(unit, self.titles) for unit in self.units], _BOLD)
        yield f" {'─' * (width - 2)} "
        rows = self.table.rows
        for number, (row, texts) in enumerate(zip(rows, self.texts, strict=True)):
            if number and row.is_apart(rows[number - 1]):
                yield " " * width
            style = _ON_GREY if row.highlighted else _ITALIC_GREY if row.floor else ""
            yield self._line([self._within(unit, texts, number) for unit in self.units], style)
        yield " " * width

    def _line(self, parts: Sequence[str], style: str) -> str:
        edge = " " * _EDGE
        return self._painted(edge + (" " * _PADDING).join(parts) + edge, style)

    def _above(self, unit: Sequence[int]) -> str:
        group, width = self.group_of(unit), self.width_of(unit)
        left = (width - cell_len(group)) // 2 if group else width
        return " " * (width - cell_len(group) - left) + group + " " * left

    def _within(self, unit: Sequence[int], texts: Sequence[str], row: int | None = None) -> str:
        """Draw the texts of a unit to its width, numbers to the right."""
        parts = []
        for index in unit:
            pad = " " * (self.widths[index] - cell_len(texts[index]))
            is_left = not self.group_of(unit) and self.table.is_text(index)
            shown = texts[index] if row is None else self._value(row, index, texts[index])
            parts.append(shown + pad if is_left else pad + shown)
        used = sum(self.widths[i] for i in unit) + _WITHIN * (len(unit) - 1)
        return " " * (self.width_of(unit) - used) + (" " * _WITHIN).join(parts)

    def _value(self, row: int, index: int, text: str) -> str:
        cell = self.table.rows[row].cells[index]
        value = cell.text(self.table.columns[index].decimals)
        mark = _BOLD if cell.best else _UNDERLINE if cell.second else ""
        return self._painted(value, mark) + self._painted(text.removeprefix(value), _GREY)

    def _painted(self, text: str, style: str) -> str:
        if not (self.styled and style and text):
            return text
        end, begin = "\x1b[0m", f"\x1b[{style}m"
        return begin + text.replace(end, end + begin) + end  # what was painted inside ends itself
