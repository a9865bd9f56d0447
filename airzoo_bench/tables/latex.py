"""Tables for LaTeX: booktabs, groups in blocks, on demand siunitx and a whole document.

Everything that strangers wrote is escaped. ``booktabs`` is needed, ``xcolor`` with its option
``table`` for coloured rows, gains and floors, and what the style asks for.

Blocks of different tracks are tabulars of their own. What the numbers must not be read without
stands under them; it is broken into lines here, since a tabular does not know its width.
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from itertools import groupby

from airzoo_bench.tables.blocks import by_block, by_count, leading_columns
from airzoo_bench.tables.latex_float import LatexStyle, document, needs, stacked
from airzoo_bench.tables.latex_text import (
    NumberFormat,
    escape,
    is_number,
    math_minus,
    number_format,
    suffix_text,
    text_width,
)
from airzoo_bench.tables.model import Cell, Column, Row, Table, plain

__all__ = ["LatexStyle", "latex"]

_DAGGER = escape("†")
_HIGHLIGHT = r"\rowcolor{yellow!25}"
_FLOOR = r"\textit{\color{gray}%s}"

# Digits of the table are wider than letters of its notes, and two gaps as wide as five letters.
_PER_LETTER = 1.25
_PER_GAP = 2.5
_CITATION = len("[12]")
_SHORTEST = 30


@dataclass(frozen=True)
class _Piece:
    """A block: its table, the columns before the first score, and what it is set in.

    A score takes `span` columns of the tabular, which has `width` columns; `types` are of the
    block's own columns, `formats` of those that siunitx aligns.
    """

    table: Table
    leading: int
    span: int
    width: int
    types: list[str]
    formats: dict[int, NumberFormat]

    @property
    def unused(self) -> int:
        own = len(self.table.columns) - self.leading
        return self.width - self.leading - own * self.span


def latex(table: Table, style: LatexStyle | None = None) -> str:
    """Lay out a table as a ``tabular``, or several of them where blocks must stand apart.

    A last block with fewer groups is stretched to the full width where that is a multiple of its
    own, as the paper has it for an average.
    """
    chosen = style or LatexStyle()
    comments = [plain(table.title), *(note for note in table.notes if note not in table.legend)]
    preamble = needs(table, chosen) + "".join(f"% {plain(line)}\n" for line in comments)
    tabulars = [_tabular(part, chosen) for part in by_block(table)]
    if chosen.standalone:
        return document(preamble, tabulars)
    return preamble + stacked(table, tabulars, chosen)


def _tabular(table: Table, style: LatexStyle) -> str:
    pieces = _pieces(table, style)
    widest = max(pieces, key=lambda piece: len(piece.types))
    lines = [rf"\begin{{tabular}}{{{''.join(widest.types)}}}", r"\toprule"]
    for number, piece in enumerate(pieces):
        lines += [r"\midrule"] * bool(number)
        lines += [*_group_lines(piece), _title_line(piece), r"\midrule", *_body(piece)]
    lines += [r"\bottomrule", *_legend(table, pieces), r"\end{tabular}"]
    return "\n".join(lines) + "\n"


def _legend(table: Table, pieces: list[_Piece]) -> list[str]:
    legend = [*table.dagger_note, *(note for note in table.notes if note in table.legend)]
    if not legend:
        return []
    room = max(_SHORTEST, *(_letters(piece.table) for piece in pieces))
    lines = [
        line for note in legend for line in textwrap.wrap(plain(note), room, break_on_hyphens=False)
    ]
    inner = r" \\ ".join(map(escape, lines))
    return [
        r"\addlinespace[2pt]",
        rf"\multicolumn{{{pieces[0].width}}}{{@{{}}l@{{}}}}"
        rf"{{\footnotesize\begin{{tabular}}{{@{{}}l@{{}}}}{inner}\end{{tabular}}}} \\",
    ]


def _letters(table: Table) -> int:
    """Estimate how many letters of a footnote are as wide as a table."""
    titles = [column.title + column.title_suffix for column in table.columns]
    widest = [max(map(len, texts)) for texts in zip(titles, *table.texts(), strict=True)]
    widest[0] += _CITATION * any(row.cells[0].cite for row in table.rows)
    return round(_PER_LETTER * sum(widest) + _PER_GAP * (len(widest) - 1))


def _pieces(table: Table, style: LatexStyle) -> list[_Piece]:
    tables = by_count(table)
    leading = leading_columns(table)
    room = max(len(piece.columns) for piece in tables) - leading
    cells = [cell for row in table.rows for cell in row.cells]
    # With something next to the numbers these are centred, as in the paper.
    centred = any(cell.gain is not None or cell.uncertainty for cell in cells)
    pieces = []
    for piece in tables:
        own = len(piece.columns) - leading
        span = room // own if own and room % own == 0 else 1
        types, formats = _types(tables, piece, "c" if centred else "r", style)
        pieces.append(_Piece(piece, leading, span, leading + room, types, formats))
    return pieces


def _types(
    tables: list[Table], piece: Table, number: str, style: LatexStyle
) -> tuple[list[str], dict[int, NumberFormat]]:
    leading = leading_columns(piece)
    types, formats = [], {}
    for index in range(len(piece.columns)):
        same = [one for one in tables if index < len(one.columns)]
        if any(one.is_text(index) for one in same):
            types.append("l")
        elif style.siunitx and index >= leading:
            cells = [row.cells[index] for one in same for row in one.rows]
            decimals = max(one.columns[index].decimals for one in same)
            formats[index] = number_format(cells, decimals)
            types.append(formats[index].column)
        else:
            types.append(
                ("c" if _stands_alone(piece, index) else number) * (index >= leading) or "r"
            )
    return types, formats


def _stands_alone(piece: Table, index: int) -> bool:
    """Whether a column is its whole group, and the title of such a one is wider than it."""
    groups = [column.group for column in piece.columns]
    lone = [c for c in piece.columns if c.group and groups.count(c.group) == 1]
    return piece.columns[index] in lone and any(
        text_width(c.group, bold=True) > text_width(c.heading, bold=True) for c in lone
    )


def _group_lines(piece: _Piece) -> list[str]:
    columns = piece.table.columns[piece.leading :]
    if not any(column.group for column in columns):
        return []
    titles, rules, at = [""] * piece.leading, [], piece.leading + 1
    for group, members in groupby(columns, key=lambda column: column.group):
        width = len(list(members)) * piece.span
        named = rf"\multicolumn{{{width}}}{{c}}{{{_bold(escape(group))}}}"
        titles += [named] if group else [""] * width
        rules += [rf"\cmidrule(lr){{{at}-{at + width - 1}}}"] if group else []
        at += width
    return [_line(piece, titles), "".join(rules)]


def _title_line(piece: _Piece) -> str:
    titles = []
    for index, column in enumerate(piece.table.columns):
        suffix = escape(column.title_suffix)
        text = _bold(escape(column.title)) + f" {suffix}" * bool(suffix)
        # The room of what follows the numbers stays free, so that a title is above these.
        if index in piece.formats and piece.formats[index].after:
            text += rf"\phantom{{{piece.formats[index].after}}}"
        titles.append(_spanned(piece, index, _braced(piece, index, text), "c"))
    return _line(piece, titles)


def _body(piece: _Piece) -> list[str]:
    lines = []
    for above, row in zip((None, *piece.table.rows), piece.table.rows, strict=False):
        lines += [r"\midrule"] * row.is_apart(above)
        lines += [_HIGHLIGHT] * row.highlighted
        cells = zip(row.cells, piece.table.columns, strict=True)
        texts = [_cell(piece, index, *pair, row) for index, pair in enumerate(cells)]
        lines.append(_line(piece, texts))
    return lines


def _cell(piece: _Piece, index: int, cell: Cell, column: Column, row: Row) -> str:
    if index in piece.formats and is_number(cell):
        text = piece.formats[index].cell(cell, column.decimals, _FLOOR if row.floor else "")
    else:
        value = math_minus(escape(cell.text(column.decimals)))
        shown = rf"\underline{{{value}}}" if cell.second else _bold(value) if cell.best else value
        shown = _FLOOR % shown if row.floor else shown
        text = _braced(piece, index, shown + suffix_text(cell, column.decimals))
    if index == 0:
        text += rf"~\cite{{{cell.cite}}}" if cell.cite else ""
        text += _DAGGER if row.reported else ""
    return _spanned(piece, index, text, piece.types[index])


def _braced(piece: _Piece, index: int, text: str) -> str:
    return f"{{{text}}}" if index in piece.formats else text


def _spanned(piece: _Piece, index: int, text: str, kind: str) -> str:
    if piece.span == 1 or index < piece.leading:
        return text
    return rf"\multicolumn{{{piece.span}}}{{{kind if kind[0] == 'S' else 'c'}}}{{{text}}}"


def _bold(text: str) -> str:
    return rf"\textbf{{{text}}}"


def _line(piece: _Piece, cells: list[str]) -> str:
    return " & ".join([*cells, *[""] * piece.unused]).rstrip() + r" \\"
