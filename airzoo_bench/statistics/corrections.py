"""Corrections of p-values for how many comparisons were looked at."""

from __future__ import annotations

import numpy as np

from airzoo_bench.geometry.arrays import Floats

__all__ = ["holm"]


def holm(p_values: Floats, family: int | None = None) -> Floats:
    """Adjust p-values so that the chance of any false finding stays below the level.

    Parameters
    ----------
    p_values : (M,) array
        Of the comparisons that are reported.
    family : int, optional
        How many were looked at, at least M; M where left out. Those that are not given count as 1,
        so that the given ones come out as large as they can.

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
    factors = (family or len(p_values)) - np.arange(len(p_values))
    adjusted = np.empty(len(p_values))
    adjusted[order] = np.minimum(np.maximum.accumulate(p_values[order] * factors), 1.0)
    return adjusted
