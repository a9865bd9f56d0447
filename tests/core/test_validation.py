"""JSON in which no key stands twice."""

from __future__ import annotations

import pytest

from airzoo_bench.core.validation import unambiguous_json


def test_the_last_of_many_keys_stands_twice() -> None:
    """Comparing each with all before it would take days."""
    keys = [f'"{number}": 0' for number in range(300_000)]
    assert len(unambiguous_json(f"{{{', '.join(keys)}}}")) == 300_000
    with pytest.raises(ValueError, match="key '299999' stands twice"):
        unambiguous_json(f"{{{', '.join([*keys, keys[-1]])}}}")
