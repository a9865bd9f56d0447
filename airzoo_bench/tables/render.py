"""Renderers of the table model: terminal, LaTeX, CSV, Markdown, HTML, JSON."""

from __future__ import annotations

import csv
import html
import io
import json
import math
import re
from collections.abc import Callable
from itertools import groupby

from airzoo_bench.tables.latex import latex
from airzoo_bench.tables.model import (
    FLOOR,
    REPORTED,
    Cell,
    Column,
    Row,
    Table,
    by_count,
    plain,
    show_number,
)
from airzoo_bench.tables.terminal import TERMINAL_WIDTH, terminal

__all__ = ["FORMATS", "render"]

# Scores are called such as "@5m,10°": there is no operator in it and no function, thus no formula.
_HARMLESS = re.compile(r"-?[0-9]+(\.[0-9]+)?(e\+[0-9]+)?|-inf|@[0-9][\w.,° ±]*")


def render(
    table: Table, form: str, *, width: int = TERMINAL_WIDTH, styled: bool = False, fit: bool = False
) -> str:
    """Render a table as text that ends with a newline."""
    if form == "terminal":
        return terminal(table, width=width, styled=styled)
    if form == "latex":
        return latex(table, fit=fit)
    return _RENDERERS[form](table)


def _standing(row: Row) -> str:
    """Return the mark of reported rows and floors; empty for methods scored here."""
    return FLOOR if row.floor else f"{REPORTED}: {row.reported}" if row.reported else ""


def _csv(table: Table) -> str:
    """Write a value a field: limits and gains have columns of their own."""
    cells = [cell for row in table.rows for cell in row.cells]
    count = len(table.columns)
    kinds = [
        [" from", " to"] * any(cell.uncertainty for cell in cells[place::count])
        + [" gain"] * any(cell.gain is not None for cell in cells[place::count])
        for place in range(count)
    ]
    marked = not all(row.is_own for row in table.rows)
    titles = [
        plain(f"{column.group} {column.title}{kind}")
        for column, suffixes in zip(table.columns, kinds, strict=True)
        for kind in ("", *suffixes)
    ]
    lines = [[*titles, *["Marked"] * marked]]
    for row in table.rows:
        given = zip(row.cells, table.columns, kinds, strict=True)
        texts = [text for one in given for text in _csv_cells(*one)]
        lines.append([*texts, *[plain(_standing(row))] * marked])
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([map(_defused, line) for line in lines])
    return out.getvalue()


def _csv_cells(cell: Cell, column: Column, kinds: list[str]) -> list[str]:
    span = cell.uncertainty
    numbers = {
        " from": span.low if span else None,
        " to": span.high if span else None,
        " gain": cell.gain,
    }
    further = [numbers[kind] for kind in kinds]
    texts = ["" if n is None else show_number(n, column.decimals) for n in further]
    return [repr(cell.value) if cell.is_too_small else cell.text(column.decimals), *texts]


def _defused(text: str) -> str:
    # A spreadsheet would run a method's name that begins like a formula.
    is_formula = text[:1] in ("=", "+", "-", "@") and not _HARMLESS.fullmatch(text)
    return "'" + text if is_formula else text


def _values_apart(table: Table) -> list[list[tuple[str, str]]]:
    """Return each cell's value and what follows it, as shown."""
    return [
        [
            (value, text.removeprefix(value))
            for cell, column, text in zip(row.cells, table.columns, texts, strict=True)
            for value in [cell.text(column.decimals)]
        ]
        for row, texts in zip(table.rows, table.texts(), strict=True)
    ]


def _markdown(table: Table) -> str:
    # Tables here have one line of titles: each says its group.
    blocks = "\n".join(map(_markdown_block, by_count(table)))
    return blocks + "".join(f"\n{_escape_markdown(plain(note))}\n" for note in table.all_notes)


def _markdown_block(table: Table) -> str:
    rule = ["---" if table.is_text(i) else "---:" for i in range(len(table.columns))]
    titles = [_escape_markdown(f"{plain(c.group)} {c.heading}") for c in table.columns]
    rows = [
        [_markdown_cell(cell, *text, row) for cell, text in zip(row.cells, texts, strict=True)]
        for row, texts in zip(table.rows, _values_apart(table), strict=True)
    ]
    return "".join("| " + " | ".join(line) + " |\n" for line in [titles, rule, *rows])


def _markdown_cell(cell: Cell, value: str, suffix: str, row: Row) -> str:
    value = _escape_markdown(value)
    shown = f"**{value}**" if cell.best else f"<u>{value}</u>" if cell.second else value
    shown = f"*{value}*" if row.floor else shown
    return f"{shown} {_escape_markdown(suffix)}".rstrip()


