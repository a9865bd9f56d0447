"""Scores of a predicted cloud against the true one, from the distances between them.

All are the same, to the last bit, for any order of the points: counts are integers, sums are
exact before they are rounded once, and order statistics are distances that occur.

References
----------
Knapitsch, Park, Zhou, Koltun, Tanks and Temples: benchmarking large-scale scene reconstruction,
ACM Transactions on Graphics 36(4), 2017, for precision, recall and F1, and curves of them.

Seitz, Curless, Diebel, Scharstein, Szeliski, A comparison and evaluation of multi-view stereo
reconstruction algorithms, CVPR 2006, for accuracy and completeness. The Chamfer distance is the
mean of their two means, not the sum, and not of squares.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.geometry.arrays import Floats, Ints

__all__ = [
    "CloudScores",
    "Curve",
    "counts_below",
    "curve",
    "even_thresholds",
    "exact_mean",
    "f1_score",
    "score_distances",
]

_CHUNK = 1 << 18


@dataclass(frozen=True, eq=False)
class Curve:
    """Shares of points nearer than each of K thresholds.

    Attributes
    ----------
    thresholds : (K,) float64
        Increasing.
    precision, recall, f1 : (K,) float64
        0 to 1.
    """

    thresholds: Floats
    precision: Floats
    recall: Floats
    f1: Floats


@dataclass(frozen=True, eq=False)
class CloudScores:
    """All scores of one predicted cloud; distances are infinite where nothing is predicted.

    Attributes
    ----------
    accuracy, completeness, chamfer : float
        Mean distance of predicted points to the truth, of true points to the prediction, and the
        mean of the two.
    accuracy_median, completeness_median : float
        For an even count the mean of the two middle distances.
    curve : Curve
        Precision, recall and F1.
    """

    accuracy: float
    completeness: float
    chamfer: float
    accuracy_median: float
    completeness_median: float
    curve: Curve


def score_distances(
    to_truth: Floats, to_prediction: Floats, *, thresholds: Floats, max_distance: float | None
) -> CloudScores:
    """Score a prediction from the distances both ways.

    Parameters
    ----------
    to_truth : (P,) array
        Distance of each predicted point to the nearest true one; none where nothing is predicted.
    to_prediction : (T,) array
        Distance of each true point to the nearest predicted one, infinite where there is none.
    thresholds : (K,) array
        Of the curve: finite, increasing.
    max_distance : float or None
        Where given, a larger distance counts as this in accuracy, completeness and Chamfer
        distance, and in nothing else; an empty prediction stays infinitely far.

    Returns
    -------
    CloudScores
        In the units of the distances.

    Raises
    ------
    BenchmarkError
        No true point.
    ValueError
        See `counts_below`.
    """
    if len(to_prediction) == 0:
        raise BenchmarkError(
            "the true cloud holds no point",
            expected="at least one point, after cropping too",
            fix="check the benchmark's cloud and the protocol's crop",
        )
    limit = math.inf if max_distance is None or len(to_truth) == 0 else max_distance
    accuracy, completeness = exact_mean(to_truth, limit), exact_mean(to_prediction, limit)
    return CloudScores(
        accuracy=accuracy,
        completeness=completeness,
        chamfer=(accuracy + completeness) / 2.0,
        accuracy_median=float(np.median(to_truth)) if len(to_truth) else math.inf,
        completeness_median=float(np.median(to_prediction)),
        curve=curve(to_truth, to_prediction, thresholds),
    )


def curve(to_truth: Floats, to_prediction: Floats, thresholds: Floats) -> Curve:
    """Precision, recall and F1 at each threshold.

    Parameters
    ----------
    to_truth : (P,) array
        Distance of each predicted point to the truth; none where nothing is predicted.
    to_prediction : (T,) array
        Distance of each true point to the prediction, at least one.
    thresholds : (K,) array
        Finite, increasing; in the units of the distances.

    Returns
    -------
    Curve
        Of K values each; precision and F1 are 0 where nothing is predicted.

    Raises
    ------
    ValueError
        See `counts_below`.
    """
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
        Finite, increasing; in the units of the distances.

    Returns
    -------
    (K,) int64
        A count for each threshold.

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
    """Harmonic mean of precision and recall, ``2PR / (P + R)``.

    Parameters
    ----------
    precision, recall : (...) array
        0 to 1.

    Returns
    -------
    (...) array
        0 to 1; 0 where both are 0.
    """
    total = precision + recall
    score: Floats = 2.0 * precision * recall / np.where(total > 0.0, total, 1.0)
    return score


def even_thresholds(up_to: float, steps: int) -> Floats:
    """Return evenly spaced thresholds.

    Parameters
    ----------
    up_to : float
        The last one.
    steps : int
        How many.

    Returns
    -------
    (steps,) float64
        ``up_to / steps``, ..., `up_to`.
    """
    return up_to * np.arange(1, steps + 1) / steps


def exact_mean(distances: Floats, limit: float = math.inf) -> float:
    """Mean of distances: their exact sum, rounded once, over their number.

    Parameters
    ----------
    distances : (N,) array
        Not negative; may be infinite.
    limit : float
        A larger distance counts as this.

    Returns
    -------
    float
        Infinite where there are none.

    References
    ----------
    Shewchuk, Adaptive precision floating-point arithmetic, 1997, as in `math.fsum`.
    """
    if len(distances) == 0:
        return math.inf
    return math.fsum(_one_by_one(distances, limit)) / len(distances)


def _one_by_one(distances: Floats, limit: float) -> Iterator[float]:
    for start in range(0, len(distances), _CHUNK):
        yield from np.minimum(distances[start : start + _CHUNK], limit).tolist()
