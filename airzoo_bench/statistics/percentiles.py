"""Percentiles of resamples, and the test that agrees with the intervals that they make."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.statistics.samples import gap

__all__ = ["percentile_p_values", "quantiles"]


def quantiles(ranked: Floats, levels: Floats) -> Floats:
    """Take quantiles, linear between ranks; NumPy's own make NaN of infinite ones.

    Parameters
    ----------
    ranked : (R, B) array
        Sorted along the rows; infinite values are values like any other.
    levels : (R, L) array
        From 0 to 1.

    Returns
    -------
    (R, L) array
    """
    place = levels * (ranked.shape[1] - 1)
    below = np.floor(place).astype(np.intp)
    above = np.minimum(below + 1, ranked.shape[1] - 1)
    low = np.take_along_axis(ranked, below, axis=1)
    high = np.take_along_axis(ranked, above, axis=1)
    share = place - below
    between = (share > 0) & np.isfinite(low)
    found: Floats = low + np.multiply(gap(high, low), share, out=np.zeros_like(low), where=between)
    return found


def percentile_p_values(resamples: Floats) -> Floats:
    """Test whether statistics are 0 by the percentile intervals of their resamples, two-sided.

    Parameters
    ----------
    resamples : (R, B) array

    Returns
    -------
    (R,) array
        The p up to which the interval of confidence 1 - p holds 0: whichever the confidence, test
        and interval agree. At least 2 / (B + 1).

    References
    ----------
    B. Efron and R. Tibshirani, An introduction to the bootstrap (1993), section 15.4.
    """
    count = resamples.shape[1]
    ranked = np.sort(resamples, axis=1)
    up_to, below = (ranked <= 0).sum(axis=1), (ranked < 0).sum(axis=1)
    low, high = _level_of_0(ranked, up_to), 1.0 - _level_of_0(ranked, below)
    return np.asarray(np.clip(2 * np.minimum(low, high), 2 / (count + 1), 1.0))


def _level_of_0(ranked: Floats, ranks: NDArray[np.intp]) -> Floats:
    """Return at which level `quantiles` passes 0, between the ranks beside it, (R,)."""
    last = ranked.shape[1] - 1
    inner = (ranks > 0) & (ranks <= last)
    rank = np.clip(ranks, 1, last)[:, None]
    one = np.take_along_axis(ranked, rank - 1, axis=1)[:, 0]
    other = np.take_along_axis(ranked, rank, axis=1)[:, 0]
    finite = inner & np.isfinite(one) & np.isfinite(other)
    # A step to infinity is made at once; one from minus infinity, at the very end.
    share = np.where(np.isneginf(one), 1.0, 0.0)
    span = np.where(finite, other - one, 1.0)
    share = np.where(finite, -one / span, share)
    return np.asarray(np.where(inner, (ranks - 1 + share) / last, np.where(ranks > 0, 1.0, 0.0)))
