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
from airzoo_bench.tables.model import Cell, Column, Row, Table, by_count, plain, show_number
from airzoo_bench.tables.terminal import TERMINAL_WIDTH, terminal

# Scores are called such as "@5m,10°": there is no operator in it and no function, thus no formula.
_HARMLESS = re.compile(r"-?[0-9]+(\.[0-9]+)?(e\+[0-9]+)?|-inf|@[0-9][\w.,° ±]*")


def render(table: Table, form: str, *, width: int = TERMINAL_WIDTH, styled: bool = False) -> str:
    """Render a table as text that ends with a newline."""
    if form == "terminal":
        return terminal(table, width=width, styled=styled)
    return _RENDERERS[form](table)


def _csv(table: Table) -> str:
    """Write a value a field: limits and gains have columns of their own."""
    marked = not all(row.is_own for row in table.rows)
    columns = [_csv_column(table, index) for index in range(len(table.columns))]
    fields = [field for column in columns for field in column]
    if marked:
        fields.append(["Marked", *(plain(row.standing) for row in table.rows)])
    out = io.StringIO()
    lines = zip(*fields, strict=True)
    csv.writer(out, lineterminator="\n").writerows([map(_without_formula, line) for line in lines])
    return out.getvalue()


def _csv_column(table: Table, index: int) -> list[list[str]]:
    """Return the fields of a column, each from its title down: values, limits, gains."""
    column, cells = table.columns[index], [row.cells[index] for row in table.rows]
    title = f"{column.group} {column.title}"
    values = [repr(c.value) if c.is_too_small else c.text(column.decimals) for c in cells]
    fields = [[plain(title), *values]]
    beside: dict[str, list[float | None]] = {}
    if any(cell.uncertainty for cell in cells):
        beside[" from"] = [cell.uncertainty and cell.uncertainty.low for cell in cells]
        beside[" to"] = [cell.uncertainty and cell.uncertainty.high for cell in cells]
    if any(cell.gain is not None for cell in cells):
        beside[" gain"] = [cell.gain for cell in cells]
    for kind, numbers in beside.items():
        texts = ["" if n is None else show_number(n, column.decimals) for n in numbers]
        fields.append([plain(title + kind), *texts])
    return fields


def _without_formula(text: str) -> str:
    # A spreadsheet would run a method's name that begins like a formula.
    is_formula = text[:1] in ("=", "+", "-", "@") and not _HARMLESS.fullmatch(text)
    return "'" + text if is_formula else text


def _values_apart(table: Table) -> list[list[tuple[Cell, str, str]]]:
    """Return each cell with its value and what follows it, as shown."""
    return [
        [
            (cell, value, text.removeprefix(value))
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
        [_markdown_cell(*cell, row) for cell in cells]
        for row, cells in zip(table.rows, _values_apart(table), strict=True)
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
    head = f"<tr>{''.join(titles)}</tr>"
    if table.has_groups:
        head = f"<tr>{''.join(_html_groups(table))}</tr>{head}"
    rows = zip(table.rows, _values_apart(table), strict=True)
    body = "".join(_html_row(row, cells, sides) for row, cells in rows)
    return f"<table>\n<thead>{head}</thead>\n<tbody>\n{body}</tbody>\n</table>\n"


def _html_groups(table: Table) -> list[str]:
    cells = []
    for group, members in groupby(table.columns, key=lambda column: column.group):
        span, title = len(list(members)), html.escape(plain(group))
        named = f'<th colspan="{span}" scope="colgroup">{title}</th>'
        cells.append(named if group else f'<td colspan="{span}"></td>')
    return cells


def _html_row(row: Row, cells: list[tuple[Cell, str, str]], sides: list[str]) -> str:
    texts = []
    for (cell, text, suffix), side in zip(cells, sides, strict=True):
        value = html.escape(text)
        for tag in ["u"] * cell.second + ["strong"] * cell.best + ["em"] * (not row.is_own):
            value = f"<{tag}>{value}</{tag}>"
        small = f" <small>{html.escape(suffix.strip())}</small>" if suffix else ""
        texts.append(f'<td align="{side}">{value}{small}</td>')
    kinds = {"highlighted": row.highlighted, "reported": row.reported, "floor": row.floor}
    named = " ".join(kind for kind, has in kinds.items() if has)
    attributes = (f' class="{named}"' if named else "") + ' bgcolor="#fff3bf"' * row.highlighted
    return f"<tr{attributes}>{''.join(texts)}</tr>\n"


def _json(table: Table) -> str:
    """Write values in the shape of the rows; limits and gains in the same shape."""
    content: dict[str, object] = {
        "title": table.title,
        "columns": [_json_column(column) for column in table.columns],
        "rows": _json_rows(table, lambda cell: _json_value(cell.value)),
        "notes": list(table.all_notes),
    }
    cells = [cell for row in table.rows for cell in row.cells]
    if any(cell.gain is not None for cell in cells):
        content["gains"] = _json_rows(table, lambda cell: cell.gain)
    if any(cell.uncertainty for cell in cells):
        content["uncertainties"] = _json_rows(table, _json_limits)
    if any(row.reported for row in table.rows):
        content["reported"] = [row.standing if row.reported else None for row in table.rows]
    if any(row.floor for row in table.rows):
        content["floors"] = [row.floor for row in table.rows]
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def _json_rows(table: Table, shown: Callable[[Cell], object]) -> list[list[object]]:
    return [[shown(cell) for cell in row.cells] for row in table.rows]


def _json_limits(cell: Cell) -> object:
    span = cell.uncertainty
    return span and {name: _json_value(limit) for name, limit in span._asdict().items()}


def _json_column(column: Column) -> dict[str, object]:
    group = {"group": column.group} if column.group else {}
    own = {"title": column.title, "unit": column.unit, "higher_is_better": column.higher_is_better}
    return {**own, **group}


def _json_value(value: float | int | str | None) -> object:
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
