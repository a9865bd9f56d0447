"""Renderers of the table model: terminal, LaTeX, CSV, Markdown, HTML, JSON."""

from __future__ import annotations

import csv
import html
import io
import json
import math
import re
from collections.abc import Callable, Iterator, Sequence

from airzoo_bench.tables.latex import latex
from airzoo_bench.tables.model import Cell, Column, Row, Table, plain, show_number
from airzoo_bench.tables.terminal import terminal

# Scores have titles such as "@5m,10°": there is no operator in it and no function, thus no formula.
_HARMLESS = re.compile(r"-?[0-9]+(\.[0-9]+)?(e\+[0-9]+)?|-inf|@[0-9][\w.,° ±]*")


def render(table: Table, form: str, *, width: int = 80, styled: bool = False) -> str:
    """Render a table as text that ends with a newline."""
    if form == "terminal":
        return terminal(table, width=width, styled=styled)
    return _RENDERERS[form](table)


def _csv(table: Table) -> str:
    """Write a value a field: limits and gains have columns of their own."""
    fields = [
        field
        for column, cells in zip(table.columns, _columns(table), strict=True)
        for field in _csv_fields(column, cells)
    ]
    if not all(row.is_own for row in table.rows):
        fields.append(["Marked", *(plain(row.standing) for row in table.rows)])
    out = io.StringIO()
    lines = zip(*fields, strict=True)
    csv.writer(out, lineterminator="\n").writerows([map(_without_formula, line) for line in lines])
    return out.getvalue()


def _columns(table: Table) -> list[list[Cell]]:
    return [[row.cells[index] for row in table.rows] for index in range(len(table.columns))]


def _csv_fields(column: Column, cells: Sequence[Cell]) -> Iterator[list[str]]:
    """Yield the fields of a column, each from its title down: values, limits, gains."""
    title, digits = plain(f"{column.group} {column.title}"), column.decimals
    yield [title, *(repr(c.value) if c.is_too_small else c.text(digits) for c in cells)]
    spans, gains = [cell.uncertainty for cell in cells], [cell.gain for cell in cells]
    beside = {"from": [span and span.low for span in spans]} if any(spans) else {}
    beside |= {"to": [span and span.high for span in spans]} if any(spans) else {}
    beside |= {"gain": gains} if any(gain is not None for gain in gains) else {}
    for kind, numbers in beside.items():
        texts = ("" if n is None else show_number(n, digits) for n in numbers)
        yield [f"{title} {kind}", *texts]


def _without_formula(text: str) -> str:
    # A spreadsheet would run a method's name that begins like a formula.
    is_formula = text[:1] in ("=", "+", "-", "@") and not _HARMLESS.fullmatch(text)
    return "'" + text if is_formula else text


def _values_apart(table: Table) -> list[list[tuple[Cell, str, str]]]:
    """Return each cell with its value and what follows it, as shown."""
    return [
        [
            (cell, value, text.removeprefix(value).strip())
            for cell, column, text in zip(row.cells, table.columns, texts, strict=True)
            for value in [cell.text(column.decimals)]
        ]
        for row, texts in zip(table.rows, table.texts(), strict=True)
    ]


def _markdown(table: Table) -> str:
    # Tables here have one line of titles: each says its group.
    blocks = "\n".join(map(_markdown_block, table.pieces()))
    return blocks + "".join(f"\n{_escape_markdown(plain(note))}\n" for note in table.all_notes)


def _markdown_block(table: Table) -> str:
    rule = ["---" if table.is_text(i) else "---:" for i in range(len(table.columns))]
    lines = [[_escape_markdown(f"{plain(c.group)} {c.heading}") for c in table.columns], rule]
    for row, cells in zip(table.rows, _values_apart(table), strict=True):
        line = []
        for cell, value, suffix in cells:
            text = _escape_markdown(value)
            marked = f"**{text}**" if cell.best else f"<u>{text}</u>" if cell.second else text
            shown = f"*{text}*" if row.floor else marked
            line.append(f"{shown} {_escape_markdown(suffix)}".rstrip())
        lines.append(line)
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def _escape_markdown(text: str) -> str:
    escaped = "".join("\\" + c if c in r"\`*_[]|#!~$" else c for c in " ".join(text.split()))
    return html.escape(escaped, quote=False)


def _html(table: Table) -> str:
    blocks = "".join(map(_html_block, table.pieces()))
    caption = f"<table>\n<caption>{_escape(table.title)}</caption>\n"
    notes = [f"<p>{_escape(note)}</p>" for note in table.all_notes]
    return blocks.replace("<table>\n", caption, 1) + "".join(notes) + "\n"


def _escape(text: str) -> str:
    return html.escape(plain(text))


def _html_block(table: Table) -> str:
    # Attributes, since pages and sites that take in a table may allow no styles. Titles are in one
    # line: each says its group.
    sides = ["left" if table.is_text(i) else "right" for i in range(len(table.columns))]
    heads = "".join(
        f'<th scope="col" align="{side}">{_escape(f"{column.group} {column.heading}")}</th>'
        for column, side in zip(table.columns, sides, strict=True)
    )
    rows = zip(table.rows, _values_apart(table), strict=True)
    body = "".join(_html_row(row, cells, sides) for row, cells in rows)
    return f"<table>\n<thead><tr>{heads}</tr></thead>\n<tbody>\n{body}</tbody>\n</table>\n"


def _html_row(row: Row, cells: list[tuple[Cell, str, str]], sides: list[str]) -> str:
    texts = ""
    for (cell, text, suffix), side in zip(cells, sides, strict=True):
        value = html.escape(text)
        for tag in ["u"] * cell.second + ["strong"] * cell.best + ["em"] * (not row.is_own):
            value = f"<{tag}>{value}</{tag}>"
        small = f" <small>{html.escape(suffix)}</small>" if suffix else ""
        texts += f'<td align="{side}">{value}{small}</td>'
    ground = ' bgcolor="#fff3bf"' * row.highlighted
    return f"<tr{ground}>{texts}</tr>\n"


def _json(table: Table) -> str:
    """Write values in the shape of the rows; limits and gains in the same shape."""

    def rows(shown: Callable[[Cell], object]) -> list[list[object]]:
        return [[shown(cell) for cell in row.cells] for row in table.rows]

    def limits(cell: Cell) -> object:
        return cell.uncertainty and {k: _number(v) for k, v in cell.uncertainty._asdict().items()}

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
