"""Scores of point clouds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.api.arrays import choice, numbers, positive, refused, whole
from airzoo_bench.api.labels import same_columns
from airzoo_bench.core.errors import ArgumentError, counted
from airzoo_bench.core.shown import Shown, number
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.reconstruction.clouds import InMemoryCloud, finite_rows
from airzoo_bench.reconstruction.distances import cloud_distances
from airzoo_bench.reconstruction.metrics import score_distances
from airzoo_bench.reconstruction.preparation import box_of, cropped_region, prepare_cloud
from airzoo_bench.reconstruction.settings import Preparation

__all__ = ["CloudComparison", "cloud_scores"]

# What the shipped protocols state for a threshold of 10 m, as shares of it.
_MOST_THREADS = 256  # of more, OpenMP ends the process where memory is short
_VOXELS, _CELLS, _CLIP = 1 / 20, 1 / 2, 10.0
_UNUSED = 1.0  # values of the region that photos observe


@dataclass(frozen=True, eq=False, repr=False)
class CloudComparison(Shown):
    """What came of comparing a predicted cloud with the true one.

    Attributes
    ----------
    threshold : float
    precision, recall, f1 : float
        0 to 1.
    chamfer, accuracy, completeness : float
        Means of distances, in units of the clouds; infinite where nothing is predicted.
    predicted_points, true_points : int
        Points that were compared.
    not_finite, outside, thinned : int
        Predicted points that were not: NaN or infinite, cropped, merged by voxels.
    to_truth, to_prediction : (P,), (T,) float64
        Distance of each point to the nearest of the other cloud, for further scores.
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
    to_truth: Floats = field(repr=False)
    to_prediction: Floats = field(repr=False)

    def _shown(self) -> Mapping[str, object]:
        scores = ("precision", "recall", "f1", "chamfer", "accuracy", "completeness")
        counts = ("predicted_points", "true_points", "not_finite", "outside", "thinned")
        return {
            "threshold": f"{self.threshold:g}",
            **{name: number(getattr(self, name)) for name in scores},
            **{name: getattr(self, name) for name in counts},
        }


