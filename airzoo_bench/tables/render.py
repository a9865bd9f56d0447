"""Renderers of the table model: terminal, LaTeX, CSV, Markdown, HTML, JSON."""

from __future__ import annotations

import csv
import html
import io
import json
import math
from collections.abc import Callable

from airzoo_bench.tables.model import Cell, Column, Row, Table, plain

__all__ = ["FORMATS", "render"]

_LATEX = {
    "\\": r"\textbackslash{}",
    "&": r"\&",
    "%": r"\%",
    "$": r"\$",
    "#": r"\#",
    "_": r"\_",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': r"\textquotedbl{}",
    "[": "{[}",  # after a line's end it would begin an optional argument, as * would
    "*": "{*}",
    "↑": r"$\uparrow$",
    "↓": r"$\downarrow$",
    "–": r"--",
    "…": r"\dots{}",
}


def render(table: Table, form: str) -> str:
    """Render a table as text that ends with a newline.

    Parameters
    ----------
    table : Table
    form : str
        One of `FORMATS`.
    """
    return _RENDERERS[form](table)


def _terminal(table: Table) -> str:
    from rich import box
    from rich.console import Console
    from rich.table import Table as RichTable
    from rich.text import Text

    shown = RichTable(title=Text(plain(table.title)), box=box.SIMPLE_HEAD, title_justify="left")
    for index, column in enumerate(table.columns):
        shown.add_column(
            Text(column.heading), justify="left" if _is_text(table, index) else "right"
        )
    previous = False
    for row, texts in zip(table.rows, table.texts(), strict=True):
        if row.summary and not previous:
            shown.add_section()
        previous = row.summary
        cells = zip(row.cells, texts, strict=True)
        shown.add_row(*(Text(text, style="bold" if cell.best else "") for cell, text in cells))
    out = io.StringIO()
    console = Console(file=out, width=_width(table), force_terminal=False)
    console.print(shown)
    return out.getvalue() + "".join(f"  {plain(note)}\n" for note in table.notes)


def _is_text(table: Table, column: int) -> bool:
    return any(isinstance(row.cells[column].value, str) for row in table.rows) or column == 0


def _width(table: Table) -> int:
    from rich.cells import cell_len

    # As wide as the table needs: a pipe has no width, and cut-off numbers are no numbers.
    columns = zip(*([c.heading for c in table.columns], *table.texts()), strict=True)
    needed = sum(max(map(cell_len, column)) + 3 for column in columns) + 4
    return max(40, cell_len(plain(table.title)), needed)


def _latex(table: Table) -> str:
    lines = [
        "% " + plain(table.title),
        *("% " + plain(note) for note in table.notes),
        r"\begin{tabular}{l" + "r" * (len(table.columns) - 1) + "}",
        r"\toprule",
        " & ".join(_escape_latex(column.heading) for column in table.columns) + r" \\",
        r"\midrule",
    ]
    previous = False
    for row, texts in zip(table.rows, table.texts(), strict=True):
        if row.summary and not previous:
            lines.append(r"\midrule")
        previous = row.summary
        cells = zip(row.cells, texts, strict=True)
        lines.append(" & ".join(_latex_cell(cell, text) for cell, text in cells) + r" \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def _latex_cell(cell: Cell, text: str) -> str:
    escaped = _escape_latex(text)
    return rf"\textbf{{{escaped}}}" if cell.best else escaped


def _escape_latex(text: str) -> str:
    return "".join(_LATEX.get(character, character) for character in " ".join(text.split()))


def _csv(table: Table) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([column.title for column in table.columns])
    writer.writerows([_defused(text) for text in row] for row in table.texts())
    return out.getvalue()


def _defused(text: str) -> str:
    # A spreadsheet would run a method's name that begins like a formula.
    is_number = text.removeprefix("-").replace(".", "", 1).isdigit() or text == "-inf"
    return "'" + text if text[:1] in ("=", "+", "-", "@") and not is_number else text


def _markdown(table: Table) -> str:
    def line(cells: list[str]) -> str:
        return "| " + " | ".join(cells) + " |"

    rule = ["---"] + ["---:"] * (len(table.columns) - 1)
    rows = [
        line([_markdown_cell(cell, text) for cell, text in zip(row.cells, texts, strict=True)])
        for row, texts in zip(table.rows, table.texts(), strict=True)
    ]
    heads = [_escape_markdown(column.heading) for column in table.columns]
    notes = [f"\n{_escape_markdown(plain(note))}" for note in table.notes]
    return "\n".join([line(heads), line(rule), *rows, *notes]) + "\n"


def _markdown_cell(cell: Cell, text: str) -> str:
    escaped = _escape_markdown(text)
    return f"**{escaped}**" if cell.best else escaped


def _escape_markdown(text: str) -> str:
    escaped = "".join("\\" + c if c in r"\`*_[]|#!~$" else c for c in " ".join(text.split()))
    return html.escape(escaped, quote=False)


def _html(table: Table) -> str:
    def tag(name: str, text: str) -> str:
        return f"<{name}>{html.escape(text)}</{name}>"

    heads = "".join(tag("th", column.heading) for column in table.columns)
    rows = "".join(
        _html_row(row, texts) for row, texts in zip(table.rows, table.texts(), strict=True)
    )
    notes = "".join(tag("p", plain(note)) for note in table.notes)
    return (
        f"<table>\n{tag('caption', plain(table.title))}\n<thead><tr>{heads}</tr></thead>\n"
        f"<tbody>\n{rows}</tbody>\n</table>\n{notes}\n"
    )


def _html_row(row: Row, texts: list[str]) -> str:
    cells = [
        f"<td><strong>{html.escape(text)}</strong></td>"
        if cell.best
        else f"<td>{html.escape(text)}</td>"
        for cell, text in zip(row.cells, texts, strict=True)
    ]
    return f"<tr>{''.join(cells)}</tr>\n"


def _json(table: Table) -> str:
    content = {
        "title": table.title,
        "columns": [_json_column(column) for column in table.columns],
        "rows": [[_json_value(cell) for cell in row.cells] for row in table.rows],
        "notes": list(table.notes),
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def _json_column(column: Column) -> dict[str, object]:
    return {
        "title": column.title,
        "unit": column.unit,
        "higher_is_better": column.higher_is_better,
    }


def _json_value(cell: Cell) -> object:
    if isinstance(cell.value, float) and math.isinf(cell.value):
        return "Infinity" if cell.value > 0 else "-Infinity"
    return cell.value


_RENDERERS: dict[str, Callable[[Table], str]] = {
    "terminal": _terminal,
    "latex": _latex,
    "csv": _csv,
    "markdown": _markdown,
    "html": _html,
    "json": _json,
}

FORMATS = tuple(_RENDERERS)
"""The formats that tables can be rendered in."""
