"""Submissions: the keys of ``submission.toml``, and what names may hold."""

from __future__ import annotations

import datetime
import re
import unicodedata
from pathlib import Path
from typing import Annotated, Any, Literal

import tomli_w
from pydantic import AfterValidator, Field, model_validator

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.validation import Name, Strict, read_toml, validated

SUBMISSION_FILE = "submission.toml"
EARLIER_KEYS = ("supersedes", "cost", "baseline", "bibtex")  # which are ignored

# A key of this many dots takes tomllib a second, and four times that of twice.
_LIMIT_BYTES = 16 << 10

# --- names: nothing hidden in them, nothing that acts ---

# Letters and marks that show nothing, and that Unicode counts as printable all the same.
_BLANK = re.compile(
    "[\u034f\u115f\u1160\u17b4\u17b5\u180b-\u180f\u2800\u3164\uffa0\ufe00-\ufe0f\U000e0000-\U000e0fff]"
)
# What a spreadsheet, a page or a comment takes for a formula, for markup or for a link.
_ACTS = re.compile(r"^[=+@-]|[<>`\\|]|://|^javascript:|^www\.", re.IGNORECASE)
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


def check_line(text: str) -> str:
    """Refuse a text with invisible characters, or ones that are shown out of order."""
    for letter in text:
        if not letter.isprintable() or _BLANK.match(letter):
            raise ValueError(f"has U+{ord(letter):04X}, which is not shown")
    if unicodedata.normalize("NFC", text) != text:
        raise ValueError("is not in Unicode's normal form NFC: type its letters anew")
    if text != " ".join(text.split()):
        raise ValueError("has a blank at an end, or two in a row")
    return text


def check_shown_line(text: str) -> str:
    """Refuse, besides the faults of `check_line`, markup of pages, comments and spreadsheets."""
    if found := _ACTS.search(check_line(text)):
        raise ValueError(f"has {found[0]!r} there, which pages or spreadsheets act on")
    return text


def check_name(text: str) -> str:
    """Refuse, besides the faults of `check_shown_line`, odd letters and mixed alphabets."""
    scripts = {letter: _script_of(letter) for letter in check_shown_line(text)}
    for letter, script in scripts.items():
        if not (script or letter.isascii() or letter in _EXTRA):
            known = "Latin, Greek, Cyrillic, Chinese, Japanese or Korean letters"
            raise ValueError(f"has U+{ord(letter):04X}: names have {known}, digits, punctuation")
    # Greek letters stand in formulas.
    used = {script for letter, script in scripts.items() if letter not in "πΔλ"} & {*_ALPHABETS}
    if len(used) > 1:
        raise ValueError(f"has letters of two alphabets, {' and '.join(sorted(used))}")
    if not any(letter.isalnum() for letter in text):
        raise ValueError("has neither letter nor digit")
    return text


def _script_of(letter: str) -> str:
    """Return the script of a letter that names may have."""
    if unicodedata.category(letter) not in ("Lu", "Ll", "Lo"):
        return ""
    name, base = unicodedata.name(letter, ""), unicodedata.normalize("NFD", letter)[0]
    scripts = (*(s for s, letters in _ALPHABETS.items() if letters.match(base)), *_OTHER_SCRIPTS)
    return next((script for script in scripts if name.startswith(script)), "")


def skeleton(name: str) -> str:
    """Return what is left of a name when all that looks alike is written alike."""
    plain = unicodedata.normalize("NFKD", name)
    bare = "".join(letter for letter in plain if not unicodedata.combining(letter))
    folded = bare.translate(_DRAWN_ALIKE).casefold().translate(_SEPARATORS).strip(".")
    for seen, instead in _SAME.items():
        folded = folded.replace(seen, instead)
    return folded


# --- submission.toml ---

# A host without a user before it, which could pass for one, then what RFC 3986 has but quotes.
_URL = r"^https://[A-Za-z0-9][A-Za-z0-9.-]*(:[0-9]{1,5})?([/?#][A-Za-z0-9._~:/?#@!$&()*+,;=%-]*)?$"
_CONTACT = r"[^@\s]+@[^@\s]+\.[^@\s]+|^https://\S+$|^@[A-Za-z0-9-]+$"

