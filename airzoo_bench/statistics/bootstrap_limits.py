"""Limits of intervals from resamples, percentile and BCa, and the test that agrees with them.

They are those of Efron and Tibshirani, An introduction to the bootstrap (1993).
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr, ndtri

from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.statistics.samples import ResamplingConfig, difference

__all__: list[str] = []  # nothing here is for other rooms

_TIE = 1e-12  # of the numbers' size: closer ones differ by rounding alone


def quantiles(ranked: Floats, levels: Floats) -> Floats:
    """Take quantiles (R, L) of sorted rows (R, B), linear between ranks, infinite ones included."""
    place = levels * (ranked.shape[1] - 1)
    below = np.floor(place).astype(np.intp)
    above = np.minimum(below + 1, ranked.shape[1] - 1)
    low = np.take_along_axis(ranked, below, axis=1)
    high = np.take_along_axis(ranked, above, axis=1)
    share = place - below
    between = (share > 0) & np.isfinite(low)
    found: Floats = low + np.multiply(
        difference(high, low), share, out=np.zeros_like(low), where=between
    )
    # Between minus and plus infinity: a lower limit is the one, an upper limit the other.
    open_ = np.isneginf(low) & np.isposinf(high) & (share > 0) & (levels >= 0.5)
    return np.where(open_, np.inf, found)


def percentile_p_values(resamples: Floats) -> Floats:
    """Return the p up to which percentile intervals of confidence 1 - p of resamples hold 0, (R,).

    Test and interval agree, whichever the confidence. p is at least 2 / (B + 1) of B resamples.
    """
    ranked = np.sort(resamples, axis=1)
    levels = np.minimum(_level_of_0(ranked), _level_of_0(-ranked[:, ::-1]))
    return np.asarray(np.clip(2 * levels, 2 / (resamples.shape[1] + 1), 1.0))


def _level_of_0(ranked: Floats) -> Floats:
    """Return the highest level at which `quantiles` is at most 0, (R,)."""
    last = ranked.shape[1] - 1
    ranks = (ranked <= 0).sum(axis=1)
    upper = np.clip(ranks, 1, last)[:, None]
    below = np.take_along_axis(ranked, upper - 1, axis=1)[:, 0]
    above = np.take_along_axis(ranked, upper, axis=1)[:, 0]
    between = (below <= 0) & (above > 0) & np.isfinite(below) & np.isfinite(above)
    span = np.subtract(above, below, out=np.ones_like(below), where=between)
    # Between minus infinity and a number all is minus infinity, up to a number's infinity none is.
    share = np.where(between, -below / span, np.isneginf(below))
    inner = (ranks > 0) & (ranks <= last)
    found: Floats = np.where(inner, (ranks - 1 + share) / last, (ranks > 0).astype(np.float64))
    return found


def acceleration(moments: Floats) -> Floats:
    """Return the acceleration of BCa (eq. 14.15) from sums of influence values, (R,).

    `moments` (R, 2) are sums of the third and second power; NaN where all influence values are 0.
    """
    third, second = moments.T
    defined = (second > 0) & np.isfinite(second)
    found: Floats = np.divide(
        third,
        6 * np.where(defined, second, 1.0) ** 1.5,
        out=np.full(len(third), np.nan),
        where=defined,
    )
    return found


def interval_limits(
    resamples: Floats,
    estimates: Floats,
    scales: Floats,
    accelerations: Floats,
    resampling: ResamplingConfig,
) -> tuple[Floats, Bools]:
    """Take the limits of intervals (R, 2), and whether the kind that was asked for exists (R,).

    Elsewhere the limits are percentile's. `resamples` are (R, B) and `estimates` (R,); `scales`
    (R,) is the size of the numbers that a statistic is made of, since those of a difference may be
    large where it is almost 0. `accelerations` (R,) are NaN where BCa does not exist.
    """
    levels = np.broadcast_to(resampling.tails, (len(resamples), 2))
    exists = np.ones(len(resamples), np.bool_)
    if resampling.interval == "bca":
        adjusted = _bca_levels(resamples, estimates, scales, accelerations, resampling.tails)
        exists = np.asarray(np.isfinite(adjusted).all(axis=1))
        levels = np.where(exists[:, None], adjusted, levels)
    return quantiles(np.sort(resamples, axis=1), levels), exists


def _bca_levels(
    resamples: Floats, estimates: Floats, scales: Floats, accelerations: Floats, tails: Floats
) -> Floats:
    """Return the levels of eq. 14.10; a tie counts half."""
    tie = (_TIE * scales)[:, None]
    below = (resamples < estimates[:, None] - tie).sum(axis=1)
    up_to = (resamples <= estimates[:, None] + tie).sum(axis=1)
    bias = ndtri((below + up_to) / (2.0 * resamples.shape[1]))[:, None]
    finite = np.isfinite(bias)
    shifted = np.where(finite, bias, 0.0) + ndtri(tails)
    levels = ndtr(bias + shifted / (1 - accelerations[:, None] * shifted))
    return np.where(finite, levels, np.nan)
