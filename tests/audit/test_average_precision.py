"""Bounds of average precision, against rankings whose every score is known."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.audit.precision import first_hit_bounds
from airzoo_bench.retrieval.metrics import average_precision_at
from airzoo_bench.tables.printed import Span
from tests.audit.support import audited, percent, row, rows_of, told

AT = (1, 3, 5)


@pytest.mark.parametrize("variant", ["precision", "min", "trec", "hits"])
@given(
    hits=st.lists(st.booleans(), min_size=5, max_size=5).filter(any),
    unfound=st.integers(0, 30),
    after=st.integers(0, 4),
)
def test_a_query_lies_within_the_bounds(
    variant: str, hits: list[bool], unfound: int, after: int
) -> None:
    first = hits.index(True) + 1
    after = min(after, first - 1)
    matrix, positives = np.array([hits]), np.array([sum(hits) + unfound])
    value = average_precision_at(matrix, positives, 5, variant)[0]
    bounds = first_hit_bounds(variant, 5, after, max(first, after + 1))
    assert float(bounds.low) - 1e-12 <= value <= float(bounds.high) + 1e-12


@pytest.mark.parametrize(
    ("variant", "after", "upto", "low", "high"),
    [
        ("precision", 0, 1, "1/5", "1"),
        ("precision", 1, 3, "1/5", "4/5"),
        ("precision", 3, 5, "1/5", "2/5"),
        ("min", 3, 5, "1/25", "13/40"),  # a hit at 5, R >= 5; hits at 4 and 5 with R = 2
        ("trec", 3, 5, "0", "13/40"),
        ("hits", 3, 5, "1/5", "13/40"),
        ("hits", 0, 1, "7/10", "1"),  # hits at 1 and 5: (1 + 2/5) / 2
    ],
)
def test_bounds_by_hand(variant: str, after: int, upto: int, low: str, high: str) -> None:
    assert first_hit_bounds(variant, 5, after, upto) == Span(Fraction(low), Fraction(high))


@pytest.mark.parametrize(
    ("value", "grade"),
    [
        ("8.00", None),
        ("7.99", "rounding"),  # as of digits that were cut off
        ("7.98", "impossible"),
        ("28.00", None),
        ("28.05", "impossible"),
        ("40.00", "impossible"),
    ],
)
def test_mean_precision_against_recalls(tmp_path: Path, value: str, grade: str | None) -> None:
    # At least 40/5 = 8; at most (5 x 10 + 4 x 15 + 2 x 15) / 5 = 28.
    made = row(R_1="10.00", R_3="25.00", R_5="40.00", AP_5=value)
    found = told(audited(tmp_path, made, "precision"), "AP bounds")
    assert found == ([(grade, "AP bounds", "A", "AP@5")] if grade else [])


def simulated(
    variant: str, seed: int, methods: int = 5, queries: int = 151
) -> list[dict[str, object]]:
    """Return a table of one scene whose numbers come from made-up rankings."""
    random = np.random.default_rng(seed)
    positives = random.integers(5, 12, queries)
    made = []
    for method in range(methods):
        hits = random.random((queries, 5)) < random.uniform(0.1, 0.4)
        recalls = {f"R@{k}": percent(int(hits[:, :k].any(1).sum()), queries) for k in AT}
        value = average_precision_at(hits, positives, 5, variant).mean()
        scores = recalls | {"AP@5": f"{100 * value:.2f}"}
        made += rows_of({f"M{method}": {"East": scores}})
    return made


@pytest.mark.parametrize("seed", range(5))
def test_mean_precision_is_recognised(tmp_path: Path, seed: int) -> None:
    found = audited(tmp_path, simulated("precision", seed))
    (conclusion,) = (c for c in found.conclusions if c.check == "AP")
    assert conclusion.text.startswith("the definition is mean precision")
    assert not found.findings
