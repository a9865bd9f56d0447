"""What a printed number says of the true one: exact intervals, and the counts that round to it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

__all__ = [
    "Interval",
    "Rounded",
    "chance_of_fit",
    "count_text",
    "counted_share",
    "decimal_text",
    "is_cut",
    "is_near",
    "mean_interval",
    "parse_number",
    "possible_counts",
]

_NUMBER = re.compile(r"[+-]?[0-9]{1,9}(\.[0-9]{1,9})?")
_MINUS = str.maketrans({"−": "-", "–": "-"})


@dataclass(frozen=True)
class Interval:
    """A closed interval of exact numbers."""

    low: Fraction
    high: Fraction

    def meets(self, other: Interval) -> bool:
        """Whether a number lies in both."""
        return self.low <= other.high and other.low <= self.high

    def times(self, factor: Fraction) -> Interval:
        """Return the interval times a number, which may be negative."""
        ends = (self.low * factor, self.high * factor)
        return Interval(min(ends), max(ends))

    def widened(self, by: Fraction) -> Interval:
        """Return the interval with so much more at either end."""
        return Interval(self.low - by, self.high + by)

    def plus(self, other: Interval) -> Interval:
        """Return the interval of sums."""
        return Interval(self.low + other.low, self.high + other.high)


@dataclass(frozen=True)
class Rounded:
    """A number as printed.

    Attributes
    ----------
    text : str
        As printed, trailing zeros included.
    value : Fraction
        What the digits say.
    decimals : int
        How many digits follow the point.
    """

    text: str
    value: Fraction
    decimals: int

    @property
    def half(self) -> Fraction:
        """Half a step of the last digit."""
        return Fraction(1, 2 * 10**self.decimals)

    @cached_property
    def interval(self) -> Interval:
        """Where the true number lies; closed, so that halves may have gone up, down or to even."""
        return Interval(self.value - self.half, self.value + self.half)


def parse_number(text: str) -> Rounded | None:
    """Read a printed number; None for what is none."""
    plain = text.strip().replace("--", "-").translate(_MINUS)
    if not _NUMBER.fullmatch(plain):
        return None
    return Rounded(plain, Fraction(plain), len(plain.partition(".")[2]))


def decimal_text(number: Fraction, decimals: int) -> str:
    """Write an exact number with so many decimals, halves away from zero."""
    scaled = abs(number) * 10**decimals
    digits = str((2 * scaled.numerator + scaled.denominator) // (2 * scaled.denominator))
    sign = "-" if number < 0 and int(digits) else ""
    if decimals == 0:
        return sign + digits
    digits = digits.rjust(decimals + 1, "0")
    return f"{sign}{digits[:-decimals]}.{digits[-decimals:]}"


def mean_interval(intervals: Iterable[Interval], weights: Iterable[int] | None = None) -> Interval:
    """Return the interval of the mean of numbers, each known by an interval."""
    parts = list(intervals)
    shares = [1] * len(parts) if weights is None else list(weights)
    total = sum(shares)
    low = sum((part.low * share for part, share in zip(parts, shares, strict=True)), Fraction(0))
    high = sum((part.high * share for part, share in zip(parts, shares, strict=True)), Fraction(0))
    return Interval(low / total, high / total)


def possible_counts(number: Rounded, total: int, full: int = 100) -> range:
    """Return the counts out of a total that round to a printed share, halves either way."""
    scaled = number.interval.times(Fraction(total, full))
    return range(max(0, math.ceil(scaled.low)), min(total, math.floor(scaled.high)) + 1)


def counted_share(number: Rounded, total: int, full: int = 100) -> Interval:
    """Return the interval of the true share in printed units, narrowed to counts where any fits."""
    counts = possible_counts(number, total, full)
    if not counts:
        return number.interval
    return Interval(Fraction(counts[0] * full, total), Fraction(counts[-1] * full, total))


def count_text(number: Rounded, total: int, full: int = 100) -> str:
    """Name the counts next to a printed share, such as ``254/264 = 96.21``."""
    exact = number.value * total / full
    near = sorted({min(max(count, 0), total) for count in (math.floor(exact), math.ceil(exact))})
    return ", ".join(
        f"{count}/{total} = {decimal_text(Fraction(count * full, total), number.decimals)}"
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
    """Return the chance that a number of so many digits, taken blindly, is a count of the total."""
    values: int = full * 10**number.decimals
    halves = math.gcd(total, 2 * values) - math.gcd(total, values)
    return min(1.0, (total + halves) / values)
