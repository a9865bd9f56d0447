"""Galleries whose descriptors all point one way, of which no ranking means anything."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.retrieval.descriptor_rows import Rows, as_float32
from airzoo_bench.retrieval.similarity import Metric, normalised, norms_of, unusable

__all__ = ["direction", "one_way"]


def one_way(rows: Rows, first: Floats, metric: Metric, step: int) -> bool:
    """Whether all rows are the same as one, or under cosine multiples of it as far as stored."""
    for _, some in rows.blocks(step):
        found = unusable(norms_of(some, as_float32(some)), np.isfinite, metric)
        if len(found["wild"]) or len(found["zero"]):
            return False
        near = _storage_error(some, first) if metric == "cosine" else 0.0
        if not (np.abs(direction(some, metric) - first) <= near).all():
            return False
    return True


def direction(rows: NDArray[Any], metric: Metric) -> Floats:
    """Return what of rows decides their order: their direction under cosine, else the rows."""
    if metric != "cosine":
        return rows.astype(np.float64)
    with np.errstate(all="ignore"):  # what is not finite is near nothing, and refused elsewhere
        return normalised(rows)


def _storage_error(rows: NDArray[Any], direction: Floats) -> Floats:
    """How far storage may have turned rows (n, D) away from a direction (1, D)."""
    stored = np.finfo(rows.dtype)
    lost = float(stored.smallest_subnormal) / np.abs(rows).max(axis=1, keepdims=True)
    return np.asarray(4 * float(stored.eps) * np.abs(direction) + 2 * lost.astype(np.float64))
