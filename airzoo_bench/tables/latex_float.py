"""What stands around the tabulars of LaTeX: packages, a float, a shrunk box, or a document."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass

from airzoo_bench.core.errors import UsageError
from airzoo_bench.tables.blocks import by_block, by_count, leading_columns, units
from airzoo_bench.tables.latex_text import COLUMN, PAGE, escape, latex_width
from airzoo_bench.tables.model import Table

__all__ = ["LatexStyle", "check_style", "document", "needs", "options_of", "stacked"]

_LABEL = re.compile(r"[A-Za-z0-9][A-Za-z0-9:._/+-]*")
# By TeX itself, which alone knows the width: graphicx gives that of the content as \width.
_SHRINK = r"\resizebox{\ifdim\width>\linewidth\linewidth\else\width\fi}{!}{%"
_HEAD = r"""\documentclass{article}
\usepackage[utf8]{inputenc}
\usepackage[landscape,margin=1cm]{geometry}
\usepackage{graphicx}
\usepackage{booktabs}
\usepackage[table]{xcolor}
\usepackage{siunitx}
\pagestyle{empty}
\setlength{\parindent}{0pt}
\renewcommand{\arraystretch}{1.1}
% Here is no bibliography: keys are printed instead of numbers. The font has no underscore.
{\catcode`\_=12
\gdef\keyparts#1_#2\keyend{#1\ifx\relax#2\relax\else\_\keyparts#2\keyend\fi}
\gdef\cite#1{[\expandafter\keyparts\detokenize{#1}_\keyend]}}
"""
_BEGIN = r"""\newsavebox{\tablebox}
\begin{document}
"""
_OPEN = r"""\begin{lrbox}{\tablebox}
"""
_CLOSE = r"""\end{lrbox}
\ifdim\wd\tablebox>\linewidth
  \sbox{\tablebox}{\resizebox{\linewidth}{!}{\usebox{\tablebox}}}
\fi
\ifdim\dimexpr\ht\tablebox+\dp\tablebox\relax>\textheight
  \sbox{\tablebox}{\resizebox*{!}{\textheight}{\usebox{\tablebox}}}
\fi
\usebox{\tablebox}
"""
_END = r"""\end{document}
"""


@dataclass(frozen=True)
class LatexStyle:
    r"""How a table is typeset.

    Attributes
    ----------
    siunitx : bool
        Align numbers at their points.
    standalone : bool
        A document that compiles by itself, instead of a ``tabular``.
    caption : str
        Plain text above the table, which then is a float; empty for none.
    label : str
        What ``\ref`` takes; only with a caption.
    fit : bool
        Shrink what is wider than the line to the line.
    """

    siunitx: bool = False
    standalone: bool = False
    caption: str = ""
    label: str = ""
    fit: bool = False


def options_of(style: LatexStyle) -> dict[str, object]:
    """Return what a style sets, by the options of the command line."""
    return {f"--{name}": value for name, value in asdict(style).items()}


def check_style(style: LatexStyle) -> None:
    """Refuse a label that LaTeX does not take or that has no caption, and a float on a page.

    Raises
    ------
    UsageError
    """
    if style.label and not _LABEL.fullmatch(style.label):
        raise UsageError(
            f"{style.label[:80]!r} is no label",
            where="--label",
            expected="letters a to z, digits, and behind the first any of : . _ / + -",
        )
    if style.label and not style.caption:
        raise UsageError("--label needs --caption, whose number it refers to")
    if style.standalone and (style.caption or style.fit):
        raise UsageError(
            "--standalone makes pages, which fit by themselves, and no float",
            fix="leave out --standalone, or --caption, --label and --fit",
        )


def needs(table: Table, style: LatexStyle) -> str:
    """Return the comment that names the packages without which a table does not compile."""
    gains = any(cell.gain is not None for row in table.rows for cell in row.cells)
    packages = [r"\usepackage{booktabs}"]
    if gains or any(row.highlighted or row.floor for row in table.rows):
        packages.append(r"\usepackage[table]{xcolor}")
    if style.siunitx:
        packages.append(r"\usepackage{siunitx}")
    if style.fit:
        packages.append(r"\usepackage{graphicx}")
    return f"% needs {' '.join(packages)}\n"


def stacked(table: Table, tabulars: Sequence[str], style: LatexStyle) -> str:
    """Put a table's tabulars under each other: shrunk and in a float where that is asked for.

    Parameters
    ----------
    table : Table
    tabulars : sequence of str
        Of the table's blocks, in their order.
    style : LatexStyle
    """
    parts = by_block(table)
    uses = [_use(part, style, alone=len(parts) == 1) for part in parts]
    shown = [f"{_SHRINK}\n{text}}}\n" if style.fit else text for text in tabulars]
    body = "\n\\medskip\n".join(map("".join, zip(uses, shown, strict=True)))
    return _in_float(body, parts, style) if style.caption else body


def _in_float(body: str, parts: Sequence[Table], style: LatexStyle) -> str:
    environment = _environment(max(_width(part, style) for part in parts))
    label = rf"\label{{{style.label}}}" if style.label else ""
    return "\n".join(
        [
            rf"\begin{{{environment}}}",
            r"\centering",
            rf"\caption{{{escape(style.caption)}}}{label}",
            rf"{body}\end{{{environment}}}",
            "",
        ]
    )


def _environment(width: float) -> str:
    return "table" if width <= COLUMN else "table*"


def _width(table: Table, style: LatexStyle) -> float:
    return max(latex_width(piece, aligned=style.siunitx) for piece in by_count(table))


def _use(table: Table, style: LatexStyle, *, alone: bool) -> str:
    """Say how wide a tabular is by estimate, and how to put it into a paper."""
    width = _width(table, style)
    inner = r"\input{table.tex}" if alone else r"... \input{table.tex}"
    environment = _environment(width)
    used = rf"\begin{{{environment}}}\centering {inner}\end{{{environment}}}"
    said = f"about {width:.0f} em wide"
    if width > PAGE:
        said += ", more than a page" + ("" if style.fit else _narrower(table))
    return f"% {said}\n" if style.caption else f"% {said}: {used}\n"


def _narrower(table: Table) -> str:
    in_groups = all(column.group for column in table.columns[leading_columns(table) :])
    several = in_groups and max(map(len, map(units, by_count(table)))) > 1
    return " (--fit shrinks it" + (", --per-block 1 breaks it)" if several else ")")


def document(preamble: str, tabulars: Sequence[str]) -> str:
    """Return a whole document: a page a tabular, which is shrunk to the page where it is larger.

    Parameters
    ----------
    preamble : str
        Lines of comments.
    tabulars : sequence of str
    """
    letters = sorted({c for c in preamble + "".join(tabulars) if ord(c) > 127})
    pages = "\\clearpage\n".join(f"{_OPEN}{tabular}{_CLOSE}" for tabular in tabulars)
    return preamble + _HEAD + "".join(map(_stand_in, letters)) + _BEGIN + pages + _END


def _stand_in(letter: str) -> str:
    """Let pdfLaTeX print the code of a letter that it does not know, instead of stopping."""
    code = f"{ord(letter):04X}"
    known = rf"\ifcsname u8:\detokenize{{{letter}}}\endcsname"
    return rf"\ifdefined\DeclareUnicodeCharacter{known}\else\DeclareUnicodeCharacter{{{code}}}" + (
        rf"{{[U+{code}]}}\fi\fi" + "\n"
    )