def cloud_scores(
    predicted: ArrayLike,
    true: ArrayLike,
    threshold: float = 10.0,
    *,
    voxel: float | Literal["auto"] | None = "auto",
    crop: Literal["covered", "box"] | None = "covered",
    max_distance: float | Literal["auto"] | None = "auto",
    jobs: int = 1,
) -> CloudComparison:
    """Score a predicted cloud: Chamfer distance, precision, recall, F1.

    What the reconstruction track does once a prediction is aligned, with recall over all true
    points (``region = "all"``). Other evaluations compare clouds as they are; so does this one
    with ``voxel=None, crop=None, max_distance=None``.

    Parameters
    ----------
    predicted : (P, 3) array-like
        In the frame of the truth. Points that are NaN or infinite are left out and counted; an
        empty cloud scores 0.
    true : (T, 3) array-like
        In units of the threshold.
    threshold : float
        A point counts as right nearer than this, strictly; in units of the clouds.
    voxel : float, "auto" or None
        Side of the voxels that both clouds are thinned by, to the mean of the points in each;
        a twentieth of the threshold where left out.
    crop : {"covered", "box"} or None
        What of both clouds counts: columns that the true cloud covers, or its box, grown by the
        threshold.
    max_distance : float, "auto" or None
        What a larger distance counts as in Chamfer distance, accuracy and completeness; ten times
        the threshold where left out.
    jobs : int
        Threads; the scores do not depend on it.

    Returns
    -------
    CloudComparison
        Precision is the share of predicted points that are right, recall that of true points near
        a predicted one, F1 their harmonic mean. Accuracy and completeness are the means of the
        distances from prediction to truth and back, the Chamfer distance the mean of the two: not
        their sum, and not of squares.

    Raises
    ------
    ArgumentError
        Another shape, a threshold that is not above 0, a true cloud with no point, a predicted
        one with no finite point among those that it has.

    References
    ----------
    Knapitsch et al., Tanks and Temples, ACM TOG 36(4), 2017; Seitz et al., CVPR 2006.

    Examples
    --------
    >>> true = [[0.0, 0, 0], [4, 0, 0], [8, 0, 0], [12, 0, 0]]
    >>> found = cloud_scores([[0.0, 0, 1], [4, 0, 1], [8, 0, 5]], true, threshold=2)
    >>> found
    CloudComparison
      threshold         2
      precision         1.0000
      recall            0.5000
      f1                0.6667
      chamfer           2.2732
      accuracy          1.0000
      completeness      3.5463
      predicted_points  2
      true_points       4
      not_finite        0
      outside           1
      thinned           0
    """
    same_columns({"predicted": predicted, "true": true}, may_be_renamed=True)
    limit = positive("threshold", threshold)
    clip = _length("max_distance", max_distance, limit * _CLIP)
    settings = _preparation(limit, _length("voxel", voxel, limit * _VOXELS), crop)
    given, truth = (
        InMemoryCloud(_points(name, values, limit))
        for name, values in (("predicted", predicted), ("true", true))
    )
    if given.count and not finite_rows(given.points).any():
        raise ArgumentError(
            f"none of {counted(given.count, 'point')} is finite",
            where="predicted",
            expected="finite numbers",
        )
    block = max(given.count, truth.count, 1)
    with refused("true"):
        region = cropped_region(truth, box_of(truth), settings, block)
        kept, known = (prepare_cloud(cloud, settings, region, block) for cloud in (given, truth))
        distances = cloud_distances(
            kept.source,
            known.source,
            block_points=block,
            jobs=min(whole("jobs", jobs), _MOST_THREADS),
        )
    scores = score_distances(
        distances.to_truth,
        distances.to_prediction,
        thresholds=np.array([limit]),
        max_distance=clip,
    )
    at = scores.curve
    return CloudComparison(
        threshold=limit,
        precision=float(at.precision[0]),
        recall=float(at.recall[0]),
        f1=float(at.f1[0]),
        chamfer=scores.chamfer,
        accuracy=scores.accuracy,
        completeness=scores.completeness,
        predicted_points=len(distances.to_truth),
        true_points=len(distances.to_prediction),
        not_finite=kept.not_finite,
        outside=kept.outside,
        thinned=kept.thinned,
        to_truth=distances.to_truth,
        to_prediction=distances.to_prediction,
    )


def _points(name: str, values: ArrayLike, limit: float) -> Floats:
    """Return points (N, 3), finite or not, whose type keeps a twentieth of the threshold."""
    given = numbers(name, values, (None, 3))
    points = given.astype(np.float64)
    if given.dtype.kind == "f" and given.dtype.itemsize < points.dtype.itemsize:
        largest = np.abs(points[np.isfinite(points)]).max(initial=0.0)
        step = float(np.spacing(given.dtype.type(largest)))
        if step > limit / 20.0:
            raise ArgumentError(
                f"is {given.dtype}, which keeps coordinates such as {largest:.0f} to {step:.2g} "
                "only, next to the threshold",
                where=name,
                expected="float64, or coordinates from a local origin",
            )
    return points


def _length(name: str, value: float | Literal["auto"] | None, automatic: float) -> float | None:
    if value is None:
        return None
    return automatic if isinstance(value, str) and value == "auto" else positive(name, value)


def _preparation(
    threshold: float, voxel: float | None, crop: Literal["covered", "box"] | None
) -> Preparation:
    choice("crop", crop, ("covered", "box", None))
    return Preparation(
        crop="none" if crop is None else crop,
        crop_margin_m=threshold,
        crop_cell_m=threshold * _CELLS,
        region="all",
        observed_photos=1,
        observed_cell_m=_UNUSED,
        hidden_beyond_m=_UNUSED,
        voxel_m="none" if voxel is None else voxel,
    )
