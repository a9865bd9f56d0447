"""Correction of p-values for how many were looked at."""

from __future__ import annotations

import numpy as np

from airzoo_bench.geometry.arrays import Floats

__all__ = ["holm"]


def holm(p_values: Floats) -> Floats:
    """Adjust p-values so that the chance of any false finding stays below the level.

    Parameters
    ----------
    p_values : (M,) array

    Returns
    -------
    (M,) array
        In the same order, at most 1.

    References
    ----------
    S. Holm, A simple sequentially rejective multiple test procedure, Scandinavian Journal of
    Statistics 6 (1979).
    """
    order = np.argsort(p_values, kind="stable")
    factors = np.arange(len(p_values), 0, -1)
    adjusted = np.empty(len(p_values))
    adjusted[order] = np.minimum(np.maximum.accumulate(p_values[order] * factors), 1.0)
    return adjusted
