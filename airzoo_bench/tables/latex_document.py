"""A document around a tabular, so that it compiles by itself."""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["document"]

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


def document(head: str, tabulars: Sequence[str]) -> str:
    """Return a whole document: a page a tabular, which is shrunk to the page where it is larger.

    Parameters
    ----------
    head : str
        Lines of comments.
    tabulars : sequence of str
    """
    letters = sorted({c for c in head + "".join(tabulars) if ord(c) > 127})
    pages = "\\clearpage\n".join(f"{_OPEN}{tabular}{_CLOSE}" for tabular in tabulars)
    return head + _HEAD + "".join(map(_stand_in, letters)) + _BEGIN + pages + _END


def _stand_in(letter: str) -> str:
    """Let pdfLaTeX print the code of a letter that it does not know, instead of stopping."""
    code = f"{ord(letter):04X}"
    known = rf"\ifcsname u8:\detokenize{{{letter}}}\endcsname"
    return rf"\ifdefined\DeclareUnicodeCharacter{known}\else\DeclareUnicodeCharacter{{{code}}}" + (
        rf"{{[U+{code}]}}\fi\fi" + "\n"
    )
