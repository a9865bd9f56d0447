"""Tables for LaTeX: booktabs, groups in blocks; everything that strangers wrote is escaped.

``booktabs`` is needed, and ``xcolor`` with its option ``table`` for coloured rows, gains and
floors; ``graphicx`` shrinks a wide one. Title and notes are comments, some of them feet too.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from itertools import groupby

from airzoo_bench.results.comparison import GUESS
from airzoo_bench.tables.model import Cell, Column, Row, Table, plain

_SPECIAL = {
    "\\": r"\textbackslash{}",
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
    "†": r"\textsuperscript{$\dagger$}",
    "‡": r"\textsuperscript{$\ddagger$}",
    "–": r"--",
}
_ROOMY = 8  # columns of scores that fit a line of a page
_FEET = re.compile("‡|no test is possible")
_LIGATURE = re.compile(r"([-,'])(?=\1)")


def escape(text: str) -> str:
    """Return a text as LaTeX source of one line, in which two hyphens are no dash."""
    apart = _LIGATURE.sub("\\1\0", " ".join(text.split()))
    source = "".join(_SPECIAL.get(c, f"\\{c}" if c in "&%$#_{}" else c) for c in apart)
    return source.replace("\0", "{}")


def _escape_number(text: str) -> str:
    """Escape a printed number, which may be between brackets, with a true minus."""
    return re.sub(r"^(\{\[\})?-(?=[0-9.]+[],]?$)", r"\1$-$", escape(text))


def _line(cells: Sequence[str]) -> str:
    return " & ".join(cells).rstrip() + r" \\"


def latex(table: Table) -> str:
    """Lay out a table as a ``tabular``: its pieces below each other, as wide as the widest."""
    begin = r"{\footnotesize\setlength{\tabcolsep}{3pt}" if table.narrow else ""
    table = table.narrow or table
    pieces, leading = table.pieces(), table.leading_columns
    room = max(len(piece.columns) for piece in pieces) - leading
    cells = [cell for row in table.rows for cell in row.cells]
    gains = any(cell.gain is not None for cell in cells)
    # With something next to the numbers these are centred, as in the paper.
    number = "c" if gains or any(cell.uncertainty for cell in cells) else "r"
    left = [any(i < len(p.columns) and p.is_text(i) for p in pieces) for i in range(leading + room)]
    types = ["l" if is_left else number if i >= leading else "r" for i, is_left in enumerate(left)]
    packages = r"\usepackage{booktabs}"
    if gains or any(row.highlighted or row.floor for row in table.rows):
        packages += r" \usepackage[table]{xcolor}"
    if room * (1 + (number == "c")) > _ROOMY:
        packages += r", and \usepackage{graphicx} for \resizebox{\linewidth}{!}{...} around it"
    comments = (f"needs {packages}", table.title, *table.all_notes)
    lines = [f"% {plain(comment)}" for comment in comments]
    lines += [rf"{begin}\begin{{tabular}}{{{''.join(types)}}}", r"\toprule"]
    for piece in pieces:
        own = len(piece.columns) - leading
        span = room // own if own and room % own == 0 else 1
        unused = [""] * (room - own * span)
        lines += [r"\midrule"] * (piece is not pieces[0])
        lines += [*_titles(piece, span, unused), r"\midrule", *_body(piece, span, unused)]
    lines += [r"\bottomrule", *_foot(table.all_notes, pieces, len(types))]
    return "\n".join(lines) + f"\n\\end{{tabular}}{'}' * bool(begin)}\n"


def _foot(notes: Sequence[str], pieces: Sequence[Table], columns: int) -> list[str]:
    """Return the notes on ‡ and on tests in lines as long as the longest of the table."""
    rows = (row for one in pieces for row in ([c.heading for c in one.columns], *one.texts()))
    width = max(55, *(len("  ".join(row)) for row in rows))
    feet = (plain(note.replace(GUESS, "")) for note in notes if _FEET.search(note))
    said = (line for foot in feet for line in textwrap.wrap(foot, width))
    return [rf"\multicolumn{{{columns}}}{{l}}{{\footnotesize {escape(line)}}} \\" for line in said]


def _titles(piece: Table, span: int, unused: list[str]) -> list[str]:
    leading = piece.leading_columns
    groups, rules, at = [""] * leading, "", leading + 1
    for group, members in groupby(piece.columns[leading:], key=lambda column: column.group):
        width = len(list(members)) * span
        name = rf"\multicolumn{{{width}}}{{c}}{{\textbf{{{escape(group)}}}}}"
        groups += [name] if group else [""] * width
        rules += rf"\cmidrule(lr){{{at}-{at + width - 1}}}" if group else ""
        at += width
    titles = []
    for index, column in enumerate(piece.columns):
        suffix = escape(column.heading.removeprefix(column.title))
        text = rf"\textbf{{{escape(column.title)}}} {suffix}".rstrip()
        is_wide = index >= leading and span > 1
        titles.append(rf"\multicolumn{{{span}}}{{c}}{{{text}}}" if is_wide else text)
    above = [_line([*groups, *unused]), rules] if piece.has_groups else []
    return [*above, _line([*titles, *unused])]


def _body(piece: Table, span: int, unused: list[str]) -> list[str]:
    lines, leading = [], piece.leading_columns
    for above, row in zip((None, *piece.rows), piece.rows, strict=False):
        lines += [r"\midrule"] * row.is_apart(above)
        lines += [r"\rowcolor{yellow!25}"] * row.highlighted
        texts = [_cell(*pair, row) for pair in zip(row.cells, piece.columns, strict=True)]
        texts[0] += rf"~\cite{{{row.cite}}}" * bool(row.cite) + escape("†") * bool(row.reported)
        if span > 1:
            texts[leading:] = [rf"\multicolumn{{{span}}}{{c}}{{{one}}}" for one in texts[leading:]]
        lines.append(_line([*texts, *unused]))
    return lines


def _cell(cell: Cell, column: Column, row: Row) -> str:
    value = _escape_number(cell.text(column.decimals))
    shown = rf"\textbf{{{value}}}" if cell.best else value
    parts = [rf"\textit{{\color{{gray}}{shown}}}" if row.floor else shown]
    for text in cell.suffix(column.decimals):
        if text.startswith("("):
            parts.append(rf"{{\color{{gray}}({_escape_number(text[1:-1])})}}")
        else:
            parts += map(_escape_number, text.split())
    return " ".join(parts)
