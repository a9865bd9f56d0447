"""Renderers of the table model: terminal, CSV, Markdown, HTML, JSON; LaTeX has its own file."""

from __future__ import annotations

import csv
import html
import io
import json
import math
import re
import textwrap
from collections.abc import Callable, Iterator, Sequence
from typing import Literal

from rich import box
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table as Grid
from rich.text import Text

from airzoo_bench.tables.latex import latex
from airzoo_bench.tables.model import Cell, Column, Row, Table, plain, show_number

# Scores have titles such as "@5m,10°": there is no operator in it and no function, thus no formula.
_HARMLESS = re.compile(r"-?[0-9]+(\.[0-9]+)?(e\+[0-9]+)?|-inf|@[0-9][\w.,° ±]*")
_ENDLESS, _NARROWEST = 100_000, 40  # columns of a terminal


def render(table: Table, form: str, *, width: int = 80, styled: bool = False) -> str:
    """Render a table as text that ends with a newline."""
    return _terminal(table, width, styled) if form == "terminal" else _RENDERERS[form](table)


# --- terminal: wide tables in pieces, never with numbers cut off or wrapped ---


def _terminal(table: Table, width: int, styled: bool) -> str:
    """Lay out a table as text, with bold values and wrapped notes where it is `styled`."""
    out = io.StringIO()
    colours: Literal["256"] | None = "256" if styled else None
    console = Console(
        file=out, width=_ENDLESS, force_terminal=styled, color_system=colours, _environ={}
    )
    room = max(width, _NARROWEST) if styled else _ENDLESS
    wrapper = textwrap.TextWrapper(room, break_long_words=False, break_on_hyphens=False)
    wrapper.subsequent_indent = "  "
    out.write(wrapper.fill(plain(table.title)) + "\n")
    for piece in _by_width(table, width, console):
        console.print(_grid(piece))
    wrapper.initial_indent, wrapper.subsequent_indent = "  ", "    "
    out.writelines(wrapper.fill(plain(note)) + "\n" for note in table.all_notes)
    return out.getvalue()


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
    for above, row in zip((None, *table.rows), table.rows, strict=False):
        if above and row.is_apart(above):
            grid.add_section()
        cells = []
        for cell, value, suffix in table.cell_texts(row):
            more = (f" {suffix}" if suffix else "", "bright_black")
            cells.append(Text.assemble((value, "bold" if cell.best else ""), more))
        floor = "italic bright_black" if row.floor else ""
        grid.add_row(*cells, style="on grey23" if row.highlighted else floor)
    return grid


# --- CSV ---


def _csv(table: Table) -> str:
    """Write a value a field: limits and gains have columns of their own."""
    fields = [
        field
        for index, column in enumerate(table.columns)
        for field in _csv_fields(column, [row.cells[index] for row in table.rows])
    ]
    if not all(row.is_own for row in table.rows):
        fields.append(["Marked", *(plain(row.standing) for row in table.rows)])
    out = io.StringIO()
    lines = zip(*fields, strict=True)
    csv.writer(out, lineterminator="\n").writerows([map(_without_formula, line) for line in lines])
    return out.getvalue()


def _csv_fields(column: Column, cells: Sequence[Cell]) -> Iterator[list[str]]:
    """Yield the fields of a column, each from its title down: values, limits, gains."""
    title, digits = plain(f"{column.group} {column.title}"), column.decimals
    yield [title, *(cell.text(digits) for cell in cells)]
    low, high = ([cell.uncertainty and cell.uncertainty[i] for cell in cells] for i in (0, 1))
    beside = {"from": low, "to": high, "gain": [cell.gain for cell in cells]}
    for kind, numbers in beside.items():
        if any(number is not None for number in numbers):
            texts = ("" if n is None else show_number(n, digits) for n in numbers)
            yield [f"{title} {kind}", *texts]


def _without_formula(text: str) -> str:
    # A spreadsheet would run a method's name that begins like a formula.
    is_formula = text[:1] in ("=", "+", "-", "@") and not _HARMLESS.fullmatch(text)
    return "'" + text if is_formula else text


