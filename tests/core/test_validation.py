"""JSON in which no key stands twice, and keys that nobody knows."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.validation import Strict, unambiguous_json, validated


def test_the_last_of_many_keys_stands_twice() -> None:
    """Comparing each with all before it would take days."""
    keys = [f'"{number}": 0' for number in range(300_000)]
    assert len(unambiguous_json(f"{{{', '.join(keys)}}}")) == 300_000
    with pytest.raises(ValueError, match="key '299999' stands twice"):
        unambiguous_json(f"{{{', '.join([*keys, keys[-1]])}}}")


@pytest.mark.parametrize("key", ["<b>", "<map>", "plain"])
def test_a_key_that_nobody_knows_is_named_whatever_it_is(key: str) -> None:
    class Table(Strict):
        known: int = 1

    with pytest.raises(SubmissionError, match=f"unknown key '{key}'"):
        validated({key: 1}, Table, SubmissionError, Path("x.toml"), "table")
