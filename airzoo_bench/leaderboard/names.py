"""Texts that strangers write and a board shows: nothing hidden in them, nothing that looks alike.

After Unicode's TR 36 and TR 39, with fewer letters: what a board calls a method or a team is
written in letters that most readers can tell apart.
"""

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
_FORMULA = "=+-@"
_MARKUP = "<>`\\|"
_SCRIPTS = ("LATIN", "GREEK", "CYRILLIC", "CJK UNIFIED", "HIRAGANA", "KATAKANA", "HANGUL SYLLABLE")
_BASIC = {"GREEK": "\u0391-\u03c9", "CYRILLIC": "\u0400-\u045f"}
_OTHER_LATIN = "æÆøØßðÐþÞđĐłŁıœŒ"
_RAISED = "¹²³⁰⁴⁵⁶⁷⁸⁹₀₁₂₃₄₅₆₇₈₉"
_EXTRA = frozenset(_RAISED + "×·")

# What looks like a Latin letter or a digit, by https://www.unicode.org/Public/security/, for the
# letters that names may have; small letters also by their capitals, since case counts for nothing.
_GREEK = dict(zip("ΑΒΕΖΗΙΚΜΝΟΡΤΥΧαβγεηικνορστυχω", "abezhikmnoptyxabyenikvopotuxw", strict=True))
_CYRILLIC = dict(
    zip("АБВГЕЗКМНОПРСТУФХЬІЈЅабвгезкмнопрстуфхьіјѕ", "a6bre3kmhoπpctyφxbijs" * 2, strict=True)
)
_OTHERS = {"Ы": "bl", "ы": "bl", "Ю": "lo", "ю": "lo", "ø": "o", "Ø": "o", "đ": "d", "Đ": "d"} | {
    **{"ð": "d", "Ð": "d", "ł": "l", "Ł": "l", "ı": "l", "æ": "ae", "Æ": "ae", "œ": "oe"},
    **{"Œ": "oe", "þ": "p", "Þ": "p", "×": "x"},
    **dict(zip("ヘニイハカトロタエノー", "へ二亻八力卜口夕工丿一", strict=True)),
}
_LOOKS_LIKE = _GREEK | _CYRILLIC | _OTHERS
_SEPARATORS = str.maketrans("", "", " -_·'\",:;()[]{}~!?")
_SAME = (("rn", "m"), ("vv", "w"), ("0", "o"), ("1", "l"), ("i", "l"), ("|", "l"))


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
    """Refuse a text with anything that is not shown, or that is shown elsewhere than it stands."""
    for letter in text:
        if not letter.isprintable() or letter in _BLANK or _is_variation(letter):
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
    """Refuse, beside what `plain_line` does, what a page, a comment or a spreadsheet could act on.

    Raises
    ------
    ValueError
        See `plain_line`; or it begins like a formula, or has characters of markup, or an address.
    """
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
    """Refuse, beside what `shown_line` does, letters that most readers cannot tell from others."""
    shown_line(text)
    for letter in text:
        if not (letter.isascii() or letter in _EXTRA or _is_plain_letter(letter)):
            raise ValueError(
                f"has {_named(letter)}: names have Latin, Greek, Cyrillic, Chinese, Japanese or "
                "Korean letters, digits and plain punctuation"
            )
    if not any(letter.isalnum() for letter in text):
        raise ValueError("has neither letter nor digit")
    if re.search("[A-Za-z]", text):
        for letter in text:
            if letter in _GREEK or _script(letter) == "CYRILLIC":
                raise ValueError(f"has {_named(letter)} among Latin letters")
    return text


def skeleton(name: str) -> str:
    """Return what is left of a name when what looks alike is written alike."""
    plain = unicodedata.normalize("NFKD", name)
    folded = "".join(_LOOKS_LIKE.get(c, c) for c in plain if not unicodedata.combining(c))
    folded = folded.casefold().translate(_SEPARATORS).strip(".")
    for seen, instead in _SAME:
        folded = folded.replace(seen, instead)
    return folded


def alike(one: str, other: str) -> bool:
    """Whether two different names could be taken for each other."""
    return one != other and skeleton(one) == skeleton(other)


def _is_variation(letter: str) -> bool:
    return "\ufe00" <= letter <= "\ufe0f" or "\U000e0000" <= letter <= "\U000e0fff"


def _is_plain_letter(letter: str) -> bool:
    script = _script(letter)
    if script == "LATIN":
        return letter in _OTHER_LATIN or unicodedata.normalize("NFD", letter)[0].isascii()
    if script in _BASIC:
        base = unicodedata.normalize("NFD", letter)[0]
        return bool(re.fullmatch(f"[{_BASIC[script]}]", base))
    return bool(script)


def _script(letter: str) -> str:
    """Return the script of a letter, as far as names may have it."""
    if unicodedata.category(letter) not in ("Lu", "Ll", "Lo") and letter != "ー":
        return ""
    name = unicodedata.name(letter, "")
    return next((script for script in _SCRIPTS if name.startswith(script)), "")


def _named(letter: str) -> str:
    return f"U+{ord(letter):04X} {unicodedata.name(letter, 'without a name')}"


Line = Annotated[str, Field(min_length=1, max_length=120), AfterValidator(shown_line)]
"""A line that pages show."""
BoardName = Annotated[str, Field(min_length=1, max_length=64), AfterValidator(board_name)]
"""What a board calls a method or a team."""
