"""What a printed number says of the true one: exact intervals, by its digits."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

__all__ = [
    "MOST_DECIMALS",
    "Interval",
    "Rounded",
    "decimal_text",
    "mean_interval",
    "parse_number",
]

MOST_DECIMALS = 9
"""Beyond these no table's digits reach, and whole numbers of 64 bits would overflow."""

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
    """Read a printed number; None for what is none.

    Parameters
    ----------
    text : str
        Such as ``96.21``, ``+1.73`` or ``-2.65``; a typographic minus and LaTeX's ``--`` count.
    """
    plain = text.strip().replace("--", "-").translate(_MINUS)
    if not _NUMBER.fullmatch(plain):
        return None
    return Rounded(plain, Fraction(plain), len(plain.partition(".")[2]))


def decimal_text(number: Fraction, decimals: int) -> str:
    """Write an exact number with so many decimals, halves away from zero.

    The digits are those of the exact number: no binary fraction comes between.
    """
    scaled = abs(number) * 10**decimals
    digits = str((2 * scaled.numerator + scaled.denominator) // (2 * scaled.denominator))
    sign = "-" if number < 0 and int(digits) else ""
    if decimals == 0:
        return sign + digits
    digits = digits.rjust(decimals + 1, "0")
    return f"{sign}{digits[:-decimals]}.{digits[-decimals:]}"


def mean_interval(intervals: Iterable[Interval], weights: Iterable[int] | None = None) -> Interval:
    """Return the interval of the mean of numbers, each known by an interval.

    Parameters
    ----------
    intervals : iterable of Interval
        At least one.
    weights : iterable of int, optional
        One each; all alike where not given.
    """
    parts = list(intervals)
    shares = [1] * len(parts) if weights is None else list(weights)
    total = sum(shares)
    low = sum((part.low * share for part, share in zip(parts, shares, strict=True)), Fraction(0))
    high = sum((part.high * share for part, share in zip(parts, shares, strict=True)), Fraction(0))
    return Interval(low / total, high / total)
