"""What stands in one field of a table: a number, and its marks (bold, percent sign, gain)."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import lru_cache

from airzoo_bench.tables.printed.latex_source import without_macro
from airzoo_bench.tables.printed.numbers import MOST_DECIMALS, Rounded, parse_number

__all__ = ["Marked", "arrow", "is_no_number", "plain_name", "read_loosely", "read_marked"]

_BOLD = re.compile(r"\\(?:textbf|mathbf|boldsymbol|bm|bfseries|bf)\b|\*\*|__|</?(?:b|strong)>")
_QUIET = re.compile(
    r"\\(?:textcolor|color|cellcolor|rowcolor|colorbox|rotatebox|scalebox|raisebox|fontsize)"
    r"(?:\[[^][]*\])?\{[^{}]*\}"
    r"|\\(?:underline|uline|uuline|dashuline|textit|textsl|textsc|texttt|emph|it|em|sc|text|mathrm"
    r"|mathit|scriptsize|tiny|small|footnotesize|normalsize|large|selectfont|textsubscript"
    r"|textsuperscript|llap|rlap|mbox|makecell|shortstack|thead|textnormal|textrm|num|ensuremath"
    r"|xspace|centering|strut|left|right|hl|protect)(?![a-zA-Z])\*?(?:\[[lcrtbm]\])?"
    r"|</?(?:u|i|em|sub|sup|small)>"
)
_BLANK = re.compile(
    r"\\(?:enspace|enskip|quad|qquad|hfill|hfil|null|,|;|!|:| |\\)|\\[hv]space\*?\{[^{}]*\}"
)
# Grey is what stands next to a comparison, such as an upper bound.
_MUTED = re.compile(
    r"[\s{]*\\(?:text)?color(?:\[[^][]*\])?\{(?:\w*gr[ae]y\w*(?:![0-9]+)?|black![0-9]+)\}"
)
# A paper's own macro around a number alone, such as \best{96.21}.
_OWN = re.compile(r"\\[A-Za-z]+\s*\{[\s{]*([+-]?[0-9.,]+ ?%?)[\s}]*\}")
_INTERVAL = re.compile(r"\s*\[[+-]?[0-9.,]+[,;] ?[+-]?[0-9.,]+\]")
_NO_NUMBER = re.compile(r"[-–—−\s]*|n/?a|inf|infinity|∞|\\infty", re.IGNORECASE)
_SPELLED = {
    r"\uparrow": "↑",
    r"\downarrow": "↓",
    r"\rightarrow": "→",
    r"\leftarrow": "←",
    r"\leftrightarrow": "↔",
    r"\to": "→",
    r"\Delta": "Δ",
    r"\degree": "°",
    r"\textdegree": "°",
    r"\pm": "±",
    r"\times": "×",
    r"\ast": "*",
    r"^\circ": "°",
    r"^{\circ}": "°",
    r"\dagger": "†",
    r"\ddagger": "‡",
    r"\infty": "∞",
    r"\textasciitilde": "~",
    r"\textasciicircum": "^",
    r"\textless": "<",
    r"\textgreater": ">",
    r"\textbar": "|",
    r"\textbackslash": "\\",
}
_CITED = re.compile(
    r"(?<![~\s])[~\s]*\\(?:cite[a-z]*|footnote(?:mark)?|tablefootnote|tnote)\*?"
    r"(?:\[[^]]*\])*(?:\{[^}]*\}|(?<=\]))"
)
_SIGNS = str.maketrans({"−": "-", "–": "-", "~": " ", "\u00a0": " ", "\u202f": " "})
_VALUE = re.compile(r"([+-]?[0-9.,]+) ?(%?)")
# A colour may hold digits, as gray!15.
_COLOUR = re.compile(r"\\(?:text|cell|row)?color(?:\[[^][]*\])?\{[^{}]*\}")
# What follows a number and says nothing of it: footnotes, a deviation.
_LOOSE = re.compile(r"(?:[†‡*§¶^ ]|\^[a-e1-9]\b|[±] ?[0-9.,]+%?|\([0-9.,]+ ?%?\))+")
# A gain is told by its sign: a number in brackets without one may be a deviation.
_GAIN = re.compile(r"(?:\(([+\-↑↓] ?[0-9.,]+) ?%?\)|([+\-↑↓] ?[0-9.,]+) ?%?)")
_THOUSANDS = re.compile(r"[+-]?[1-9][0-9]{0,2},[0-9]{3}")
# With all its marks and colours a number is no longer; longer ones are made to take long.
_LONGEST = 1000
_MACROS = re.compile(rf"({'|'.join(map(re.escape, _SPELLED))})(?![a-zA-Z])(?:\{{\}})?")


@dataclass(frozen=True)
class Marked:
    """A printed number with its marks.

    Attributes
    ----------
    gain : Rounded or None
        The difference that stands next to it, with a sign.
    muted : bool
        Printed in grey, so that it does not compete.
    """

    number: Rounded
    gain: Rounded | None
    bold: bool
    percent: bool
    muted: bool = False


def read_marked(text: str) -> Marked | str:
    r"""Read a field such as ``96.21``, ``96,21%``, ``**96.21**`` or ``\textbf{96.21} (+1.73)``.

    Returns
    -------
    Marked or str
        What is wrong with it, where it is no such thing.
    """
    if len(text) > _LONGEST:
        return f"{text[:80]!r} is no printed number"
    return _read_marked(text)


# The header of a table, its layout and its numbers are told by what its fields are.
@lru_cache(maxsize=4096)
def _read_marked(text: str) -> Marked | str:
    sentence, value, number, rest = _parts(text)
    if value is None or number is None:
        return _what_is_wrong(sentence, value[1] if value else "")
    gain = _gain(rest)
    if rest and gain is None:
        return f"what is {rest[:40]!r} after the number? a gain has a sign, as in 96.21 (+1.73)"
    return _marked(text, number, gain, percent=bool(value[2]))


def _parts(text: str) -> tuple[str, re.Match[str] | None, Rounded | None, str]:
    """Return a field without marks, the match and number it begins with, and what follows."""
    sentence = " ".join(_without_marks(text).split())
    value = _VALUE.match(sentence)
    if value is None:
        return sentence, None, None, ""
    return sentence, value, _number(value[1]), _INTERVAL.sub("", sentence[value.end() :]).strip()


def _marked(text: str, number: Rounded, gain: Rounded | None, *, percent: bool) -> Marked:
    shown = _COLOUR.sub("", without_macro(text, "phantom"))
    muted = bool(_MUTED.match(without_macro(text, "phantom")))
    bold = _BOLD.search(shown)
    first_digit = re.search(r"[0-9]", shown)
    is_bold = bool(bold and first_digit and bold.start() < first_digit.start())
    return Marked(number, gain, is_bold, percent, muted)


def read_loosely(text: str) -> Marked | None:
    """Read a field of a table that is taken as it stands: footnotes and deviations are left out.

    Returns
    -------
    Marked or None
        None where it is no number with such things behind it.
    """
    if len(text) > _LONGEST:
        return None
    _, value, number, rest = _parts(text)
    if value is None or number is None:
        return None
    gain = _gain(_LOOSE.sub("", rest, count=1).strip()) or _gain(rest)
    if gain is None and not _LOOSE.fullmatch(rest):
        return None
    return _marked(text, number, gain, percent=bool(value[2]))


def arrow(text: str) -> str:
    """Return the arrow of a name that says which direction is better; empty without one."""
    arrows = set(_spelled(text[:_LONGEST])) & {"↑", "↓"}
    return arrows.pop() if len(arrows) == 1 else ""


def is_no_number(text: str) -> bool:
    """Whether a field is empty, a dash, or an infinite error: nothing that arithmetic reads."""
    return bool(_NO_NUMBER.fullmatch(text.strip("${} ")))


def _without_marks(text: str) -> str:
    plain = _spelled(without_macro(text, "phantom")).translate(_SIGNS)
    plain = plain.replace("--", "-").replace("\\%", "%")
    plain = _QUIET.sub("", _CITED.sub("", _BOLD.sub("", _BLANK.sub(" ", plain))))
    plain = _OWN.sub(r"\1", plain)
    return re.sub(r"[{}$]|(?<=\d)_(?=[+-])", "", plain).replace("_", " ")


def _spelled(text: str) -> str:
    return _MACROS.sub(lambda found: _SPELLED[found[1]], text)


def _number(text: str) -> Rounded | None:
    """Read a number with a point or, where that is certain, with a comma."""
    if text.count(",") == 1 and "." not in text and not _THOUSANDS.fullmatch(text):
        return parse_number(text.replace(",", "."))
    return parse_number(text)


def _gain(text: str) -> Rounded | None:
    found = _GAIN.fullmatch(text)
    if not found:
        return None
    sign = (found[1] or found[2]).replace(" ", "").replace("↑", "+").replace("↓", "-")
    number = _number(sign)
    return replace(number, text=f"{number.text}%") if number and "%" in text else number


def _what_is_wrong(text: str, number: str) -> str:
    if macro := re.search(r"\\[A-Za-z]+", text):
        return f"what is {macro[0][:40]!r} in {text[:80]!r}?"
    if _THOUSANDS.fullmatch(number):
        whole, _, part = number.partition(",")
        return f"{text[:80]!r} may be {whole}{part} or {whole}.{part}"
    decimals = number.replace(",", ".").partition(".")[2]
    if len(decimals) > MOST_DECIMALS and decimals.isdigit():
        return f"{text[:80]!r} has more than {MOST_DECIMALS} decimals"
    return f"{text[:80]!r} is no printed number"


def plain_name(text: str) -> str:
    """Return a name without bold, citations and the like."""
    plain = re.sub(r"(?<!\\)~", " ", _CITED.sub("", without_macro(text, "phantom")))
    plain = _QUIET.sub("", _BOLD.sub("", _BLANK.sub(" ", plain)))
    plain = re.sub(r"[↑↓]", "", _spelled(plain))
    plain = re.sub(r"(?<=\d)_(?=\{)|\^(?=[{°†‡*])", "", plain)
    return " ".join(re.sub(r"\\([&%_#$])", r"\1", re.sub(r"(?<!\\)[{}$]", "", plain)).split())
