"""Text and numbers for LaTeX: escaped, so that what strangers wrote commands nothing; how wide."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from airzoo_bench.tables.model import Cell, Column, Table, is_wide

__all__ = [
    "COLUMN",
    "PAGE",
    "NumberFormat",
    "escape",
    "is_number",
    "latex_width",
    "math_minus",
    "number_format",
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
_GAP = r"\enspace{}"


def escape(text: str) -> str:
    """Return a text as LaTeX source of one line.

    Letters beyond ASCII stay as they are: what a font lacks is a matter of fonts.
    """
    line = " ".join(text.split())
    # Two hyphens in a name are no dash.
    apart = _LIGATURE.sub("\\1\0", line)
    return "".join(_SPECIAL.get(c, c) for c in apart).replace("\0", "{}")


def math_minus(text: str) -> str:
    """Put a true minus before a printed number, which may stand between brackets."""
    return re.sub(r"^(\{\[\})?-(?=[0-9.]+[],]?$)", r"\1$-$", text)


def latex_width(table: Table, *, aligned: bool = False) -> float:
    """Estimate the width of a table in em, with the gaps between its columns.

    Parameters
    ----------
    table : Table
    aligned : bool
        Whether titles stand above the numbers alone, and not above what follows them too.
    """
    widest = [_column(table, index, aligned) for index in range(len(table.columns))]
    for group in dict.fromkeys(column.group for column in table.columns if column.group):
        members = [i for i, column in enumerate(table.columns) if column.group == group]
        inner = sum(widest[i] for i in members) + _BETWEEN * (len(members) - 1)
        widest[members[-1]] += max(0.0, text_width(group, bold=True) - inner)
    return sum(widest) + _BETWEEN * len(widest)


def text_width(text: str, *, bold: bool = False) -> float:
    """Estimate the width of a text in em."""
    width = sum(_LETTERS.get(c, _UPPER if c.isupper() else _LOWER) for c in text)
    return width * _BOLD if bold else width


def _column(table: Table, index: int, aligned: bool) -> float:
    column = table.columns[index]
    title = text_width(column.title, bold=True) + text_width(column.title_suffix)
    cells = [_cell(row.cells[index], column) for row in table.rows]
    if not aligned:
        return max(title, *(value + suffix for value, suffix in cells), 0)
    return max(title, *(value for value, _ in cells), 0) + max((b for _, b in cells), default=0)


def _cell(cell: Cell, column: Column) -> tuple[float, float]:
    value = text_width(cell.text(column.decimals), bold=cell.best)
    suffix = text_width("".join(f" {part}" for part in cell.suffix(column.decimals)))
    return value + _CITATION * bool(cell.cite), suffix


@dataclass(frozen=True)
class NumberFormat:
    """How siunitx aligns the numbers of a column.

    What siunitx is not told to parse it centres. It does not parse an underlined number, and sets a
    bold one off its place where bold digits are wider. So a marked number is set in a box of the
    width that siunitx gives to any number of the column: that is centred at the same place.

    Attributes
    ----------
    digits, decimals : int
        The most before the point, and those after it.
    signed : bool
        Whether any is below zero.
    after : str
        The widest of what follows the numbers, as LaTeX.
    """

    digits: int
    decimals: int
    signed: bool
    after: str

    @property
    def column(self) -> str:
        """The column's type."""
        sign = "-" if self.signed else ""
        room = f",table-space-text-post={{{self.after}}}" if self.after else ""
        return f"S[table-format={sign}{self.digits}.{self.decimals}{room}]"

    def cell(self, cell: Cell, decimals: int, style: str = "") -> str:
        """Return a number with its mark, or in another style, and what follows it."""
        number, after = cell.text(decimals), suffix_text(cell, decimals, _GAP)
        if not (cell.best or cell.second or style or number.startswith("<")):
            return number + (f"{{{after}}}" if after else "")
        whole, point, decimal = number.partition(".")
        place = ("$-$" if self.signed else "") + "0" * self.digits
        # What follows begins where the digits end, and bold ones end later.
        mark = r"\textbf{%s}" if cell.best else style or "%s"
        shown = self._marked(cell, place, _sign(whole), point + decimal, after, mark)
        room = rf"\phantom{{{self.after}}}" if self.after else ""
        return f"{{{shown}{room}}}"

    def _marked(
        self, cell: Cell, place: str, whole: str, fraction: str, after: str, mark: str
    ) -> str:
        behind = rf"\rlap{{{after}}}" if after else ""
        if cell.second:
            return rf"\phantom{{{place}{fraction}}}\llap{{\underline{{{whole}{fraction}}}}}{behind}"
        before = rf"\phantom{{{place}}}\llap{{{mark % whole}}}"
        if not fraction:
            return before + behind
        return before + rf"\rlap{{{mark % fraction}{after}}}\phantom{{{fraction}}}"


def _sign(whole: str) -> str:
    return rf"$-${whole[1:]}" if whole.startswith("-") else whole.replace("<", "$<$")


def number_format(cells: Sequence[Cell], decimals: int) -> NumberFormat:
    """Return the format that takes every number of a column."""
    texts = [cell.text(decimals).lstrip("<") for cell in cells if is_number(cell)]
    widest = max(cells, key=lambda cell: len(" ".join(cell.suffix(decimals))), default=None)
    return NumberFormat(
        max((len(text.lstrip("-").partition(".")[0]) for text in texts), default=1),
        decimals,
        any(text.startswith("-") for text in texts),
        "" if widest is None else suffix_text(widest, decimals, _GAP),
    )


def suffix_text(cell: Cell, decimals: int, gap: str = " ") -> str:
    """Return what follows a value behind a gap: uncertainty, then gain in grey."""
    parts = " ".join(map(_suffix_part, cell.suffix(decimals)))
    return f"{gap}{parts}" if parts else ""


def _suffix_part(text: str) -> str:
    if text.startswith("("):
        return rf"{{\color{{gray}}({math_minus(escape(text[1:-1]))})}}"
    return " ".join(math_minus(escape(part)) for part in text.split())


def is_number(cell: Cell) -> bool:
    """Whether a cell holds a finite number, not too wide, which siunitx can align."""
    return isinstance(cell.value, float) and not is_wide(cell.value)
