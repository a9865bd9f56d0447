"""Rank ranges: between which ranks each of many methods may stand."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.statistics.pair_tests import normal_tail
from airzoo_bench.statistics.significance import LEVEL, holm

__all__ = ["correct_pairs", "rank_ranges", "told_apart", "unpaired_p_values"]


def correct_pairs(p_values: Floats) -> Floats:
    """Correct the tests (V, V) of every two variables for how many pairs there are, by Holm."""
    upper = np.triu_indices(len(p_values), 1)
    corrected = np.ones_like(p_values)
    corrected[upper] = holm(p_values[upper])
    return np.minimum(corrected, corrected.T)


def told_apart(values: Floats, corrected: Floats) -> Bools:
    """Return which two variables (V, V) differ significantly; never two whose values are equal."""
    return np.asarray((corrected <= LEVEL) & (values[:, None] != values))


def rank_ranges(values: Floats, corrected: Floats, *, higher_is_better: bool) -> NDArray[np.int64]:
    """Return between which ranks (V, 2) variables stand, by values (V,) and corrected p (V, V).

    Those are 1 + the number of significantly better ones, and V - the number of worse ones. With a
    chance of at least 95 % all true ranks lie in their ranges, since differences that are all
    significant together give confidence sets of ranks (Mogstad, Romano, Shaikh and Wilhelm 2024).
    """
    signed = values if higher_is_better else -values
    apart = told_apart(signed, corrected)
    better, worse = apart & (signed > signed[:, None]), apart & (signed < signed[:, None])
    return np.stack([1 + better.sum(axis=1), len(signed) - worse.sum(axis=1)], axis=1)


def unpaired_p_values(values: Floats, errors: Floats) -> Floats:
    """Test every two variables of which only standard errors (V,) are known, (V, V).

    p is that of a normal difference, and 1 of an infinite value or one without standard error. The
    errors are added, as of values that are perfectly opposed: whatever the correlation of two
    variables, their difference varies no more.
    """
    known = np.isfinite(values) & np.isfinite(errors)
    centre, spread = np.where(known, values, 0.0), np.where(known, errors, 1.0)
    apart = np.abs(centre[:, None] - centre)
    scale = spread[:, None] + spread
    scores = np.divide(apart, scale, out=np.zeros_like(apart), where=scale > 0)
    return np.where(known & known[:, None], normal_tail(scores), 1.0)
