"""What stands in one field of a table: a number, and its marks (bold, percent sign, gain)."""

from __future__ import annotations

import re
from dataclasses import dataclass

from airzoo_bench.printed.numbers import MOST_DECIMALS, Rounded, parse_number

__all__ = ["Marked", "plain_name", "read_marked"]

_BOLD = re.compile(r"\\(?:textbf|mathbf|boldsymbol|bm|bfseries|bf)\b|\*\*|__|</?(?:b|strong)>")
_QUIET = re.compile(
    r"\\(?:textcolor|color|cellcolor)(?:\[[^]]*\])?\{[^}]*\}"
    r"|\\(?:underline|uline|textit|emph|text|mathrm|scriptsize|tiny|small|footnotesize|textsubscript"
    r"|textsuperscript)\b|</?(?:u|i|em|sub|sup|small)>"
)
_CITED = re.compile(r"[~\s]*\\cite[a-z]*\*?(?:\[[^]]*\])*\{[^}]*\}")
_SIGNS = str.maketrans({"−": "-", "–": "-", "~": " ", "\u00a0": " ", "\u202f": " "})
_VALUE = re.compile(r"([+-]?[0-9.,]+) ?(%?)")
# A gain is told by its sign: a number in brackets without one may be a deviation.
_GAIN = re.compile(r"(?:\(([+\-↑↓] ?[0-9.,]+) ?%?\)|([+\-↑↓] ?[0-9.,]+) ?%?)")
_THOUSANDS = re.compile(r"[+-]?[1-9][0-9]{0,2},[0-9]{3}")


@dataclass(frozen=True)
class Marked:
    """A printed number with its marks.

    Attributes
    ----------
    number : Rounded
    gain : Rounded or None
        The difference that stands beside it, with a sign.
    bold, percent : bool
    """

    number: Rounded
    gain: Rounded | None
    bold: bool
    percent: bool


def read_marked(text: str) -> Marked | str:
    r"""Read a field such as ``96.21``, ``96,21%``, ``**96.21**`` or ``\textbf{96.21} (+1.73)``.

    Returns
    -------
    Marked or str
        What is wrong with it, where it is no such thing.
    """
    sentence = " ".join(_without_marks(text).split())
    value = _VALUE.match(sentence)
    number = _number(value[1]) if value else None
    if value is None or number is None:
        return _what_is_wrong(sentence, value[1] if value else "")
    rest = sentence[value.end() :].strip()
    gain = _gain(rest)
    if rest and gain is None:
        return f"what is {rest[:40]!r} after the number? a gain has a sign, as in 96.21 (+1.73)"
    bold = _BOLD.search(text)
    first_digit = re.search(r"[0-9]", text)
    is_bold = bool(bold and first_digit and bold.start() < first_digit.start())
    return Marked(number, gain, is_bold, bool(value[2]))


def _without_marks(text: str) -> str:
    plain = text.translate(_SIGNS).replace("--", "-").replace("\\%", "%")
    plain = plain.replace("\\uparrow", "↑").replace("\\downarrow", "↓")
    plain = _QUIET.sub("", _CITED.sub("", _BOLD.sub("", plain)))
    return re.sub(r"\\[,;! ]|[{}$]|(?<=\d)_(?=[+-])", "", plain).replace("_", " ")


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
    return _number(sign)


def _what_is_wrong(text: str, number: str) -> str:
    if _THOUSANDS.fullmatch(number):
        whole, _, part = number.partition(",")
        return f"{text[:80]!r} may be {whole}{part} or {whole}.{part}"
    decimals = number.replace(",", ".").partition(".")[2]
    if len(decimals) > MOST_DECIMALS and decimals.isdigit():
        return f"{text[:80]!r} has more than {MOST_DECIMALS} decimals"
    return f"{text[:80]!r} is no printed number"


def plain_name(text: str) -> str:
    """Return a name without bold, citations and the like."""
    plain = _QUIET.sub("", _CITED.sub("", _BOLD.sub("", text)))
    plain = re.sub(r"\$?\\(up|down)arrow\$?", "", plain)
    return " ".join(re.sub(r"\\([&%_#$])", r"\1", re.sub(r"[{}$]", "", plain)).split())
