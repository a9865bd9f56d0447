from __future__ import annotations

from decimal import ROUND_HALF_EVEN, ROUND_HALF_UP, Decimal
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.tables.printed_numbers import Interval, decimal_text, mean_interval, parse_number
from tests.audit.support import number


@pytest.mark.parametrize(
    ("text", "value", "decimals"),
    [
        ("96.21", Fraction(9621, 100), 2),
        ("50.00", Fraction(50), 2),
        ("+1.73", Fraction(173, 100), 2),
        ("-2.65", Fraction(-265, 100), 2),
        ("--2.65", Fraction(-265, 100), 2),
        ("−2.65", Fraction(-265, 100), 2),
        ("7", Fraction(7), 0),
    ],
)
def test_printed_numbers(text: str, value: Fraction, decimals: int) -> None:
    parsed = number(text)
    assert (parsed.value, parsed.decimals) == (value, decimals)


@pytest.mark.parametrize(
    "text", ["", "nan", "inf", "1e3", "96,21", "96.21 %", "1/3", ".5", "5.", "٣", "1_0", "1" * 20]
)
def test_what_is_no_printed_number(text: str) -> None:
    assert parse_number(text) is None


@given(st.decimals(-999, 999, places=6), st.integers(0, 4), st.booleans())
def test_the_interval_holds_whatever_was_rounded(
    exact: Decimal, decimals: int, to_even: bool
) -> None:
    mode = ROUND_HALF_EVEN if to_even else ROUND_HALF_UP
    printed = exact.quantize(Decimal(1).scaleb(-decimals), mode)
    interval = number(f"{printed:f}").interval
    assert interval.low <= Fraction(exact) <= interval.high
    assert interval.high - interval.low == Fraction(1, 10**decimals)


@given(st.decimals(-999, 999, places=6), st.integers(0, 5))
def test_decimal_text_is_what_decimal_says(exact: Decimal, decimals: int) -> None:
    expected = exact.quantize(Decimal(1).scaleb(-decimals), ROUND_HALF_UP)
    assert decimal_text(Fraction(exact), decimals) == f"{expected + 0:f}"


def test_a_mean_of_intervals() -> None:
    parts = [Interval(Fraction(1), Fraction(2)), Interval(Fraction(3), Fraction(7))]
    assert mean_interval(parts) == Interval(Fraction(2), Fraction(9, 2))
    assert mean_interval(parts, [3, 1]) == Interval(Fraction(6, 4), Fraction(13, 4))


def test_a_negative_factor_turns_an_interval_round() -> None:
    assert Interval(Fraction(1), Fraction(2)).times(Fraction(-3)) == Interval(
        Fraction(-6), Fraction(-3)
    )
