"""What messages count agrees with the number, of one as of several."""

from __future__ import annotations

from airzoo_bench.core.errors import agreeing, counted, first_of, plural


def test_words() -> None:
    nouns = {"query": "queries", "scene": "scenes", "match": "matches", "key": "keys"}
    assert {noun: plural(noun) for noun in nouns} == nouns
    assert plural("more setting") == "more settings"
    assert [counted(n, "photo") for n in (0, 1, 12_000)] == ["0 photos", "1 photo", "12,000 photos"]
    assert [agreeing(n, "is", "are") for n in (0, 1, 2)] == ["are", "is", "are"]
    assert first_of(["a"], noun="query") == "1 query (a)"
    assert first_of(["a"], 5, noun="query") == "1 of 5 queries (a)"
    assert first_of("abcd", noun="row") == "4 rows (first 3: a, b, c)"
