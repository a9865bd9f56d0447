"""Out of how many several printed shares are counts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.tables.printed_numbers import Rounded

__all__ = ["Implied", "implied_total"]

# From 10^(decimals + 2) on every percentage is a count; beyond this no table's digits reach.
_LARGEST = 100_000
_SHOWN = 3
# How often a printed share is no count at all. That rare, a misprint does not speak for half a
# total only because the other counts happen to be even.
_MISPRINT = 1e-3

_Told = tuple[Fraction, int, int, int]


@dataclass(frozen=True)
class Implied:
    """The total that shares imply.

    Attributes
    ----------
    total : int
        The likeliest.
    fits, values : int
        How many of the different values are counts out of it.
    probability : float
        Of this total against all others, and against there being none.
    as_good : tuple of int
        The next larger ones that as many values fit: mostly multiples.
    """

    total: int
    fits: int
    values: int
    probability: float
    as_good: tuple[int, ...]


def implied_total(shares: Iterable[tuple[Rounded, int, int]]) -> Implied | None:
    """Find out of how many several printed shares are counts."""
    told = sorted(
        {(n.value, n.decimals, full, places) for n, full, places in shares if 0 < n.value < full}
    )
    if not told:
        return None
    largest = min(_LARGEST, max(full * 10**decimals for _, decimals, full, _ in told))
    totals = np.arange(1, largest + 1, dtype=np.int64)
    fits, merit = _weigh(told, totals)
    best = int(np.argmax(merit))
    as_good = totals[(totals > totals[best]) & (fits >= fits[best])][:_SHOWN]
    rivals = float(np.exp(merit - merit[best]).sum()) + math.exp(-max(merit[best], -700.0))
    return Implied(
        int(totals[best]),
        int(fits[best]),
        len(told),
        1 / rivals,
        tuple(int(total) for total in as_good),
    )


def _weigh(
    told: Sequence[_Told], totals: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return for each total how many values fit, and the log of how likely it is."""
    fits = np.zeros(len(totals), dtype=np.int64)
    merit = -np.log(totals)
    printed = {(places, full * 10**decimals) for _, decimals, full, places in told}
    chances = {(p, values): _chance(totals * p, values) for p, values in printed}
    for value, decimals, full, places in told:
        fit = _fitting(value, decimals, full, totals * places)
        chance = chances[places, full * 10**decimals]
        fits += fit
        merit += np.where(fit, -np.log(chance), math.log(_MISPRINT))
    return fits, merit


def _chance(totals: NDArray[np.int64], values: int) -> NDArray[np.float64]:
    """Return what part of so many printed values are counts of each total."""
    halves = np.gcd(totals, 2 * values) - np.gcd(totals, values)
    return np.asarray(np.minimum(1.0, (totals + halves) / values), dtype=np.float64)


def _fitting(
    value: Fraction, decimals: int, full: int, totals: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Tell of which totals a value is a count, in whole numbers throughout."""
    scale = 2 * full * 10**decimals
    steps = 2 * int(value * 10**decimals)
    # At most 2 x 10^11 x 10^5 x 10^2: no overflow.
    lowest = -((-(steps - 1) * totals) // scale)
    return np.asarray(lowest <= ((steps + 1) * totals) // scale)
