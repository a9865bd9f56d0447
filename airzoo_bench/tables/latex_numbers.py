"""Numbers of LaTeX tables: what stands beside them, and how all stand at one point for siunitx.

What siunitx is not told to parse it centres. It does not parse an underlined number, and sets a
bold one beside its place where bold digits are wider. So a marked number is set here, in a box of
the width that siunitx gives to any number of the column: that is centred at the same place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from airzoo_bench.tables.latex_text import escape, math_minus
from airzoo_bench.tables.model import Cell, is_wide

__all__ = ["NumberFormat", "beside", "is_number", "number_format"]

_GAP = r"\enspace{}"


@dataclass(frozen=True)
class NumberFormat:
    """How the numbers of a column are aligned.

    Attributes
    ----------
    digits, decimals : int
        The most before the point, and those after it.
    signed : bool
        Whether any is below zero.
    after : str
        The widest of what stands beside the numbers, as LaTeX.
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
        """Return a number with its mark, or in another style, and what stands beside it."""
        number, after = cell.text(decimals), beside(cell, decimals, _GAP)
        if not (cell.best or cell.second or style or number.startswith("<")):
            return number + (f"{{{after}}}" if after else "")
        whole, point, decimal = number.partition(".")
        place = ("$-$" if self.signed else "") + "0" * self.digits
        # What stands beside begins where the digits end, and bold ones end later.
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
    """Return the format that takes every number of a column.

    Parameters
    ----------
    cells : sequence of Cell
    decimals : int
    """
    texts = [cell.text(decimals).lstrip("<") for cell in cells if is_number(cell)]
    widest = max(cells, key=lambda cell: len(" ".join(cell.suffix(decimals))), default=None)
    return NumberFormat(
        max((len(text.lstrip("-").partition(".")[0]) for text in texts), default=1),
        decimals,
        any(text.startswith("-") for text in texts),
        "" if widest is None else beside(widest, decimals, _GAP),
    )


def beside(cell: Cell, decimals: int, gap: str = " ") -> str:
    """Return what stands beside a value behind a gap: uncertainty, then gain in grey."""
    parts = " ".join(map(_one_beside, cell.suffix(decimals)))
    return f"{gap}{parts}" if parts else ""


def _one_beside(text: str) -> str:
    if text.startswith("("):
        return rf"{{\color{{gray}}({math_minus(escape(text[1:-1]))})}}"
    return " ".join(math_minus(escape(part)) for part in text.split())


def is_number(cell: Cell) -> bool:
    """Whether a cell holds a finite number, not too wide, which siunitx can align."""
    return isinstance(cell.value, float) and not is_wide(cell.value)
