"""Scores of a predicted cloud against the true one, from the distances between them.

All are the same, to the last bit, for any order of the points: counts are integers, sums are
exact before they are rounded once, and order statistics are distances that occur.

References
----------
Seitz, Curless, Diebel, Scharstein, Szeliski, A comparison and evaluation of multi-view stereo
reconstruction algorithms, CVPR 2006, for accuracy and completeness. The Chamfer distance is the
mean of their two means, not the sum, and not of squares.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.reconstruction.curves import counts_below, f1_score

__all__ = [
    "CloudScores",
    "DistanceSummary",
    "ThresholdScores",
    "exact_mean",
    "score_distances",
    "summarise_distances",
]

_CHUNK = 1 << 18


@dataclass(frozen=True)
class DistanceSummary:
    """Distances of all points of one cloud to the other.

    Attributes
    ----------
    count : int
        Points; where there are none, all else is infinite.
    mean : float
        The exact sum, rounded once, over the count.
    median : float
        For an even count the mean of the two middle distances.
    percentiles : dict of float to float
        The least distance that this percentage of points does not exceed (nearest rank).
    largest : float
    """

    count: int
    mean: float
    median: float
    percentiles: dict[float, float]
    largest: float


@dataclass(frozen=True)
class ThresholdScores:
    """What counts as right below a distance, strictly.

    Attributes
    ----------
    threshold : float
    predicted_right, true_found : int
        Predicted points near the truth, true points near the prediction.
    precision, recall, f1 : float
        0 to 1.
    """

    threshold: float
    predicted_right: int
    true_found: int
    precision: float
    recall: float
    f1: float


@dataclass(frozen=True)
class CloudScores:
    """All scores of one predicted cloud.

    Attributes
    ----------
    to_truth : DistanceSummary
        Of the predicted points. Its mean is the accuracy, unless distances are clipped.
    to_prediction : DistanceSummary
        Of the true points. Its mean is the completeness, unless distances are clipped.
    accuracy, completeness, chamfer : float
        Chamfer is the mean of the other two. All are infinite where nothing is predicted.
    at : tuple of ThresholdScores
        In the order of the thresholds.
    """

    to_truth: DistanceSummary
    to_prediction: DistanceSummary
    accuracy: float
    completeness: float
    chamfer: float
    at: tuple[ThresholdScores, ...]


def score_distances(
    to_truth: Floats,
    to_prediction: Floats,
    *,
    thresholds: Sequence[float],
    percentiles: Sequence[float],
    max_distance: float | None,
) -> CloudScores:
    """Score a prediction from the distances both ways.

    Parameters
    ----------
    to_truth : (P,) array
        Distance of each predicted point to the nearest true one; none where nothing is predicted.
    to_prediction : (T,) array
        Distance of each true point to the nearest predicted one, infinite where there is none.
    thresholds : sequence of float
        Positive, in any order.
    percentiles : sequence of float
        Above 0, at most 100.
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
        Distances that are negative or NaN; thresholds or percentiles out of range.
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
        to_truth=summarise_distances(to_truth, percentiles),
        to_prediction=summarise_distances(to_prediction, percentiles),
        accuracy=accuracy,
        completeness=completeness,
        chamfer=(accuracy + completeness) / 2.0,
        at=_at_thresholds(to_truth, to_prediction, thresholds),
    )


def summarise_distances(distances: Floats, percentiles: Sequence[float]) -> DistanceSummary:
    """Mean, median, percentiles and largest of distances.

    Parameters
    ----------
    distances : (N,) array
        Not negative; infinite ones are distances like all others.
    percentiles : sequence of float
        Above 0, at most 100.

    Returns
    -------
    DistanceSummary
        In the units of the distances.

    Raises
    ------
    ValueError
        A percentile out of range.
    """
    if not all(0.0 < percentile <= 100.0 for percentile in percentiles):
        raise ValueError(f"percentiles {list(percentiles)}, expected above 0 and at most 100")
    count = len(distances)
    if count == 0:
        return DistanceSummary(
            0, math.inf, math.inf, dict.fromkeys(percentiles, math.inf), math.inf
        )
    ranks = [max(math.ceil(percentile * count / 100.0), 1) - 1 for percentile in percentiles]
    wanted = [*ranks, (count - 1) // 2, count // 2, count - 1]
    *at_ranks, below, above, largest = np.partition(distances, sorted(set(wanted)))[wanted].tolist()
    return DistanceSummary(
        count=count,
        mean=exact_mean(distances),
        median=(below + above) / 2.0,
        percentiles=dict(zip(percentiles, at_ranks, strict=True)),
        largest=largest,
    )


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


def _at_thresholds(
    to_truth: Floats, to_prediction: Floats, thresholds: Sequence[float]
) -> tuple[ThresholdScores, ...]:
    increasing = np.array(sorted(set(thresholds)), dtype=np.float64)
    right, found = counts_below(to_truth, increasing), counts_below(to_prediction, increasing)
    precision, recall = right / max(len(to_truth), 1), found / len(to_prediction)
    columns = (increasing, right, found, precision, recall, f1_score(precision, recall))
    rows = zip(*(column.tolist() for column in columns), strict=True)
    scores = {row[0]: ThresholdScores(*row) for row in rows}
    return tuple(scores[float(threshold)] for threshold in thresholds)
