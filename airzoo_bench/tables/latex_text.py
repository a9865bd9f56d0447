"""Text and numbers for LaTeX: escaped, so that what strangers wrote commands nothing; how wide."""

from __future__ import annotations

import re

from airzoo_bench.tables.model import Cell, Column, Table

__all__ = [
    "COLUMN",
    "PAGE",
    "escape",
    "latex_width",
    "math_minus",
    "suffix_text",
    "text_width",
]

_SPECIAL = {
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
    # By number, since the named ones are not in every font encoding.
    '"': r"\symbol{34}",
    "`": r"\symbol{96}",
    "[": "{[}",  # after a line's end it would begin an optional argument, as * would
    "*": "{*}",
    "↑": r"$\uparrow$",
    "↓": r"$\downarrow$",
    "°": r"$^\circ$",
    "±": r"$\pm$",
    "×": r"$\times$",
    "µ": r"$\mu$",
    "†": r"\textsuperscript{$\dagger$}",
    "‡": r"\textsuperscript{$\ddagger$}",
    "–": r"--",
    "—": r"---",
    "…": r"\dots{}",
}
_LIGATURE = re.compile(r"([-,'])(?=\1)")
PAGE = 50.0
"""The width of a usual page of two columns, in em of its text."""

COLUMN = 24.0
"""The width of one of its columns."""

_BETWEEN = 1.2  # two gaps of LaTeX, of 6 pt at 10 pt
_BOLD = 1.15
_CITATION = 2.0
# Of Computer Modern, which is as wide as most.
_LETTERS = {
    **dict.fromkeys(" ()[]", 0.36),
    **dict.fromkeys(".,:;'|!ijl", 0.28),
    **dict.fromkeys("+-−<>=±", 0.78),
    **dict.fromkeys("↑↓", 0.5),
    **dict.fromkeys("0123456789", 0.5),
    **dict.fromkeys("@%mMwW", 0.85),
}
_LOWER, _UPPER = 0.47, 0.72


def escape(text: str) -> str:
    """Return a text as LaTeX source of one line."""
    line = " ".join(text.split())
    # Two hyphens in a name are no dash.
    apart = _LIGATURE.sub("\\1\0", line)
    return "".join(_SPECIAL.get(c, c) for c in apart).replace("\0", "{}")


def math_minus(text: str) -> str:
    """Put a true minus before a printed number, which may stand between brackets."""
    return re.sub(r"^(\{\[\})?-(?=[0-9.]+[],]?$)", r"\1$-$", text)


def latex_width(table: Table) -> float:
    """Estimate the width of a table in em, with the gaps between its columns."""
    widest = [_column(table, index) for index in range(len(table.columns))]
    for group in dict.fromkeys(column.group for column in table.columns if column.group):
        members = [i for i, column in enumerate(table.columns) if column.group == group]
        inner = sum(widest[i] for i in members) + _BETWEEN * (len(members) - 1)
        widest[members[-1]] += max(0.0, text_width(group, bold=True) - inner)
    return sum(widest) + _BETWEEN * len(widest)


def text_width(text: str, *, bold: bool = False) -> float:
    """Estimate the width of a text in em."""
    width = sum(_LETTERS.get(c, _UPPER if c.isupper() else _LOWER) for c in text)
    return width * _BOLD if bold else width


def _column(table: Table, index: int) -> float:
    column = table.columns[index]
    title = text_width(column.title, bold=True) + text_width(column.title_suffix)
    return max(title, *(_cell(row.cells[index], column) for row in table.rows), 0)


def _cell(cell: Cell, column: Column) -> float:
    value = text_width(cell.text(column.decimals), bold=cell.best)
    suffix = text_width("".join(f" {part}" for part in cell.suffix(column.decimals)))
    return value + suffix + _CITATION * bool(cell.cite)


def suffix_text(cell: Cell, decimals: int) -> str:
    """Return what follows a value behind a gap: uncertainty, then gain in grey."""
    parts = " ".join(map(_suffix_part, cell.suffix(decimals)))
    return f" {parts}" if parts else ""


def _suffix_part(text: str) -> str:
    if text.startswith("("):
        return rf"{{\color{{gray}}({math_minus(escape(text[1:-1]))})}}"
    return " ".join(math_minus(escape(part)) for part in text.split())
