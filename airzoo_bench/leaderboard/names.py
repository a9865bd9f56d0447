"""Texts that strangers write and a board shows: nothing hidden in them, nothing that acts."""

from __future__ import annotations

import re
import unicodedata
from typing import Annotated

from pydantic import AfterValidator, Field

__all__ = ["BoardName", "Line", "alike", "board_name", "plain_line", "shown_line", "skeleton"]

# Letters and marks that show nothing, and that Unicode counts as printable all the same.
_BLANK = re.compile(
    "[\u034f\u115f\u1160\u17b4\u17b5\u180b-\u180f\u2800\u3164\uffa0\ufe00-\ufe0f\U000e0000-\U000e0fff]"
)
_MOST_MARKS = 2
_MARKUP = re.compile(r"[<>`\\|]")
_EXTRA = frozenset("¹²³⁰⁴⁵⁶⁷⁸⁹₀₁₂₃₄₅₆₇₈₉×·ー")
# The beginnings of the names that Unicode gives to letters, and the letters that names may have.
_ALPHABETS = {
    "LATIN": re.compile("[A-Za-zæÆøØßðÐþÞđĐłŁıœŒ]"),
    "GREEK": re.compile("[\u0391-\u03c9]"),
    "CYRILLIC": re.compile("[\u0400-\u045f]"),
}
_OTHER_SCRIPTS = ("CJK UNIFIED", "HIRAGANA", "KATAKANA", "HANGUL SYLLABLE")
_SEPARATORS = str.maketrans("", "", " -_·'\",:;()[]{}~!?")
_SAME = {"rn": "m", "vv": "w", "0": "o", "1": "l", "i": "l", "ø": "o", "æ": "ae", "œ": "oe"}
_SAME |= {"ы": "bl", "ю": "lo"}
# Letters of other alphabets that are drawn as these.
_DRAWN_ALIKE = str.maketrans(
    "αβεζηικμνορτυχΑΒΕΖΗΙΚΜΝΟΡΤΥΧавекмнорстухіјѕАВЕКМНОРСТУХІЈЅđðłıþзбЗБγσЬьг×ГΣς",
    "abezhikmvoptuxABEZHIKMNOPTYXabekmhopctyxijsABEKMHOPCTYXIJSddllp3636yobbrxroo",
)


def plain_line(text: str) -> str:
    """Refuse a text with invisible characters, or ones that are shown out of order."""
    for letter in text:
        if not letter.isprintable() or _BLANK.match(letter):
            raise ValueError(f"has {_named(letter)}, which is not shown")
    if unicodedata.normalize("NFC", text) != text:
        raise ValueError("is not in Unicode's normal form NFC: type its letters anew")
    marks = "".join("m" if unicodedata.combining(letter) else "." for letter in text)
    if "m" * (_MOST_MARKS + 1) in marks:
        raise ValueError(f"has more than {_MOST_MARKS} marks on one letter")
    if text != text.strip() or "  " in text:
        raise ValueError("has a blank at an end, or two in a row")
    return text


def shown_line(text: str) -> str:
    """Refuse, beside what `plain_line` does, what a page, a comment or a spreadsheet acts on."""
    plain_line(text)
    if text[:1] in "=+-@":
        raise ValueError(f"begins with {text[:1]!r}, as formulas of spreadsheets do")
    if found := _MARKUP.search(text):
        raise ValueError(f"has {found[0]!r}, which is markup")
    if "://" in text or text.casefold().startswith(("javascript:", "www.")):
        raise ValueError("has an address in it, which has a key of its own")
    return text


def board_name(text: str) -> str:
    """Refuse, beside what `shown_line` does, odd letters, and an alphabet within another."""
    shown_line(text)
    alphabets: dict[str, str] = {}
    for letter in text:
        script = _script(letter)
        if not (letter.isascii() or letter in _EXTRA or script):
            raise ValueError(
                f"has {_named(letter)}: names have Latin, Greek, Cyrillic, Chinese, Japanese or "
                "Korean letters, digits and plain punctuation"
            )
        if script in _ALPHABETS and letter not in "πΔλ":  # as in formulas
            alphabets.setdefault(script, letter)
        if len(alphabets) > 1:
            raise ValueError(f"has {_named(letter)} among {next(iter(alphabets)).title()} letters")
    if not any(letter.isalnum() for letter in text):
        raise ValueError("has neither letter nor digit")
    return text


def skeleton(name: str) -> str:
    """Return what is left of a name when all that looks alike is written alike."""
    plain = unicodedata.normalize("NFKD", name)
    bare = "".join(letter for letter in plain if not unicodedata.combining(letter))
    folded = bare.translate(_DRAWN_ALIKE).casefold().translate(_SEPARATORS).strip(".")
    for seen, instead in _SAME.items():
        folded = folded.replace(seen, instead)
    return folded


def alike(one: str, other: str) -> bool:
    """Whether two different names could be taken for each other."""
    return one != other and skeleton(one) == skeleton(other)


def _script(letter: str) -> str:
    """Return the script of a letter, as far as names may have it."""
    if unicodedata.category(letter) not in ("Lu", "Ll", "Lo"):
        return ""
    name, base = unicodedata.name(letter, ""), unicodedata.normalize("NFD", letter)[0]
    if script := next((script for script in _ALPHABETS if name.startswith(script)), ""):
        return script if _ALPHABETS[script].match(base) else ""
    return next((script for script in _OTHER_SCRIPTS if name.startswith(script)), "")


def _named(letter: str) -> str:
    return f"U+{ord(letter):04X} {unicodedata.name(letter, 'without a name')}"


Line = Annotated[str, Field(min_length=1, max_length=120), AfterValidator(shown_line)]
"""A line that pages show."""
BoardName = Annotated[str, Field(min_length=1, max_length=64), AfterValidator(board_name)]
"""What a board calls a method or a team."""