def _escape_markdown(text: str) -> str:
    escaped = "".join("\\" + c if c in r"\`*_[]|#!~$" else c for c in " ".join(text.split()))
    return html.escape(escaped, quote=False)


def _html(table: Table) -> str:
    blocks = [_html_block(piece) for piece in by_count(table)]
    caption = f"<table>\n<caption>{html.escape(plain(table.title))}</caption>\n"
    blocks[0] = blocks[0].replace("<table>\n", caption, 1)
    notes = [f"<p>{html.escape(plain(note))}</p>" for note in table.all_notes]
    return "".join([*blocks, *notes]) + "\n"


def _html_block(table: Table) -> str:
    # Attributes, since pages and sites that take in a table may allow no styles.
    sides = ["left" if table.is_text(i) else "right" for i in range(len(table.columns))]
    titles = [
        f'<th scope="col" align="{side}">{html.escape(plain(column.heading))}</th>'
        for column, side in zip(table.columns, sides, strict=True)
    ]
    groups = []
    for group, members in groupby(table.columns, key=lambda column: column.group):
        span, title = len(list(members)), html.escape(plain(group))
        groups.append(
            f'<th colspan="{span}" scope="colgroup">{title}</th>'
            if group
            else f'<td colspan="{span}"></td>'
        )
    head = f"<tr>{''.join(groups)}</tr>" * table.has_groups + f"<tr>{''.join(titles)}</tr>"
    rows = [
        _html_row(row, texts, sides)
        for row, texts in zip(table.rows, _values_apart(table), strict=True)
    ]
    body = "".join(rows)
    return f"<table>\n<thead>{head}</thead>\n<tbody>\n{body}</tbody>\n</table>\n"


def _html_row(row: Row, texts: list[tuple[str, str]], sides: list[str]) -> str:
    cells = [
        f'<td align="{side}">{_html_cell(cell, *text, row)}</td>'
        for cell, text, side in zip(row.cells, texts, sides, strict=True)
    ]
    kinds = {"highlighted": row.highlighted, "reported": row.reported, "floor": row.floor}
    named = " ".join(kind for kind, has in kinds.items() if has)
    attributes = (f' class="{named}"' if named else "") + ' bgcolor="#fff3bf"' * row.highlighted
    return f"<tr{attributes}>{''.join(cells)}</tr>\n"


def _html_cell(cell: Cell, text: str, suffix: str, row: Row) -> str:
    value = html.escape(text)
    tags = ["u"] * cell.second + ["strong"] * cell.best + ["em"] * (not row.is_own)
    for tag in tags:
        value = f"<{tag}>{value}</{tag}>"
    return value + (f" <small>{html.escape(suffix.strip())}</small>" if suffix else "")


def _json(table: Table) -> str:
    """Write values in the shape of the rows, and in the same shape what some cells have beside."""
    cells = [cell for row in table.rows for cell in row.cells]
    content: dict[str, object] = {
        "title": table.title,
        "columns": [_json_column(column) for column in table.columns],
        "rows": [[_json_value(cell.value) for cell in row.cells] for row in table.rows],
        "notes": list(table.all_notes),
    }
    if any(cell.gain is not None for cell in cells):
        content["gains"] = [[cell.gain for cell in row.cells] for row in table.rows]
    if any(cell.uncertainty for cell in cells):
        content["uncertainties"] = [
            [
                (span := cell.uncertainty)
                and {"low": _json_value(span.low), "high": _json_value(span.high)}
                for cell in row.cells
            ]
            for row in table.rows
        ]
    if any(row.reported for row in table.rows):
        content["reported"] = [_standing(row) if row.reported else None for row in table.rows]
    if any(row.floor for row in table.rows):
        content["floors"] = [row.floor for row in table.rows]
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def _json_column(column: Column) -> dict[str, object]:
    group = {"group": column.group} if column.group else {}
    kept = {"title": column.title, "unit": column.unit, "higher_is_better": column.higher_is_better}
    return {**kept, **group}


def _json_value(value: float | int | str | None) -> object:
    if isinstance(value, float) and math.isinf(value):
        return "Infinity" if value > 0 else "-Infinity"
    return value


_RENDERERS: dict[str, Callable[[Table], str]] = {
    "csv": _csv,
    "markdown": _markdown,
    "html": _html,
    "json": _json,
}

FORMATS = ("terminal", "latex", *_RENDERERS)
"""The formats that tables can be rendered in."""
