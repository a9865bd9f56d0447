"""Tables for LaTeX: booktabs, groups in blocks.

Everything that strangers wrote is escaped. ``booktabs`` is needed, ``xcolor`` with its option
``table`` for coloured rows, gains and floors, and ``graphicx`` to shrink a table.

Blocks of different tracks are tabulars of their own. What the numbers must not be read without
stands under them; it is broken into lines here, since a tabular does not know its width.
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from itertools import groupby

from airzoo_bench.tables.blocks import by_block, by_count, leading_columns
from airzoo_bench.tables.latex_text import (
    COLUMN,
    PAGE,
    escape,
    latex_width,
    math_minus,
    suffix_text,
    text_width,
)
from airzoo_bench.tables.model import Cell, Column, Row, Table, plain

__all__ = ["latex"]

_DAGGER = escape("†")
_HIGHLIGHT = r"\rowcolor{yellow!25}"
_FLOOR = r"\textit{\color{gray}%s}"
# By TeX itself, which alone knows the width: graphicx gives that of the content as \width.
_SHRINK = r"\resizebox{\ifdim\width>\linewidth\linewidth\else\width\fi}{!}{%"

# Digits of the table are wider than letters of its notes, and two gaps as wide as five letters.
_PER_LETTER = 1.25
_PER_GAP = 2.5
_CITATION = len("[12]")
_SHORTEST = 30


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


def latex(table: Table, *, fit: bool = False) -> str:
    """Lay out a table as a ``tabular``, or several of them where blocks must stand apart."""
    comments = [plain(table.title), *(note for note in table.notes if note not in table.legend)]
    preamble = _needs(table, fit) + "".join(f"% {plain(line)}\n" for line in comments)
    parts = by_block(table)
    shown = []
    for part in parts:
        tabular = f"{_SHRINK}\n{_tabular(part)}}}\n" if fit else _tabular(part)
        shown.append(_use(part, fit, alone=len(parts) == 1) + tabular)
    return preamble + "\n\\medskip\n".join(shown)


def _needs(table: Table, fit: bool) -> str:
    """Return the comment that names the packages without which a table does not compile."""
    gains = any(cell.gain is not None for row in table.rows for cell in row.cells)
    packages = [r"\usepackage{booktabs}"]
    if gains or any(row.highlighted or row.floor for row in table.rows):
        packages.append(r"\usepackage[table]{xcolor}")
    if fit:
        packages.append(r"\usepackage{graphicx}")
    return f"% needs {' '.join(packages)}\n"


def _use(table: Table, fit: bool, *, alone: bool) -> str:
    """Say how wide a tabular is by estimate, and how to put it into a paper."""
    width = max(map(latex_width, by_count(table)))
    inner = r"\input{table.tex}" if alone else r"... \input{table.tex}"
    environment = "table" if width <= COLUMN else "table*"
    used = rf"\begin{{{environment}}}\centering {inner}\end{{{environment}}}"
    too_wide = ", more than a page" + " (--fit shrinks it)" * (not fit)
    return f"% about {width:.0f} em wide{too_wide * (width > PAGE)}: {used}\n"


def _tabular(table: Table) -> str:
    pieces = _pieces(table)
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


def _pieces(table: Table) -> list[_Piece]:
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
        types = _types(tables, piece, "c" if centred else "r")
        pieces.append(_Piece(piece, leading, span, leading + room, types))
    return pieces


def _types(tables: list[Table], piece: Table, number: str) -> list[str]:
    leading = leading_columns(piece)
    types = []
    for index in range(len(piece.columns)):
        same = [one for one in tables if index < len(one.columns)]
        if any(one.is_text(index) for one in same):
            types.append("l")
        else:
            types.append(
                ("c" if _stands_alone(piece, index) else number) * (index >= leading) or "r"
            )
    return types


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
        titles.append(_spanned(piece, index, text))
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
    value = math_minus(escape(cell.text(column.decimals)))
    shown = rf"\underline{{{value}}}" if cell.second else _bold(value) if cell.best else value
    text = (_FLOOR % shown if row.floor else shown) + suffix_text(cell, column.decimals)
    if index == 0:
        text += rf"~\cite{{{cell.cite}}}" if cell.cite else ""
        text += _DAGGER if row.reported else ""
    return _spanned(piece, index, text)


def _spanned(piece: _Piece, index: int, text: str) -> str:
    if piece.span == 1 or index < piece.leading:
        return text
    return rf"\multicolumn{{{piece.span}}}{{c}}{{{text}}}"


def _bold(text: str) -> str:
    return rf"\textbf{{{text}}}"


def _line(piece: _Piece, cells: list[str]) -> str:
    return " & ".join([*cells, *[""] * piece.unused]).rstrip() + r" \\"
