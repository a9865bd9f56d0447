"""Keys that nobody knows."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.validation import Strict, validated


@pytest.mark.parametrize("key", ["<b>", "<map>", "plain"])
def test_a_key_that_nobody_knows_is_named_whatever_it_is(key: str) -> None:
    class Table(Strict):
        known: int = 1

    with pytest.raises(SubmissionError, match=f"unknown key '{key}'"):
        validated({key: 1}, Table, SubmissionError, Path("x.toml"), "table")
