"""Clouds from Python: Chamfer distance, precision, recall and F1."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.api import arguments as arg
from airzoo_bench.core.shown import Shown, number
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.reconstruction.clouds import cloud_of, finite_rows
from airzoo_bench.reconstruction.distances import cloud_distances
from airzoo_bench.reconstruction.metrics import score_distances
from airzoo_bench.reconstruction.preparation import box_of, cropped_region, prepare_cloud
from airzoo_bench.reconstruction.settings import Preparation

__all__ = ["CloudComparison", "cloud_scores"]

_MOST_THREADS = 256  # of more, OpenMP ends the process where memory is short


@dataclass(frozen=True, eq=False, repr=False)
class CloudComparison(Shown):
    """The scores of a predicted cloud against the true one.

    Attributes
    ----------
    threshold, precision, recall, f1 : float
        The last three from 0 to 1.
    chamfer, accuracy, completeness : float
        Means of distances, in units of the clouds; infinite where nothing is predicted.
    predicted_points, true_points : int
        Points that were compared.
    not_finite, outside, thinned : int
        Predicted points that were not: NaN or infinite, cropped, merged by voxels.
    to_truth, to_prediction : (P,), (T,) float64
        Distance of each point to the nearest of the other cloud.
    """

    threshold: float
    precision: float
    recall: float
    f1: float
    chamfer: float
    accuracy: float
    completeness: float
    predicted_points: int
    true_points: int
    not_finite: int
    outside: int
    thinned: int
    to_truth: Floats
    to_prediction: Floats

    def _display_fields(self) -> Mapping[str, object]:
        values = {field.name: getattr(self, field.name) for field in fields(self)[:-2]}
        return {n: number(v) if isinstance(v, float) else v for n, v in values.items()}


def cloud_scores(
    predicted: ArrayLike,
    true: ArrayLike,
    threshold: float = 10.0,
    *,
    plain: bool = False,
    jobs: int = 1,
) -> CloudComparison:
    """Score a predicted cloud as the reconstruction track does once it is aligned.

    Both clouds are cropped to the columns that the truth covers, grown by the threshold, and
    thinned by voxels of a twentieth of it; recall is over all true points (``region = "all"``).

    Source: Knapitsch et al., Tanks and Temples, ACM TOG 36(4), 2017; Seitz et al., CVPR 2006.

    Parameters
    ----------
    predicted : (P, 3) array-like
        In the frame of the truth. Points that are not finite are left out and counted; an empty
        cloud scores 0.
    true : (T, 3) array-like
        In units of the threshold.
    threshold : float
        Points nearer than this, strictly, are right.
    plain : bool
        Compare the clouds as they are; else distances count as at most ten times the threshold.
    jobs : int
        Threads; the scores do not depend on it.

    Returns
    -------
    CloudComparison
        Precision is the share of predicted points that are right, recall that of true points near
        a predicted one, F1 their harmonic mean; accuracy and completeness are the mean distances
        to the truth and back, the Chamfer distance the mean of these two.

    Raises
    ------
    ArgumentError
        Another shape, too few digits, a threshold that is not above 0, no true point, or
        predicted points of which none is finite.

    Examples
    --------
    >>> true = [[0.0, 0, 0], [4, 0, 0], [8, 0, 0], [12, 0, 0]]
    >>> found = cloud_scores([[0.0, 0, 1], [4, 0, 1], [8, 0, 5]], true, threshold=2)
    >>> found.precision, found.recall, round(found.chamfer, 4), found.outside
    (1.0, 0.5, 2.2732, 1)
    """
    limit = arg.positive("threshold", threshold)
    # The settings of the shipped protocols, as shares of the threshold.
    settings = Preparation(
        crop="none" if plain else "covered",
        crop_margin_m=limit,
        crop_cell_m=limit / 2,
        region="all",
        observed_photos=1,  # of regions that photos observe, as is the rest
        observed_cell_m=1.0,
        hidden_beyond_m=1.0,
        voxel_m="none" if plain else limit / 20,
    )
    points, true_points = _points("predicted", predicted, limit), _points("true", true, limit)
    given, truth = cloud_of(points), cloud_of(true_points)
    if given.count and not finite_rows(points).any():
        raise arg.fault("predicted", "no point is finite", "finite numbers")
    threads = min(arg.whole("jobs", jobs), _MOST_THREADS)
    block = max(given.count, truth.count, 1)
    with arg.refused("true"):
        region = cropped_region(truth, box_of(truth), settings, block)
        kept, known = (prepare_cloud(cloud, settings, region, block) for cloud in (given, truth))
    found = cloud_distances(kept.source, known.source, block_points=block, jobs=threads)
    scores = score_distances(
        *found,
        thresholds=np.array([limit]),
        max_distance=None if plain else 10 * limit,
    )
    precision, recall, f1 = (
        float(share[0]) for share in (scores.curve.precision, scores.curve.recall, scores.curve.f1)
    )
    means = (scores.chamfer, scores.accuracy, scores.completeness)
    counts = (len(found.to_truth), len(found.to_prediction))
    left_out = (kept.not_finite, kept.outside, kept.thinned)
    return CloudComparison(limit, precision, recall, f1, *means, *counts, *left_out, *found)


def _points(name: str, values: ArrayLike, limit: float) -> Floats:
    """Return points (N, 3), finite or not, whose type keeps a twentieth of the threshold."""
    given = arg.numbers(name, values, (None, 3))
    points = given.astype(np.float64)
    arg.check_digits(name, points[np.isfinite(points)], given.dtype.type, limit / 20)
    return points
