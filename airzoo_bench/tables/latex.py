"""Tables for LaTeX: booktabs, groups in blocks, on demand siunitx and a whole document.

Everything that strangers wrote is escaped, and nothing but ``booktabs`` is needed unless the table
has coloured rows or gains (``xcolor`` with its option ``table``) or the style asks for ``siunitx``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import groupby

from airzoo_bench.tables.blocks import by_count, leading_columns
from airzoo_bench.tables.latex_document import document
from airzoo_bench.tables.latex_text import escape, math_minus
from airzoo_bench.tables.model import REPORTED, Cell, Column, Row, Table, plain

__all__ = ["LatexStyle", "latex"]

_DAGGER = escape("†")
_HIGHLIGHT = r"\rowcolor{yellow!25}"


@dataclass(frozen=True)
class LatexStyle:
    """How a table is typeset.

    Attributes
    ----------
    siunitx : bool
        Align numbers at their points.
    standalone : bool
        A document that compiles by itself, instead of a ``tabular``.
    """

    siunitx: bool = False
    standalone: bool = False


@dataclass(frozen=True)
class _Piece:
    """A block: its table, the columns before the first score, and what it is set in.

    A score takes `span` columns of the tabular, which has `width` columns; `types` are of the
    block's own columns.
    """

    table: Table
    leading: int
    span: int
    width: int
    types: list[str]

    @property
    def unused(self) -> int:
        own = len(self.table.columns) - self.leading
        return self.width - self.leading - own * self.span


def latex(table: Table, style: LatexStyle | None = None) -> str:
    """Lay out a table as a ``tabular``.

    A last block with fewer groups is stretched to the full width where that is a multiple of its
    own, as the paper has it for an average.

    Parameters
    ----------
    table : Table
    style : LatexStyle, optional
    """
    chosen = style or LatexStyle()
    pieces = _blocks(table, chosen)
    widest = max(pieces, key=lambda piece: len(piece.types))
    lines = [
        "% " + plain(table.title),
        *("% " + plain(note) for note in table.all_notes),
        *_needs(table, chosen),
        rf"\begin{{tabular}}{{{''.join(widest.types)}}}",
        r"\toprule",
    ]
    for number, piece in enumerate(pieces):
        lines += [r"\midrule"] * bool(number)
        lines += [*_group_heads(piece), _head(piece), r"\midrule", *_body(piece)]
    lines += [r"\bottomrule", *_legend(table, widest.width), r"\end{tabular}"]
    text = "\n".join(lines) + "\n"
    return document(text) if chosen.standalone else text


def _needs(table: Table, style: LatexStyle) -> list[str]:
    gains = any(cell.gain is not None for row in table.rows for cell in row.cells)
    packages = [r"\usepackage{booktabs}"]
    if gains or any(row.highlighted for row in table.rows):
        packages.append(r"\usepackage[table]{xcolor}")
    if style.siunitx:
        packages.append(r"\usepackage{siunitx}")
    return ["% needs " + " ".join(packages)] if len(packages) > 1 else []


def _legend(table: Table, width: int) -> list[str]:
    if not any(row.reported for row in table.rows):
        return []
    return [rf"\multicolumn{{{width}}}{{l}}{{\footnotesize {_DAGGER} {escape(REPORTED)}}} \\"]


def _blocks(table: Table, style: LatexStyle) -> list[_Piece]:
    tables = by_count(table)
    leading = leading_columns(table)
    room = max(len(piece.columns) for piece in tables) - leading
    pieces = []
    for piece in tables:
        own = len(piece.columns) - leading
        span = room // own if own and room % own == 0 else 1
        pieces.append(_Piece(piece, leading, span, leading + room, _types(tables, piece, style)))
    return pieces


def _types(tables: list[Table], piece: Table, style: LatexStyle) -> list[str]:
    # With something beside the numbers these are centred, as in the paper.
    cells = [cell for one in tables for row in one.rows for cell in row.cells]
    number = "c" if any(c.gain is not None or c.uncertainty for c in cells) else "r"
    types = ["l"] + [number] * (len(piece.columns) - 1)
    for index in range(leading_columns(piece), len(types)):
        if style.siunitx:
            types[index] = _siunitx(tables, index)
    return types


def _siunitx(tables: list[Table], index: int) -> str:
    """Return the format that takes every number at one place of all blocks."""
    cells = [row.cells[index] for one in tables for row in one.rows if index < len(row.cells)]
    numbers = [
        cell.value for cell in cells if isinstance(cell.value, float) and math.isfinite(cell.value)
    ]
    decimals = max(one.columns[index].decimals for one in tables if index < len(one.columns))
    digits = max((len(f"{abs(v):.{decimals}f}".split(".")[0]) for v in numbers), default=1)
    sign = "-" if any(value < 0 for value in numbers) else ""
    after = max((_after(cell, decimals) for cell in cells), key=len, default="")
    room = f",table-space-text-post={{{after}}}" if after else ""
    return f"S[detect-weight,table-format={sign}{digits}.{decimals}{room}]"


def _after(cell: Cell, decimals: int) -> str:
    return "".join(map(_beside, cell.beside(decimals)))


def _group_heads(piece: _Piece) -> list[str]:
    columns = piece.table.columns[piece.leading :]
    if not any(column.group for column in columns):
        return []
    heads, rules, at = [""] * piece.leading, [], piece.leading + 1
    for group, members in groupby(columns, key=lambda column: column.group):
        width = len(list(members)) * piece.span
        heads.append(rf"\multicolumn{{{width}}}{{c}}{{{_bold(escape(group))}}}" if group else "")
        rules += [rf"\cmidrule(lr){{{at}-{at + width - 1}}}"] if group else []
        at += width
    return [_line(piece, heads), "".join(rules)]


def _head(piece: _Piece) -> str:
    heads = []
    for index, column in enumerate(piece.table.columns):
        text = _bold(escape(column.title)) + _beside_title(column)
        heads.append(_spanned(piece, index, _braced(piece, index, text), "c"))
    return _line(piece, heads)


def _beside_title(column: Column) -> str:
    beside = escape(column.beside_title)
    return f" {beside}" if beside else ""


def _body(piece: _Piece) -> list[str]:
    lines = []
    previous = False
    for row in piece.table.rows:
        if row.summary and not previous:
            lines.append(r"\midrule")
        previous = row.summary
        lines += [_HIGHLIGHT] * row.highlighted
        cells = zip(row.cells, piece.table.columns, strict=True)
        texts = [_cell(piece, index, *pair, row) for index, pair in enumerate(cells)]
        lines.append(_line(piece, texts))
    return lines


def _cell(piece: _Piece, index: int, cell: Cell, column: Column, row: Row) -> str:
    text = math_minus(escape(cell.text(column.decimals)))
    beside = _after(cell, column.decimals)
    if _is_aligned(piece, index) and _is_number(cell) and not cell.second:
        number = cell.text(column.decimals)
        weight = r"\bfseries " if cell.best else ""
        text = weight + number + (rf"{{\mdseries{{}}{beside}}}" if beside else "")
    else:
        shown = rf"\underline{{{text}}}" if cell.second else _bold(text) if cell.best else text
        text = _braced(piece, index, shown + beside)
    if index == 0:
        text += rf"~\cite{{{cell.cite}}}" if cell.cite else ""
        text += _DAGGER if row.reported else ""
    return _spanned(piece, index, text, piece.types[index])


def _beside(text: str) -> str:
    if text.startswith("("):
        return rf" {{\color{{gray}}({math_minus(escape(text[1:-1]))})}}"
    return " " + " ".join(math_minus(escape(part)) for part in text.split())


def _is_number(cell: Cell) -> bool:
    return isinstance(cell.value, float) and math.isfinite(cell.value)


def _is_aligned(piece: _Piece, index: int) -> bool:
    return piece.types[index].startswith("S")


def _braced(piece: _Piece, index: int, text: str) -> str:
    return f"{{{text}}}" if _is_aligned(piece, index) else text


def _spanned(piece: _Piece, index: int, text: str, kind: str) -> str:
    if piece.span == 1 or index < piece.leading:
        return text
    return rf"\multicolumn{{{piece.span}}}{{{kind if kind[0] == 'S' else 'c'}}}{{{text}}}"


def _bold(text: str) -> str:
    return rf"\textbf{{{text}}}"


def _line(piece: _Piece, cells: list[str]) -> str:
    return " & ".join([*cells, *[""] * piece.unused]).rstrip() + r" \\"
