"""What messages count agrees with the number, of one as of several."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import airzoo_bench
from airzoo_bench.core.errors import agreeing, counted, first_of, plural

SOURCES = sorted(Path(airzoo_bench.__file__).parent.rglob("*.py"))
VERBS = "is|are|was|were|has|have|does|do|lies?|ends?|scores?|depends?|differs?|agrees?|overlaps?"
NOUNS = (
    "queries|ids|photos|images|cameras|views|scenes|tiles|lists|matches|poses|points|pixels|maps|"
    "frames|rows|columns|values|shares|results|averages|pairs|tables|files|methods|gains"
)
UNSURE = re.compile(rf"^ (?:[a-z]+ )?(?:{NOUNS}) (?:of [a-z]+ )?(?:{VERBS})\b")
"""What follows a number that may be 1: a noun of several, and a verb."""


def test_words() -> None:
    nouns = {"query": "queries", "scene": "scenes", "match": "matches", "key": "keys"}
    assert {noun: plural(noun) for noun in nouns} == nouns
    assert plural("more setting") == "more settings"
    assert [counted(n, "photo") for n in (0, 1, 12_000)] == ["0 photos", "1 photo", "12,000 photos"]
    assert [agreeing(n, "is", "are") for n in (0, 1, 2)] == ["are", "is", "are"]
    assert first_of(["a"], noun="query") == "1 query (a)"
    assert first_of(["a"], 5, noun="query") == "1 of 5 queries (a)"
    assert first_of("abcd", noun="row") == "4 rows (first 3: a, b, c)"


def after_numbers(source: str) -> list[str]:
    """Return what stands right behind the expressions of f-strings."""
    return [
        text.value
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.JoinedStr)
        for value, text in zip(node.values, node.values[1:], strict=False)
        if isinstance(value, ast.FormattedValue)
        and isinstance(text, ast.Constant)
        and isinstance(text.value, str)
    ]


def test_no_message_counts_several_of_one() -> None:
    assert UNSURE.match(" queries are missing")
    assert UNSURE.match(" ids of predictions are no queries")
    # These are never of one.
    many = "shares are counts|values are no groups|results differ|whose values|title|are called"
    found = [
        f"{path.name}: ...{text}"
        for path in SOURCES
        for text in after_numbers(path.read_text(encoding="utf-8"))
        if UNSURE.match(text) and not re.search(many, text)
    ]
    assert found == []
