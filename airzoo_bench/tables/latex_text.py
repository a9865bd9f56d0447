"""Text for LaTeX: what strangers wrote typesets as itself and commands nothing."""

from __future__ import annotations

import re

__all__ = ["escape", "math_minus"]

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
