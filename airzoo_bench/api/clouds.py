"""Reconstructions from Python: scores of clouds, and the alignment of cameras."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.api import arguments as arg
from airzoo_bench.api.arguments import Scores
from airzoo_bench.api.poses import read_cameras
from airzoo_bench.reconstruction.alignment import LEAST_CAMERAS, fit_cameras, umeyama
from airzoo_bench.reconstruction.clouds import box_of, cloud_of, find_crop, prepare_cloud
from airzoo_bench.reconstruction.distances import cloud_distances
from airzoo_bench.reconstruction.metrics import curve, mean_distances

__all__ = ["align_cameras", "cloud_scores"]


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
        In the frame of the truth; points that are not finite are left out, no point scores 0.
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
    """
    limit, threads = arg.positive("threshold", threshold), min(arg.whole("jobs", jobs), 256)
    # The sizes of the shipped protocols, as shares of the threshold.
    sizes: dict[str, Any] = {"crop_margin_m": limit, "crop_cell_m": limit / 2}
    sizes |= {"crop": "none", "voxel_m": "none"} if plain else {"voxel_m": limit / 20}
    settings = arg.shipped("reconstruction", "preparation", **sizes)
    clouds = []
    for name, values in (("predicted", predicted), ("true", true)):
        points = arg.floats(name, values, (None, 3))
        finite = points[np.isfinite(points).all(axis=1)]
        if len(points) and not len(finite):
            raise arg.fault(name, "has no finite point", "finite numbers")
        arg.check_digits(name, finite, arg.as_array(name, values).dtype.type, coarsest=limit / 20)
        clouds.append(cloud_of(points))
    block = max(*(cloud.count for cloud in clouds), 1)
    with arg.refused("true"):
        crop = find_crop(clouds[1], box_of(clouds[1]), settings, block)
        kept, known = (prepare_cloud(cloud, settings, crop, block) for cloud in clouds)
    found = cloud_distances(kept.source, known.source, block_points=block, jobs=threads)
    means, below = (
        mean_distances(*found, None if plain else 10 * limit),
        curve(*found, np.array([limit])),
    )
    return Scores(
        {name: float(getattr(below, name)[0]) for name in ("precision", "recall", "f1")}
        | {name: means[name] for name in ("chamfer", "accuracy", "completeness")}
        | {name: getattr(kept, name) for name in ("not_finite", "outside", "thinned")},
        **found._asdict(),
    )


def align_cameras(
    predicted: ArrayLike,
    true: ArrayLike,
    *,
    robust: bool = True,
    inlier_m: float = 5.0,
    seed: int = 0,
) -> Scores:
    """Find the similarity that brings predicted camera centres to the true ones.

    Source: Umeyama, Least-squares estimation of transformation parameters between two point
    patterns, PAMI 13(4), 1991. Chum, Matas, Kittler, Locally optimized RANSAC, DAGM 2003.

    Parameters
    ----------
    predicted : (N, 3, 4), (N, 4, 4) or (N, 3) array-like
        Poses as in `pose_errors`, or camera centres, in any frame and scale; NaN where missing.
    true : (N, 3, 4), (N, 4, 4) or (N, 3) array-like
        Of the same cameras, in metres.
    robust : bool
        Fit to the inliers of the reconstruction track's RANSAC; else to all, by plain Umeyama.
    inlier_m, seed : float, int
        Inliers of RANSAC are nearer; the seed of its samples.

    Returns
    -------
    Scores
        ``scale``; ``matrix`` (4, 4) and ``transform``, whose ``apply`` moves points (N, 3);
        ``inliers`` (N,), to which it is fitted; ``residuals`` (N,), metres from the true centres,
        infinite without a pose; ``used_orientations``, of cameras on a line.

    Raises
    ------
    ArgumentError
        Fewer than 3 cameras; centres at one point, or on a line without orientations; bad arrays.
    """
    found, known = read_cameras("predicted", predicted), read_cameras("true", true)
    arg.check_pairs(predicted=predicted, true=true)
    limit, seed = arg.positive("inlier_m", inlier_m), arg.whole("seed", seed, 0)
    inliers: Any = np.isfinite(found.centres).all(axis=1)
    rows, turned = np.flatnonzero(inliers), False
    if len(rows) < LEAST_CAMERAS:
        raise arg.fault("predicted", f"has {len(rows)} cameras with a pose", "at least 3")
    source, target = found.take(rows), known.take(rows)
    with arg.refused("predicted, true"):
        if robust:
            changed = {"inlier_below_m": limit, "seed": seed}
            fit = fit_cameras(source, target, arg.shipped("reconstruction", "alignment", **changed))
            transform, turned = fit.transform, fit.used_orientations
            inliers = np.isin(known.names, fit.inlier_names)
        else:
            transform = umeyama(source.centres, target.centres, with_scale=True)
    residuals = np.full(len(inliers), np.inf)
    offsets = transform.apply(source.centres) - target.centres
    residuals[rows] = np.sqrt((offsets * offsets).sum(axis=1))
    rms = float(np.sqrt((residuals[inliers] ** 2).mean()))
    return Scores(
        {"scale": transform.scale, "rms_of_inliers": rms, "used_orientations": turned},
        **{"transform": transform, "matrix": transform.matrix},
        **{"inliers": inliers, "residuals": residuals},
    )