Line = Annotated[str, Field(min_length=1, max_length=120), AfterValidator(check_shown_line)]
BoardName = Annotated[str, Field(min_length=1, max_length=64), AfterValidator(check_name)]
Url = Annotated[str, Field(max_length=500, pattern=_URL)]
Account = Annotated[int, Field(ge=1, lt=1 << 63)]
Contact = Annotated[
    str, Field(min_length=3, max_length=200, pattern=_CONTACT), AfterValidator(check_line)
]


# What `submit` asks for where it is missing, and an example.
QUESTIONS = {
    "protocol": ("The protocol that scores the predictions.", "airzoo-mini-retrieval"),
    "method": ("The method's name in tables.", "SALAD"),
    "team": ("Who submits; the same words for all submissions of a team.", "Example Lab"),
    "authors": ("Authors of the method, in their order.", "Ada Example, Grace Example"),
    "licence": ("Under which others may use these predictions, an id of SPDX.", "CC-BY-4.0"),
    "training_data": ("Ids of all datasets that weights were trained on, or none.", "gsv-cities"),
    "stages": ("Whether a second method refines the answer.", "single-stage or re-ranked"),
    "contact": ("Public: a mail address, https://... or @account.", "first.last@example.org"),
    "account": ("Id of your GitHub account: https://api.github.com/users/NAME shows it.", "1001"),
}


class PredictionsGiven(Strict):
    """The place of the predictions, next to submission.toml or at an address, and their hash."""

    file: Name | None = None
    url: Url | None = None
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    size: Annotated[int, Field(ge=1, le=1 << 50, alias="bytes")]
    reader: Name | None = None

    @model_validator(mode="after")
    def _check_place(self) -> PredictionsGiven:
        if (self.file is None) == (self.url is None):
            raise ValueError('either file or url, such as file = "predictions.npz"')
        return self


class Pipeline(Strict):
    """The class of a method: entries of different classes are not compared like with like."""

    stages: Literal["single-stage", "re-ranked"]
    uses: tuple[Literal["prior", "sequence", "heights"], ...] = ()


class Submission(Strict):
    """A method's predictions for one protocol; docs/submission.md explains each key."""

    schema_version: Literal[1] = Field(alias="schema")
    protocol: Name
    method: BoardName
    summary: Annotated[str, Field(max_length=300), AfterValidator(check_line)] = ""
    team: BoardName
    account: Account | None = None
    authors: Annotated[tuple[Line, ...], Field(min_length=1, max_length=100)]
    date: datetime.date
    paper: Url | None = None
    code: Url | None = None
    weights: Url | None = None
    licence: Line
    training_data: Annotated[tuple[Name, ...], Field(max_length=100)]
    pipeline: Pipeline
    predictions: PredictionsGiven
    contact: Contact | None = None
    supersedes: Any = Field(None, exclude=True)
    cost: Any = Field(None, exclude=True)
    baseline: Any = Field(None, exclude=True)
    bibtex: Any = Field(None, exclude=True)


def read_submission(path: Path, *, public: bool = False) -> Submission:
    """Read a submission.toml; one that a board keeps is `public`, and has no contact."""
    data = read_toml(path, SubmissionError, "submission file", _LIMIT_BYTES)
    found = validated(data, Submission, SubmissionError, path, "submission file")
    if found.contact is None and not public:
        example = 'such as contact = "first.last@example.org"'
        raise SubmissionError("key 'contact' is missing", where=path, expected=example)
    return found


def submission_text(submission: Submission, *, public: bool = False) -> str:
    """Return the file that states a submission; one that a board keeps has no contact."""
    left_out = {"contact"} if public else set[str]()
    values = submission.model_dump(by_alias=True, exclude_none=True, exclude=left_out)
    # Keys after the head of a table would belong to that table.
    return tomli_w.dumps(dict(sorted(values.items(), key=lambda item: isinstance(item[1], dict))))
