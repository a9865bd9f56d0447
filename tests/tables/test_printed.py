"""What two printed hit rates can mean."""

from __future__ import annotations

import numpy as np
import pytest

from airzoo_bench.core.errors import UsageError
from airzoo_bench.statistics.significance import mcnemar
from airzoo_bench.tables.printed_comparison import (
    hit_rate_interval,
    hits_that_print,
    printed_bounds,
)


def test_the_question_of_the_paper_s_reader():
    bounds = printed_bounds("96.21", "94.32", 264)
    assert [list(counts) for counts in bounds.counts] == [[254], [249]]
    assert bounds.least == (5, 0, 0.0625)
    assert bounds.most[:2] == (15, 10)
    assert bounds.most[2] == pytest.approx(0.4244, abs=1e-4)


@pytest.mark.parametrize("queries", [7, 10])
def test_bounds_hold_every_way_hits_can_fall(queries):
    for first in range(queries + 1):
        for second in range(queries + 1):
            texts = (f"{100 * hits / queries:.2f}" for hits in (first, second))
            bounds = printed_bounds(*texts, queries)
            both = range(max(0, first + second - queries), min(first, second) + 1)
            possible = [float(mcnemar(*map(np.array, (first - b, second - b)))) for b in both]
            assert bounds.least[2] == pytest.approx(min(possible))
            assert bounds.most[2] == pytest.approx(max(possible))
            for wins, losses, _ in (bounds.least, bounds.most):
                assert wins - losses == first - second
                assert 0 <= first - wins <= min(first, second)


@pytest.mark.parametrize(
    ("text", "queries", "counts"),
    [
        ("50", 4, [2]),
        ("33.3", 3, [1]),
        ("12.5", 40, [5]),
        ("0", 10, [0]),
        ("100.00", 7, [7]),
        ("50", 1000, list(range(495, 506))),
        ("0.1", 2000, [1, 2, 3]),
    ],
)
def test_counts_that_round_to_a_text(text, queries, counts):
    assert list(hits_that_print(text, queries)) == counts


def test_the_paper_s_impossible_cell():
    with pytest.raises(UsageError, match=r"15\.90 %: the nearest are 70/444 = 15\.7658"):
        hits_that_print("15.90", 444)


@pytest.mark.parametrize("text", ["", "x", "-1", "101", "1e1", "nan", "96,21", "1.", "٣"])
def test_what_is_no_percentage(text):
    with pytest.raises(UsageError, match="no printed percentage"):
        hits_that_print(text, 10)


def test_too_coarse():
    with pytest.raises(UsageError, match="too coarsely"):
        printed_bounds("50", "51", 10_000_000)


def test_interval_of_a_rate():
    # None of n: the upper limit u has (1 - u)^n = 0.025.
    low, high = hit_rate_interval(0, 20)
    assert low == 0.0
    assert (1 - high) ** 20 == pytest.approx(0.025)
    assert hit_rate_interval(20, 20).tolist() == pytest.approx([1 - high, 1.0])


def test_shares_are_taken_for_what_they_are():
    with pytest.raises(UsageError, match=r"looks like a share from 0 to 1: give percent, 96\.21"):
        hits_that_print("0.9621", 264)
    assert list(hits_that_print("0.38", 264)) == [1]
