"""Shares of whole numbers: which counts a printed share can be."""

from __future__ import annotations

import math
from fractions import Fraction

from airzoo_bench.tables.printed.numbers import Interval, Rounded, decimal_text

__all__ = ["chance_of_fit", "count_text", "counted_share", "is_cut", "is_near", "possible_counts"]


def possible_counts(number: Rounded, total: int, full: int = 100) -> range:
    """Return the counts out of a total that round to a printed share, halves either way.

    Parameters
    ----------
    number : Rounded
    total : int
        At least 1.
    full : int
        What all of the total is printed as: 100 or 1.

    Returns
    -------
    range
        Empty where no count does.
    """
    scaled = number.interval.times(Fraction(total, full))
    return range(max(0, math.ceil(scaled.low)), min(total, math.floor(scaled.high)) + 1)


def counted_share(number: Rounded, total: int, full: int = 100) -> Interval:
    """Return the interval of the true share in printed units, narrowed to counts where any fits."""
    counts = possible_counts(number, total, full)
    if not counts:
        return number.interval
    return Interval(Fraction(counts[0] * full, total), Fraction(counts[-1] * full, total))


def count_text(number: Rounded, total: int, full: int = 100, digits: int | None = None) -> str:
    """Name the counts next to a printed share, such as ``254/264 = 96.21``.

    Parameters
    ----------
    number : Rounded
    total, full : int
        As for `possible_counts`.
    digits : int, optional
        How many decimals to show; as many as printed where not given.
    """
    exact = number.value * total / full
    near = sorted({min(max(count, 0), total) for count in (math.floor(exact), math.ceil(exact))})
    decimals = number.decimals if digits is None else digits
    return ", ".join(
        f"{count}/{total} = {decimal_text(Fraction(count * full, total), decimals)}"
        for count in near
    )


def is_cut(number: Rounded, total: int, full: int = 100) -> bool:
    """Tell whether a printed share is a count whose further digits were cut off."""
    count = math.ceil(number.value * total / full)
    return count <= total and Fraction(count * full, total) < number.value + 2 * number.half


def is_near(number: Rounded, total: int, full: int = 100) -> bool:
    """Tell whether some count is less than one last digit away, however it was rounded."""
    exact = number.value * total / full
    counts = (math.floor(exact), math.ceil(exact))
    step = 2 * number.half
    return any(
        abs(Fraction(count * full, total) - number.value) < step
        for count in counts
        if 0 <= count <= total
    )


def chance_of_fit(number: Rounded, total: int, full: int = 100) -> float:
    """Return the chance that a number of so many digits, taken blindly, is a count of the total.

    A count that lies half way between two printed numbers may be either.
    """
    values: int = full * 10**number.decimals
    halves = math.gcd(total, 2 * values) - math.gcd(total, values)
    return min(1.0, (total + halves) / values)