# --- Markdown and HTML, with one line of titles: each says its group ---


def _markdown(table: Table) -> str:
    rule = ["---" if table.is_text(i) else "---:" for i in range(len(table.columns))]
    lines = [[_escape_markdown(f"{c.group} {c.heading}") for c in table.columns], rule]
    for row in table.rows:
        line = []
        for cell, value, suffix in table.cell_texts(row):
            text, mark = _escape_markdown(value), "**" * cell.best or "*" * row.floor
            line.append(f"{mark}{text}{mark} {_escape_markdown(suffix)}".rstrip())
        lines.append(line)
    notes = (f"\n{_escape_markdown(note)}\n" for note in table.all_notes)
    return "".join(["| " + " | ".join(line) + " |\n" for line in lines] + [*notes])


def _escape_markdown(text: str) -> str:
    escaped = "".join("\\" + c if c in r"\`*_[]|#!~$" else c for c in plain(text))
    return html.escape(escaped, quote=False)


def _html(table: Table) -> str:
    # Attributes, since pages and sites that take in a table may allow no styles.
    sides = ["left" if table.is_text(i) else "right" for i in range(len(table.columns))]
    heads = "".join(
        f'<th scope="col" align="{side}">{_escape(f"{column.group} {column.heading}")}</th>'
        for column, side in zip(table.columns, sides, strict=True)
    )
    body = "".join(_html_row(table, row, sides) for row in table.rows)
    notes = "".join(f"<p>{_escape(note)}</p>" for note in table.all_notes)
    return (
        f"<table>\n<caption>{_escape(table.title)}</caption>\n<thead><tr>{heads}</tr></thead>\n"
        f"<tbody>\n{body}</tbody>\n</table>\n{notes}\n"
    )


def _escape(text: str) -> str:
    return html.escape(plain(text))


def _html_row(table: Table, row: Row, sides: list[str]) -> str:
    texts = ""
    for (cell, text, suffix), side in zip(table.cell_texts(row), sides, strict=True):
        value = html.escape(text)
        for tag in ["strong"] * cell.best + ["em"] * (not row.is_own):
            value = f"<{tag}>{value}</{tag}>"
        small = f" <small>{html.escape(suffix)}</small>" if suffix else ""
        texts += f'<td align="{side}">{value}{small}</td>'
    ground = ' bgcolor="#fff3bf"' * row.highlighted
    return f"<tr{ground}>{texts}</tr>\n"


# --- JSON ---


def _json(table: Table) -> str:
    """Write values in the shape of the rows; limits and gains in the same shape."""

    def rows(shown: Callable[[Cell], object]) -> list[list[object]]:
        return [[shown(cell) for cell in row.cells] for row in table.rows]

    def limits(cell: Cell) -> object:
        low, high = map(_number, cell.uncertainty or (None, None))
        return cell.uncertainty and {"low": low, "high": high}

    columns = [
        {"title": c.title, "unit": c.unit, "higher_is_better": c.higher_is_better}
        | ({"group": c.group} if c.group else {})
        for c in table.columns
    ]
    content: dict[str, object] = {"title": table.title, "columns": columns}
    content |= {"rows": rows(lambda c: _number(c.value)), "notes": list(table.all_notes)}
    cells = [cell for row in table.rows for cell in row.cells]
    if any(cell.gain is not None for cell in cells):
        content["gains"] = rows(lambda cell: cell.gain)
    if any(cell.uncertainty for cell in cells):
        content["uncertainties"] = rows(limits)
    if not all(row.is_own for row in table.rows):
        content["marked"] = [row.standing for row in table.rows]
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def _number(value: float | int | str | None) -> object:
    if isinstance(value, float) and math.isinf(value):
        return "Infinity" if value > 0 else "-Infinity"
    return value


_RENDERERS: dict[str, Callable[[Table], str]] = {
    "latex": latex,
    "csv": _csv,
    "markdown": _markdown,
    "html": _html,
    "json": _json,
}

FORMATS = ("terminal", *_RENDERERS)
"""The formats that tables can be rendered in."""
