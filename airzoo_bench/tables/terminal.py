"""Tables for a terminal: wide ones in pieces, never with numbers cut off or wrapped."""

from __future__ import annotations

import io
import textwrap
from typing import Any

from rich import box
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table as Grid
from rich.text import Text

from airzoo_bench.tables.model import Table, plain

_ENDLESS = 100_000
_NARROWEST = 40


def terminal(table: Table, *, width: int = 80, styled: bool = False) -> str:
    """Lay out a table as text, with bold values and wrapped notes where it is `styled`."""
    out = io.StringIO()
    console = Console(
        file=out,
        width=_ENDLESS,
        force_terminal=styled,
        color_system="256" if styled else None,
        _environ={},
    )
    room = max(width, _NARROWEST) if styled else _ENDLESS
    _write(out, table.title, room, "")
    for piece in _by_width(table, width, console):
        console.print(_grid(piece))
    for note in table.all_notes:
        _write(out, note, room, "  ")
    return out.getvalue()


def _write(out: io.StringIO, text: str, room: int, indent: str) -> None:
    how: dict[str, Any] = {"initial_indent": indent, "subsequent_indent": f"  {indent}"}
    lines = textwrap.wrap(plain(text), room, **how, break_long_words=False, break_on_hyphens=False)
    out.writelines(f"{line}\n" for line in lines)


def _by_width(table: Table, room: int, console: Console) -> list[Table]:
    """Split a table into pieces that fit a width, wherever a single score does."""

    def measure(chosen: list[int]) -> int:
        return Measurement.get(console, console.options, _grid(table.take(chosen))).maximum

    def filled(chosen: list[int]) -> set[int]:
        return {n for n, r in enumerate(table.rows) for i in chosen if r.cells[i].value is not None}

    # A very long name must not put every score into a piece of its own.
    room = max(room, measure([]) + room // 2)
    parts: list[list[int]] = []
    for whole in table.units():
        for unit in [whole] if measure(whole) <= room else [[index] for index in whole]:
            near = parts and not filled(parts[-1]).isdisjoint(filled(unit))  # not another track
            if near and measure(parts[-1] + unit) <= room:
                parts[-1] += unit
            else:
                parts.append(unit)
    return [table.take(part) for part in parts] or [table]


def _grid(table: Table) -> Grid:
    grid = Grid(box=box.SIMPLE, header_style="bold", pad_edge=True)
    group = ""
    for index, column in enumerate(table.columns):
        title = plain(column.heading)
        if table.has_groups:  # above the first of its columns
            title = f"{plain(column.group) if column.group != group else ''}\n{title}"
            group = column.group
        is_left = table.is_text(index) and not column.group
        grid.add_column(Text(title), justify="left" if is_left else "right", no_wrap=True)
    for above, row, texts in zip((None, *table.rows), table.rows, table.texts(), strict=False):
        if above and row.is_apart(above):
            grid.add_section()
        cells = []
        for cell, column, text in zip(row.cells, table.columns, texts, strict=True):
            value = cell.text(column.decimals)
            mark = "bold" if cell.best else "underline" if cell.second else ""
            suffix = (text.removeprefix(value), "bright_black")
            cells.append(Text.assemble((value, mark), suffix))
        floor = "italic bright_black" if row.floor else ""
        grid.add_row(*cells, style="on grey23" if row.highlighted else floor)
    return grid
