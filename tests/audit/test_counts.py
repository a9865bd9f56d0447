from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.audit.implied import implied_total
from airzoo_bench.tables.printed_numbers import (
    Interval,
    chance_of_fit,
    count_text,
    counted_share,
    is_cut,
    is_near,
    possible_counts,
)
from tests.audit.support import number, percent


def test_a_count_of_the_paper() -> None:
    assert list(possible_counts(number("96.21"), 264)) == [254]
    assert count_text(number("96.21"), 264) == "253/264 = 95.83, 254/264 = 96.21"
    assert not possible_counts(number("96.22"), 264)
    assert counted_share(number("96.21"), 264) == Interval(
        Fraction(25400, 264), Fraction(25400, 264)
    )


def test_halves_may_go_either_way() -> None:
    # 1/800 is 0.125 %.
    assert list(possible_counts(number("0.12"), 800)) == [1]
    assert list(possible_counts(number("0.13"), 800)) == [1]
    assert not possible_counts(number("0.14"), 800)


def test_several_counts_where_digits_are_few() -> None:
    assert list(possible_counts(number("50"), 1000)) == list(range(495, 506))
    assert list(possible_counts(number("0.00"), 10)) == [0]
    assert list(possible_counts(number("100"), 10)) == [10]


def test_shares_from_0_to_1() -> None:
    assert list(possible_counts(number("0.9621"), 264, full=1)) == [254]


def test_cut_digits_are_seen() -> None:
    assert is_cut(number("3.78"), 264)  # 10/264 = 3.787...
    assert not is_cut(number("3.79"), 264)
    assert not is_cut(number("73.30"), 161)


def test_what_a_way_of_rounding_explains_is_near() -> None:
    assert is_near(number("3.78"), 264)  # 10/264 = 3.7879, cut off
    assert is_near(number("8.08"), 161)  # 13/161 = 8.0745, by way of 8.075
    assert is_near(number("73.30"), 161)  # 118/161 = 73.2919, by way of 73.3
    assert not is_near(number("81.44"), 161)  # 131/161 = 81.37
    assert not is_near(number("12.31"), 1000)  # 12.30 exactly: no rounding makes it 12.31
    assert not is_near(number("100.01"), 7)


@given(st.integers(1, 5000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_every_rounded_count_is_possible(counted: tuple[int, int]) -> None:
    count, total = counted
    assert count in possible_counts(number(percent(count, total)), total)


@given(st.integers(0, 10000), st.integers(1, 300))
def test_possible_counts_are_those_that_round_to_it(hundredths: int, total: int) -> None:
    printed = number(f"{hundredths // 100}.{hundredths % 100:02d}")
    found = set(possible_counts(printed, total))
    rounds = {k for k in range(total + 1) if percent(k, total) == printed.text}
    # Halves are the only counts that may be printed as something else.
    halves = {k for k in found - rounds if (200 * 100 * k) % (2 * total) == total}
    assert found == rounds | halves


@pytest.mark.parametrize("total", [26, 144, 161, 264, 817, 1071])
def test_the_total_is_found_again(total: int) -> None:
    counts = np.random.default_rng(total).choice(np.arange(1, total), 12, replace=False)
    implied = implied_total((number(percent(int(c), total)), 100, 1) for c in counts)
    assert implied is not None
    assert (implied.total, implied.fits, implied.values) == (total, 12, 12)
    assert implied.probability > 0.99
    assert all(other % total == 0 for other in implied.as_good)


def test_a_misprint_does_not_hide_the_total() -> None:
    shares = [number(percent(count, 161)) for count in (3, 14, 27, 40, 58, 77, 90, 118)]
    implied = implied_total((share, 100, 1) for share in [*shares, number("73.30")])
    assert implied is not None
    assert (implied.total, implied.fits, implied.values) == (161, 8, 9)


def test_places_of_each_query_count() -> None:
    # Of 5 places times 50 queries; recalls would have to be of 250 queries.
    counts = [(number(percent(c, 250)), 100, 5) for c in (3, 11, 37, 58, 101, 149, 201)]
    implied = implied_total(counts)
    assert implied is not None
    assert implied.total == 50


def test_few_digits_tell_nothing() -> None:
    few = implied_total([(number("33.3"), 100, 1), (number("50.0"), 100, 1)])
    assert few is not None
    assert few.probability < 0.9
    assert implied_total([(number("0.00"), 100, 1), (number("100"), 100, 1)]) is None


def test_numbers_with_many_decimals_do_not_overflow() -> None:
    exact = number("96.212121212")
    implied = implied_total([(exact, 100, 1)])
    assert implied is not None
    assert (implied.total, implied.as_good) == (132, (264, 396, 528))  # 127/132


def test_counts_between_two_printed_numbers_are_no_evidence() -> None:
    # With n = 8000 every hundredth of a percent is some count, up or down: any table fits it.
    values = np.random.default_rng(0).integers(1, 10_000, 99)
    implied = implied_total((number(f"{v // 100}.{v % 100:02d}"), 100, 1) for v in values)
    assert implied is not None
    assert implied.probability < 0.99
    assert chance_of_fit(number("12.34"), 8000) == 1
    assert chance_of_fit(number("12.34"), 701) == 0.0701
    every = [number(f"{v // 10}.{v % 10}") for v in range(1000)]
    for total in (40, 80, 144, 264, 500, 800):
        fitting = sum(bool(possible_counts(value, total)) for value in every)
        assert abs(chance_of_fit(every[0], total) - fitting / 1000) < 0.002
