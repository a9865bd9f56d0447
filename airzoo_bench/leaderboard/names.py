"""Texts that strangers write and a board shows: nothing hidden in them, nothing that acts."""

from __future__ import annotations

import re
import unicodedata
from typing import Annotated

from pydantic import AfterValidator, Field

__all__ = [
    "BoardName",
    "Line",
    "alike",
    "board_name",
    "fault_of_file_name",
    "plain_line",
    "shown_line",
    "skeleton",
]

# Letters and marks that show nothing, and that Unicode counts as printable all the same.
_BLANK = frozenset("\u034f\u115f\u1160\u17b4\u17b5\u180b\u180c\u180d\u180f\u2800\u3164\uffa0")
_MOST_MARKS = 2
_FORMULA, _MARKUP = "=+-@", "<>`\\|"
_EXTRA = frozenset("¹²³⁰⁴⁵⁶⁷⁸⁹₀₁₂₃₄₅₆₇₈₉×·ー")
# By the beginning of the names that Unicode gives to their letters.
_SCRIPTS = ("LATIN", "GREEK", "CYRILLIC", "CJK UNIFIED", "HIRAGANA", "KATAKANA", "HANGUL SYLLABLE")
_ALPHABETS = ("LATIN", "GREEK", "CYRILLIC")
_OTHER_LATIN = frozenset("æÆøØßðÐþÞđĐłŁıœŒ")
_BASIC = {"GREEK": re.compile("[\u0391-\u03c9]"), "CYRILLIC": re.compile("[\u0400-\u045f]")}
_SEPARATORS = str.maketrans("", "", " -_·'\",:;()[]{}~!?")
_SAME = (
    ("rn", "m"),
    ("vv", "w"),
    ("0", "o"),
    ("1", "l"),
    ("i", "l"),
    ("ø", "o"),
    ("æ", "ae"),
    ("œ", "oe"),
    ("ы", "bl"),
    ("ю", "lo"),
)
# Letters of other alphabets that are drawn as these.
_DRAWN_ALIKE = str.maketrans(
    "αβεζηικμνορτυχΑΒΕΖΗΙΚΜΝΟΡΤΥΧавекмнорстухіјѕАВЕКМНОРСТУХІЈЅđðłıþзбЗБγσЬьг×ГΣς",
    "abezhikmvoptuxABEZHIKMNOPTYXabekmhopctyxijsABEKMHOPCTYXIJSddllp3636yobbrxroo",
)

_PLAIN_FILE = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,119}")
# What Windows takes for a device, also with an ending: no clone there could have such a file.
_DEVICE = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9])(\..*)?", re.IGNORECASE)


def fault_of_file_name(name: str) -> str:
    """Say what is wrong with the name of a file or folder of a submission, if anything is."""
    if name in ("", ".", ".."):
        return f"{name!r} is no name of a file"
    if name.casefold() == ".gitattributes":
        return "a .gitattributes could change what others read of these files"
    faults = {
        "begins with a dot": name[0] == ".",
        "begins with a dash": name[0] == "-",
        "has blanks or line breaks": any(c.isspace() for c in name),
        "has characters that do not print": not name.isprintable(),
        "is longer than 120 letters": len(name) > 120,
        "has other characters than those of plain names": not _PLAIN_FILE.fullmatch(name),
        "is none on Windows": bool(_DEVICE.fullmatch(name)) or name.endswith("."),
    }
    return next((f"the name {fault}" for fault, there in faults.items() if there), "")


def plain_line(text: str) -> str:
    """Refuse a text with invisible characters, or ones that are shown out of order."""
    for letter in text:
        variation = "\ufe00" <= letter <= "\ufe0f" or "\U000e0000" <= letter <= "\U000e0fff"
        if not letter.isprintable() or letter in _BLANK or variation:
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
    if text[:1] in _FORMULA:
        raise ValueError(f"begins with {text[:1]!r}, as formulas of spreadsheets do")
    for letter in _MARKUP:
        if letter in text:
            raise ValueError(f"has {letter!r}, which is markup")
    if "://" in text or text.casefold().startswith(("javascript:", "www.")):
        raise ValueError("has an address in it, which has a key of its own")
    return text


def board_name(text: str) -> str:
    """Refuse, beside what `shown_line` does, odd letters, and an alphabet within another."""
    shown_line(text)
    for letter in text:
        if not (letter.isascii() or letter in _EXTRA or _script(letter)):
            raise ValueError(
                f"has {_named(letter)}: names have Latin, Greek, Cyrillic, Chinese, Japanese or "
                "Korean letters, digits and plain punctuation"
            )
    if not any(letter.isalnum() for letter in text):
        raise ValueError("has neither letter nor digit")
    first: dict[str, str] = {}
    for letter in text:
        if letter in "πΔλ" or _script(letter) not in _ALPHABETS:  # as in formulas
            continue
        first.setdefault(_script(letter), letter)
        if len(first) > 1:
            raise ValueError(f"has {_named(letter)} among {next(iter(first)).title()} letters")
    return text


def skeleton(name: str) -> str:
    """Return what is left of a name when what looks alike is written alike."""
    plain = unicodedata.normalize("NFKD", name)
    bare = "".join(letter for letter in plain if not unicodedata.combining(letter))
    folded = bare.translate(_DRAWN_ALIKE).casefold().translate(_SEPARATORS).strip(".")
    for seen, instead in _SAME:
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
    script = next((script for script in _SCRIPTS if name.startswith(script)), "")
    if script == "LATIN" and not (base.isascii() or letter in _OTHER_LATIN):
        return ""
    return script if script not in _BASIC or _BASIC[script].match(base) else ""


def _named(letter: str) -> str:
    return f"U+{ord(letter):04X} {unicodedata.name(letter, 'without a name')}"


Line = Annotated[str, Field(min_length=1, max_length=120), AfterValidator(shown_line)]
"""A line that pages show."""
BoardName = Annotated[str, Field(min_length=1, max_length=64), AfterValidator(board_name)]
"""What a board calls a method or a team."""
