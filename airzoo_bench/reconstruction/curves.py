"""Precision, recall and F1 over the distance below which a point counts as right.

References
----------
Knapitsch, Park, Zhou, Koltun, Tanks and Temples: benchmarking large-scale scene reconstruction,
ACM Transactions on Graphics 36(4), 2017, for the three and for curves of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from airzoo_bench.geometry.arrays import Floats, Ints

__all__ = ["Curve", "counts_below", "curve", "even_thresholds", "f1_score"]

_CHUNK = 1 << 20


@dataclass(frozen=True, eq=False)
class Curve:
    """Shares of points nearer than each of T thresholds.

    Attributes
    ----------
    thresholds : (T,) float64
        Increasing.
    precision, recall, f1 : (T,) float64
        0 to 1.
    """

    thresholds: Floats
    precision: Floats
    recall: Floats
    f1: Floats


def curve(to_truth: Floats, to_prediction: Floats, thresholds: Floats) -> Curve:
    """Precision, recall and F1 at each threshold.

    Parameters
    ----------
    to_truth : (P,) array
        Distance of each predicted point to the truth; none where nothing is predicted.
    to_prediction : (T,) array
        Distance of each true point to the prediction, at least one.
    thresholds : (K,) array
        Positive, increasing.

    Returns
    -------
    Curve

    Raises
    ------
    ValueError
        See `counts_below`; or no true point.
    """
    if len(to_prediction) == 0:
        raise ValueError("no true point")
    precision = counts_below(to_truth, thresholds) / max(len(to_truth), 1)
    recall = counts_below(to_prediction, thresholds) / len(to_prediction)
    return Curve(thresholds, precision, recall, f1_score(precision, recall))


def counts_below(distances: Floats, thresholds: Floats) -> Ints:
    """How many distances are strictly below each threshold.

    Parameters
    ----------
    distances : (N,) array
        Infinite ones are below none.
    thresholds : (K,) array
        Increasing, not infinite.

    Returns
    -------
    (K,) int64

    Raises
    ------
    ValueError
        Thresholds that do not increase or are not finite; distances that are negative or NaN.
    """
    if not (np.isfinite(thresholds).all() and (np.diff(thresholds) > 0.0).all()):
        raise ValueError("thresholds must be finite and increase")
    histogram = np.zeros(len(thresholds) + 1, dtype=np.int64)
    for start in range(0, len(distances), _CHUNK):
        part = distances[start : start + _CHUNK]
        if not (part >= 0.0).all():
            raise ValueError("distances that are negative or NaN")
        # A distance equal to a threshold falls behind it, and so is not below it.
        behind = np.searchsorted(thresholds, part, side="right")
        histogram += np.bincount(behind, minlength=len(histogram))
    counts: Ints = np.cumsum(histogram[:-1])
    return counts


def f1_score(precision: Floats, recall: Floats) -> Floats:
    """Harmonic mean of precision and recall, ``2PR / (P + R)``; 0 where both are 0."""
    total = np.asarray(precision) + recall
    score: Floats = 2.0 * precision * recall / np.where(total > 0.0, total, 1.0)
    return score


def even_thresholds(up_to: float, steps: int) -> Floats:
    """Return `steps` thresholds, evenly spaced: ``up_to / steps``, ..., `up_to`."""
    return up_to * np.arange(1, steps + 1) / steps
