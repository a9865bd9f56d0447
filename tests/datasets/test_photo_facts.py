"""What photos have in common, against the plain way to find it."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.datasets.photo_facts import _grouped


def grouped_plainly(keys: dict[str, str]) -> dict[str, tuple[str, ...]]:
    """Copy a camera's names for every photo of it: quadratic, and hard to get wrong."""
    found: dict[str, tuple[str, ...]] = {}
    for name in sorted(keys):
        found[keys[name]] = (*found.get(keys[name], ()), name)
    return found


@given(st.dictionaries(st.text("ab/", max_size=4), st.sampled_from(("", "FC300S", "FC6310"))))
def test_names_are_grouped_in_their_order_and_groups_by_their_first(keys: dict[str, str]) -> None:
    assert list(_grouped(keys).items()) == list(grouped_plainly(keys).items())
