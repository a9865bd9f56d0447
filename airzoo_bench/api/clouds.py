"""Clouds from Python: Chamfer distance, precision, recall and F1."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.api import arguments as arg
from airzoo_bench.api.scores import Scores
from airzoo_bench.reconstruction.clouds import box_of, cloud_of, cropped_region, prepare_cloud
from airzoo_bench.reconstruction.distances import cloud_distances
from airzoo_bench.reconstruction.metrics import curve, mean_distances
from airzoo_bench.reconstruction.settings import Preparation

__all__ = ["cloud_scores"]


def cloud_scores(
    predicted: ArrayLike,
    true: ArrayLike,
    threshold: float = 10.0,
    *,
    plain: bool = False,
    jobs: int = 1,
) -> Scores:
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
    Scores
        ``precision``, ``recall``, ``f1``, 0 to 1; ``accuracy`` and ``completeness``, the mean
        distances to the truth and back, and their mean ``chamfer``, infinite where nothing is
        predicted; ``not_finite``, ``outside``, ``thinned``, numbers of predicted points that are
        not compared; ``to_truth`` (P,) and ``to_prediction`` (T,), the distance of each other one.

    Raises
    ------
    ArgumentError
        Another shape, too few digits, a threshold that is not above 0, no true point.

    Examples
    --------
    >>> true = [[0.0, 0, 0], [4, 0, 0], [8, 0, 0], [12, 0, 0]]
    >>> found = cloud_scores([[0.0, 0, 1], [4, 0, 1], [8, 0, 5]], true, threshold=2)
    >>> found.precision, found.recall, round(found.chamfer, 4), found.outside
    (1.0, 0.5, 2.2732, 1)
    """
    limit, threads = arg.positive("threshold", threshold), min(arg.whole("jobs", jobs), 256)
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
    clouds = []
    for name, values in (("predicted", predicted), ("true", true)):
        points = arg.floats(name, values, (None, 3))
        finite = points[np.isfinite(points).all(axis=1)]
        if len(points) and not len(finite):
            raise arg.fault(name, "has no finite point", "finite numbers")
        kind = arg.as_array(name, values).dtype.type
        arg.check_digits(name, finite, kind, coarsest=limit / 20)
        clouds.append(cloud_of(points))
    block = max(*(cloud.count for cloud in clouds), 1)
    with arg.refused("true"):
        region = cropped_region(clouds[1], box_of(clouds[1]), settings, block)
        kept, known = (prepare_cloud(cloud, settings, region, block) for cloud in clouds)
    found = cloud_distances(kept.source, known.source, block_points=block, jobs=threads)
    means = mean_distances(*found, None if plain else 10 * limit)
    means = {name: means[name] for name in ("chamfer", "accuracy", "completeness")}
    below = curve(*found, np.array([limit]))
    shares = {name: float(getattr(below, name)[0]) for name in ("precision", "recall", "f1")}
    left_out = {name: getattr(kept, name) for name in ("not_finite", "outside", "thinned")}
    arrays = {"to_truth": found.to_truth, "to_prediction": found.to_prediction}
    return Scores(shares | means | left_out, **arrays)
