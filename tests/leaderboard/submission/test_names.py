"""What methods and teams may be called, held to Unicode's own list of letters that look alike."""

from __future__ import annotations

import json
import unicodedata
from pathlib import Path

import confusable_homoglyphs
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.leaderboard.submission import alike, board_name, plain_line, shown_line, skeleton


@pytest.mark.parametrize(
    "name",
    [
        "SALAD",
        "π³",
        "MASt3R++",
        "DINOv2-B",
        "Δ-Net",
        "Яндекс",
        "北京大学",
        "トヨタ",
        "삼성",
        "Łódź",
        "R&D",
    ],
)
def test_names_of_methods_and_teams_are_taken(name: str) -> None:
    assert board_name(name) == name


REFUSED = {
    "S\u0410LAD": "CYRILLIC CAPITAL LETTER A among Latin letters",
    "SALAD\u202egnp": "U+202E RIGHT-TO-LEFT OVERRIDE, which is not shown",
    "SAL\u200bAD": "U+200B ZERO WIDTH SPACE",
    "SALAD\u3164": "U+3164 HANGUL FILLER",
    "SALAD\ufe0f": "U+FE0F VARIATION SELECTOR-16",
    "\x1b[31mSALAD": "U+001B",
    "SALAD\n@maintainers": "U+000A",
    "=HYPERLINK(1)": "begins with '=', as formulas",
    "+1": "begins with '+'",
    "-1": "begins with '-'",
    "@team": "begins with '@'",
    "<b>SALAD</b>": "has '<', which is markup",
    "`SALAD`": "has '`', which is markup",
    "SA|LAD": "has '|', which is markup",
    r"\input{x}": r"which is markup",
    "https://example.org": "has an address in it",
    "www.example.org": "has an address in it",
    "Ame\u0301lie": "NFC",
    "q\u0327\u030a\u030b": "more than 2 marks",
    " SALAD": "blank at an end",
    "SA  LAD": "two in a row",
    "\U0001d412ALAD": "MATHEMATICAL BOLD CAPITAL S",
    "\ua4e2\ua4ee\ua4e1\ua4ee\ua4d3": "LISU LETTER SA",
    "\uff33ALAD": "FULLWIDTH LATIN CAPITAL LETTER S",
    "***": "neither letter nor digit",
}


@pytest.mark.parametrize("name", list(REFUSED), ids=ascii)
def test_other_names_are_refused_with_the_reason(name: str) -> None:
    with pytest.raises(ValueError, match=r"has|begins|not in") as error:
        board_name(name)
    assert REFUSED[name] in str(error.value)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("SALAD", "Salad"),
        ("SALAD", "SA-LAD"),
        ("SALAD", "SALAD."),
        ("SALAD", '"SALAD"'),
        ("SALAD", "(SALAD)"),
        ("SALAD", "SALAD,"),
        ("SALAD", "SALAD~"),
        ("VGG16", "VGGl6"),
        ("Cornet", "Comet"),
        ("LoFTR", "L0FTR"),
        ("Ame", "Amé"),
        ("СОСА", "COCA"),
        ("ΑΒΕΖ", "ABEZ"),
        ("Net²", "Net2"),
    ],
)
def test_what_looks_alike_is_found(one: str, other: str) -> None:
    assert alike(one, other)
    assert alike(other, one)


@pytest.mark.parametrize(
    ("one", "other"),
    [("SALAD", "SALAD"), ("SALAD", "SALAD+"), ("v1.1", "v11"), ("DUSt3R", "MASt3R"), ("π3", "Pi3")],
)
def test_what_does_not_is_not(one: str, other: str) -> None:
    assert not alike(one, other)


def _lookalikes() -> list[tuple[str, str]]:
    """Return letters of one code point with the ASCII text that Unicode says they look like."""
    place = Path(confusable_homoglyphs.__file__).parent / "confusables.json"
    listed = json.loads(place.read_text(encoding="utf-8"))
    return [
        (letter, other["c"])
        for letter, others in listed.items()
        if len(letter) == 1 and ord(letter) > 127 and unicodedata.name(letter, "")
        for other in others
        if other["c"].isascii() and other["c"].isalnum()
    ]


@pytest.mark.parametrize("before", ["", "Net"])
def test_unicodes_lookalikes_of_ascii_are_refused_or_have_its_skeleton(before: str) -> None:
    pairs, taken = _lookalikes(), 0
    assert len(pairs) > 1000
    for letter, plain in pairs:
        try:
            board_name(before + letter)
        except ValueError:
            continue
        taken += 1
        assert skeleton(before + letter) == skeleton(before + plain), (letter, plain)
    assert taken > 5


@given(st.text(max_size=40))
def test_any_text_is_taken_or_refused_and_what_is_shown_is_harmless(text: str) -> None:
    for rule in (plain_line, shown_line, board_name):
        try:
            taken = rule(text)
        except ValueError as error:
            taken = str(error)  # shown as well
        assert taken.isprintable()
        assert not any(unicodedata.bidirectional(c) in ("RLO", "LRO", "RLE", "LRE") for c in taken)
