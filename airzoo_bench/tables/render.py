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

from airzoo_bench.tables.blocks import by_count
from airzoo_bench.tables.latex import latex
from airzoo_bench.tables.model import (
    FLOOR,
    REPORTED,
    Between,
    Cell,
    Column,
    Row,
    Table,
    Uncertainty,
    plain,
    show_number,
)
from airzoo_bench.tables.terminal import TERMINAL_WIDTH, terminal

__all__ = ["FORMATS", "render"]

_GROUND = "#fff3bf"
# Scores are called such as "@5m,10°": there is no operator in it and no function, thus no formula.
_NUMBER = re.compile(r"-?[0-9]+(\.[0-9]+)?(e\+[0-9]+)?")
_THRESHOLD = re.compile(r"@[0-9][\w.,° ±]*")


def render(
    table: Table,
    form: str,
    *,
    width: int = TERMINAL_WIDTH,
    styled: bool = False,
    fit: bool = False,
) -> str:
    """Render a table as text that ends with a newline."""
    if form == "terminal":
        return terminal(table, width=width, styled=styled)
    if form == "latex":
        return latex(table, fit=fit)
    return _RENDERERS[form](table)


def _csv(table: Table) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    kinds = [_suffixes_in_csv(table, index) for index in range(len(table.columns))]
    marked = not all(row.is_own for row in table.rows)
    titles = [
        plain(f"{column.group} {column.title}{kind}")
        for column, suffixes in zip(table.columns, kinds, strict=True)
        for kind in ("", *suffixes)
    ]
    writer.writerow([_defused(text) for text in [*titles, *["Marked"] * marked]])
    for row in table.rows:
        cells = zip(row.cells, table.columns, kinds, strict=True)
        texts = [text for given in cells for text in _csv_cells(*given)]
        mark = [plain(_standing(row))] * marked
        writer.writerow([_defused(text) for text in [*texts, *mark]])
    return out.getvalue()


def _standing(row: Row) -> str:
    """Say what a row is that is of no method scored here; empty for one that is."""
    return FLOOR if row.floor else f"{REPORTED}: {row.reported}" if row.reported else ""


def _suffixes_in_csv(table: Table, index: int) -> list[str]:
    """Return the endings of the further columns that keep each cell one number."""
    cells = [row.cells[index] for row in table.rows]
    uncertainties = [cell.uncertainty for cell in cells if cell.uncertainty]
    found = [" from", " to"] if any(isinstance(u, Between) for u in uncertainties) else []
    found += [" ±"] if any(not isinstance(u, Between) for u in uncertainties) else []
    return found + ([" gain"] if any(cell.gain is not None for cell in cells) else [])


def _csv_cells(cell: Cell, column: Column, suffixes: list[str]) -> list[str]:
    numbers = _suffix_numbers(cell)
    further = [numbers.get(kind.strip()) for kind in suffixes]
    texts = ["" if n is None else show_number(n, column.decimals) for n in further]
    return [repr(cell.value) if cell.is_too_small else cell.text(column.decimals), *texts]


def _suffix_numbers(cell: Cell) -> dict[str, float]:
    found = {} if cell.gain is None else {"gain": cell.gain}
    if isinstance(cell.uncertainty, Between):
        return found | {"from": cell.uncertainty.low, "to": cell.uncertainty.high}
    return found if cell.uncertainty is None else found | {"±": cell.uncertainty.half}


def _defused(text: str) -> str:
    # A spreadsheet would run a method's name that begins like a formula.
    is_number = _NUMBER.fullmatch(text) or text == "-inf"
    is_harmless = is_number or _THRESHOLD.fullmatch(text)
    return "'" + text if text[:1] in ("=", "+", "-", "@") and not is_harmless else text


def _markdown(table: Table) -> str:
    # Tables here have one line of titles: each says its group.
    blocks = "\n".join(_markdown_block(piece) for piece in by_count(table))
    notes = [f"\n{_escape_markdown(plain(note))}\n" for note in table.all_notes]
    return blocks + "".join(notes)


def _markdown_block(table: Table) -> str:
    def line(cells: list[str]) -> str:
        return "| " + " | ".join(cells) + " |\n"

    rule = ["---" if table.is_text(i) else "---:" for i in range(len(table.columns))]
    titles = [_escape_markdown(f"{plain(c.group)} {c.heading}") for c in table.columns]
    rows = (
        line([_markdown_cell(*pair, row) for pair in zip(row.cells, texts, strict=True)])
        for row, texts in zip(table.rows, _values_apart(table), strict=True)
    )
    return "".join([line(titles), line(rule), *rows])


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


