"""Tables that are right have no grave findings, whatever their numbers and however printed."""

from __future__ import annotations

import tempfile
from decimal import ROUND_HALF_EVEN, ROUND_HALF_UP
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from airzoo_bench.audit.audit import Audit, audit
from tests.audit.honest import GAINS, ROUNDINGS, Manner, drawn, honest
from tests.audit.support import published, told

SCENES = (97, 161, 190)

manners = st.builds(
    Manner,
    seed=st.integers(0, 10**6),
    scenes=st.lists(st.integers(1, 2000), min_size=1, max_size=5).map(tuple),
    rounding=st.sampled_from(ROUNDINGS),
    decimals=st.integers(0, 4),
    pooled=st.booleans(),
    gains=st.sampled_from(GAINS),
    all_bold=st.booleans(),
)


def audited(manner: Manner, *, with_counts: bool) -> Audit:
    with tempfile.TemporaryDirectory() as folder:
        table = published(Path(folder), honest(manner))
    return audit(table, manner.counts if with_counts else {})


def grave(found: Audit) -> list[tuple[str, str, str, str]]:
    return [finding for finding in told(found) if finding[0] != "rounding"]


@settings(max_examples=15, deadline=None, derandomize=True)
@given(manners, st.booleans())
def test_an_honest_table_has_no_grave_findings(manner: Manner, with_counts: bool) -> None:
    assert not grave(audited(manner, with_counts=with_counts))


@pytest.mark.parametrize("rounding", [ROUND_HALF_UP, ROUND_HALF_EVEN])
@pytest.mark.parametrize("seed", range(6))
def test_averages_over_scenes(seed: int, rounding: str) -> None:
    found = audited(Manner(seed, SCENES, rounding), with_counts=True)
    # What is off by the last digit is a gain of exact values, never an average.
    assert {finding[:2] for finding in told(found)} <= {("rounding", "gain")}
    assert "average: 32 checked, 0 found" in found.notes


def test_every_check_has_been_at_work() -> None:
    notes = audited(Manner(0, SCENES), with_counts=True).notes
    tested = {note.partition(":")[0]: int(note.split()[1]) for note in notes[:5]}
    assert list(tested) == ["counts", "order", "average", "gain", "bold"]
    assert min(tested.values()) > 30


@pytest.mark.slow
def test_of_a_thousand_honest_tables_none_has_a_grave_finding() -> None:
    """No rule was fitted to these seeds; docs/audit.md states the result."""
    found = [
        (seed, with_counts)
        for seed in range(3000, 4000)
        for with_counts in (True, False)
        if grave(audited(drawn(seed), with_counts=with_counts))
    ]
    assert found == []
