"""Corrections of p-values for how many comparisons were looked at."""

from __future__ import annotations

import numpy as np

from airzoo_bench.geometry.arrays import Floats

__all__ = ["holm"]


def holm(p_values: Floats, family: int | None = None) -> Floats:
    """Adjust p-values (M,) so that the chance of any false finding stays below a level (Holm 1979).

    `family` is how many comparisons were looked at, at least M. Those that are not given count as
    1, so that the given ones come out as large as they can.
    """
    order = np.argsort(p_values, kind="stable")
    factors = (family or len(p_values)) - np.arange(len(p_values))
    adjusted = np.empty(len(p_values))
    adjusted[order] = np.minimum(np.maximum.accumulate(p_values[order] * factors), 1.0)
    return adjusted