def _markdown_cell(cell: Cell, text: tuple[str, str], row: Row) -> str:
    value = _escape_markdown(text[0])
    shown = f"**{value}**" if cell.best else f"<u>{value}</u>" if cell.second else value
    shown = f"*{value}*" if row.floor else shown
    return f"{shown} {_escape_markdown(text[1])}".rstrip()


def _escape_markdown(text: str) -> str:
    escaped = "".join("\\" + c if c in r"\`*_[]|#!~$" else c for c in " ".join(text.split()))
    return html.escape(escaped, quote=False)


def _html(table: Table) -> str:
    blocks = by_count(table)
    shown = "".join(_html_block(piece, captioned=piece is blocks[0]) for piece in blocks)
    return shown + "".join(_tag("p", plain(note)) for note in table.all_notes) + "\n"


def _tag(name: str, text: str) -> str:
    return f"<{name}>{html.escape(text)}</{name}>"


def _html_block(table: Table, *, captioned: bool) -> str:
    caption = f"{_tag('caption', plain(table.title))}\n" if captioned else ""
    titles = "".join(
        f'<th scope="col"{_side(table, i)}>{html.escape(plain(column.heading))}</th>'
        for i, column in enumerate(table.columns)
    )
    rows = "".join(
        _html_row(table, row, texts)
        for row, texts in zip(table.rows, _values_apart(table), strict=True)
    )
    return (
        f"<table>\n{caption}<thead>{_html_groups(table)}<tr>{titles}</tr></thead>\n"
        f"<tbody>\n{rows}</tbody>\n</table>\n"
    )


def _html_groups(table: Table) -> str:
    if not any(column.group for column in table.columns):
        return ""
    counted = [
        (group, len(list(members)))
        for group, members in groupby(table.columns, key=lambda column: column.group)
    ]
    cells = (
        f'<th colspan="{number}" scope="colgroup">{html.escape(plain(group))}</th>'
        if group
        else f'<td colspan="{number}"></td>'
        for group, number in counted
    )
    return f"<tr>{''.join(cells)}</tr>"


def _side(table: Table, column: int) -> str:
    # An attribute, since pages and sites that take in a table may allow no styles.
    return ' align="left"' if table.is_text(column) else ' align="right"'


def _html_row(table: Table, row: Row, texts: list[tuple[str, str]]) -> str:
    cells = (
        f"<td{_side(table, i)}>{_html_cell(cell, text, row)}</td>"
        for i, (cell, text) in enumerate(zip(row.cells, texts, strict=True))
    )
    kinds = ["highlighted"] * row.highlighted + ["reported"] * bool(row.reported)
    kinds += ["floor"] * row.floor
    attribute = f' class="{" ".join(kinds)}"' if kinds else ""
    ground = f' bgcolor="{_GROUND}"' if row.highlighted else ""
    return f"<tr{attribute}{ground}>{''.join(cells)}</tr>\n"


def _html_cell(cell: Cell, text: tuple[str, str], row: Row) -> str:
    value = html.escape(text[0])
    tags = ["em"] * (not row.is_own) + ["strong"] * cell.best + ["u"] * cell.second
    for tag in reversed(tags):
        value = f"<{tag}>{value}</{tag}>"
    return value + (f" {_tag('small', text[1].strip())}" if text[1] else "")


def _json(table: Table) -> str:
    content: dict[str, object] = {
        "title": table.title,
        "columns": [_json_column(column) for column in table.columns],
        "rows": [[_json_value(cell.value) for cell in row.cells] for row in table.rows],
        "notes": list(table.all_notes),
    }
    content |= _json_suffixes(table)
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def _json_column(column: Column) -> dict[str, object]:
    group = {"group": column.group} if column.group else {}
    return {
        "title": column.title,
        "unit": column.unit,
        "higher_is_better": column.higher_is_better,
        **group,
    }


def _json_suffixes(table: Table) -> dict[str, object]:
    """Return what some cells or rows have next to their values, each in the shape of the rows."""
    found: dict[str, object] = {}
    if any(cell.gain is not None for row in table.rows for cell in row.cells):
        found["gains"] = [[cell.gain for cell in row.cells] for row in table.rows]
    if any(cell.uncertainty for row in table.rows for cell in row.cells):
        found["uncertainties"] = [
            [_json_uncertainty(cell.uncertainty) for cell in row.cells] for row in table.rows
        ]
    if any(row.reported for row in table.rows):
        found["reported"] = [_standing(row) if row.reported else None for row in table.rows]
    if any(row.floor for row in table.rows):
        found["floors"] = [row.floor for row in table.rows]
    return found


def _json_uncertainty(uncertainty: Uncertainty | None) -> object:
    if isinstance(uncertainty, Between):
        return {"low": _json_value(uncertainty.low), "high": _json_value(uncertainty.high)}
    return uncertainty and {"half": _json_value(uncertainty.half)}


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
