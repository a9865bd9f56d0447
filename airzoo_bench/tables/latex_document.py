"""A document around a tabular, so that it compiles by itself."""

from __future__ import annotations

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
% Here is no bibliography: keys are printed instead of numbers.
\renewcommand{\cite}[1]{[\detokenize{#1}]}
"""
_BEGIN = r"""\newsavebox{\tablebox}
\begin{document}
\begin{lrbox}{\tablebox}
"""
_END = r"""\end{lrbox}
\ifdim\wd\tablebox>\linewidth
  \sbox{\tablebox}{\resizebox{\linewidth}{!}{\usebox{\tablebox}}}
\fi
\ifdim\dimexpr\ht\tablebox+\dp\tablebox\relax>\textheight
  \sbox{\tablebox}{\resizebox*{!}{\textheight}{\usebox{\tablebox}}}
\fi
\usebox{\tablebox}
\end{document}
"""


def document(tabular: str) -> str:
    """Return a whole document: a page with the table, shrunk to the page where it is larger."""
    letters = sorted({c for c in tabular if ord(c) > 127})
    return _HEAD + "".join(map(_stand_in, letters)) + _BEGIN + tabular + _END


def _stand_in(letter: str) -> str:
    """Let pdfLaTeX print the code of a letter that it does not know, instead of stopping."""
    code = f"{ord(letter):04X}"
    known = rf"\ifcsname u8:\detokenize{{{letter}}}\endcsname"
    return rf"\ifdefined\DeclareUnicodeCharacter{known}\else\DeclareUnicodeCharacter{{{code}}}" + (
        rf"{{[U+{code}]}}\fi\fi" + "\n"
    )
