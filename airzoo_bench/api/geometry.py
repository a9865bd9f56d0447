"""Poses and clouds from Python: errors, scores, the solver, the alignment of cameras."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any, get_args

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from airzoo_bench.api import arguments as arg
from airzoo_bench.api.arguments import Scores
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.precision import COARSEST_M, pose_errors_m
from airzoo_bench.matching import metrics, solving
from airzoo_bench.matching.metrics import PoseErrors, matching_scores, pose_columns
from airzoo_bench.matching.protocol import SolverName
from airzoo_bench.matching.solving import PoseEstimate
from airzoo_bench.reconstruction.alignment import PosedCameras, fit_cameras, umeyama
from airzoo_bench.reconstruction.clouds import bounding_box, cloud_of, find_crop, prepare_cloud
from airzoo_bench.reconstruction.distances import cloud_distances
from airzoo_bench.reconstruction.metrics import curve, mean_distances
from airzoo_bench.results.result import summarise


def pose_errors(predicted: ArrayLike, true: ArrayLike) -> PoseErrors:
    """Compare camera poses with the true ones: metres and degrees, infinite for failures.

    Raises an `ArgumentError` for shapes that do not fit, matrices that are no poses, too few digits
    for a centimetre. Source: Hartley, Trumpf, Dai, Li, Rotation averaging, IJCV 103, 2013.

    Parameters
    ----------
    predicted : (N, 3, 4) or (N, 4, 4) array-like
        World-to-camera, x_cam = R X + t, metres, x right, y down, z forward; all NaN is a failure.
    true : (N, 3, 4), (N, 4, 4) or (N, 3) array-like
        True poses, or camera centres, which leave the rotations of the errors None.
    """
    found, known = _read_pairs(predicted, true)
    if found.rotation is None:
        raise arg.fault("predicted", "are centres", "poses of shape (N, 3, 4)")
    return metrics.pose_errors(found.rotation, found.centres, known.rotation, known.centres)


def _read_pairs(predicted: Any, true: Any) -> tuple[PosedCameras, PosedCameras]:
    found, known = _read_cameras("predicted", predicted), _read_cameras("true", true)
    arg.check_pairs(predicted=predicted, true=true)
    return found, known


def _read_cameras(name: str, values: ArrayLike) -> PosedCameras:
    """Return world-to-camera poses (N, 3, 4) or (N, 4, 4), or centres (N, 3)."""
    array = arg.as_array(name, values)
    shape = (3,) if array.ndim == 2 else (3 + (array.shape[1:2] == (4,)), 4)
    numbers = arg.floats(name, array, (None, *shape))
    axes, names = tuple(range(1, numbers.ndim)), tuple(map(str, range(len(numbers))))
    there: Any = np.isfinite(numbers).all(axis=axes)
    missing = np.isnan(numbers[:, :3]).all(axis=axes) & (name == "predicted")
    expected = "finite numbers; all of a predicted camera is NaN where it has no pose"
    arg.refuse_rows(name, ~there & ~missing, "NaN or infinity", expected)
    centres = np.full((len(numbers), 3), np.nan)
    if array.ndim == 2:
        if name == "true":
            arg.coordinates(name, array)
        centres[there] = arg.floats(name, numbers[there], (None, 3), finite=True)
        return PosedCameras(names, centres)
    matrices, labels = numbers[there], [f"row {row}" for row in np.flatnonzero(there).tolist()]
    if (np.abs(matrices[:, 3:] - (0, 0, 0, 1)) > 1e-6).any():
        fix = "transpose the matrices, if their last row holds t"
        raise arg.fault(name, "has other last rows", "[R | t] above 0 0 0 1", fix)
    turns, moves = matrices[:, :3, :3], matrices[:, :3, 3]
    with arg.refused(name):
        poses = Poses.from_translations(turns, moves, labels)
    there[there] = pose_errors_m(turns, moves, None) <= COARSEST_M
    expected = f"digits that place a camera to {COARSEST_M} m: poses computed in float64"
    arg.refuse_rows(name, ~there & ~missing, "too few digits", expected)
    rotation = np.full((len(numbers), 3, 3), np.nan)
    rotation[there], centres[there] = poses.rotation, poses.centres
    return PosedCameras(names, centres, rotation)


def pose_scores(
    errors: PoseErrors, thresholds: Iterable[tuple[float, float]] = ((5, 1), (10, 1), (20, 2))
) -> Scores:
    """Score pose errors: recall strictly below thresholds, medians and areas under the error curve.

    Returns ``error_m`` and ``rotation_deg``, the medians; ``within_5m_1deg``, pose recall;
    ``within_5m``, translation recall; ``auc_5m``, the area from 0 to 5 m as a share of the best
    possible; how many ``queries`` and ``failures``; and ``records``, a row a query. Raises an
    `ArgumentError` for no query, errors that are NaN, thresholds not above 0.

    Source: Sarlin, DeTone, Malisiewicz, Rabinovich, SuperGlue, CVPR 2020 (area; its code joins the
    steps by lines, which gives up to 1 / (2 N) more).

    Parameters
    ----------
    errors : PoseErrors
        Of `pose_errors`; infinite for failures.
    thresholds : iterable of (metres, degrees)
        Of pose recall; translation recall and area are at the same metres.
    """
    rows = arg.floats("thresholds", arg.listed("thresholds", thresholds), (None, 2)).tolist()
    for name, values in (("errors", errors.translation_m), ("thresholds", rows)):
        if len(values) == 0 or np.isnan(values).any():
            raise arg.fault(name, "are none, or NaN", "at least one; infinite for a failure")
    pairs = sorted({tuple(arg.positive("thresholds", limit) for limit in row) for row in rows})
    metres = tuple(sorted({limit for limit, _ in pairs}))
    limits: dict[str, Any] = {"translation_below_m": metres, "auc_up_to_m": metres}
    limits |= {"pose_below_m_deg": tuple(pairs), "failed_rotation_deg": "infinite"}
    trusted = errors.rotation_deg is not None
    settings = arg.shipped("matching", "scores", orientation_is_trusted=trusted, **limits)
    records = pd.DataFrame({"scene": "", **pose_columns(errors, settings)})
    counts = {"queries": len(records), "failures": int(np.isinf(errors.translation_m).sum())}
    averages = summarise(records, matching_scores(settings), [""]).overall
    return Scores(counts | averages, records=records.drop(columns="scene"))


def solve_pose(
    pixels: ArrayLike,
    points3d: ArrayLike,
    camera: ArrayLike,
    *,
    distortion: ArrayLike | None = None,
    solver: SolverName = "colmap",
    max_error_px: float = 5.0,
    seed: int = 0,
) -> PoseEstimate:
    """Find a camera's pose from 2D-3D matches in any order, as the shipped matching protocols do.

    It is NaN where there is no pose, as with fewer than four different matches. Raises an
    `ArgumentError` for shapes that do not fit, NaN, a K that is none, settings out of range, too
    few digits.

    Source: Chum, Matas, Kittler, Locally optimized RANSAC, DAGM 2003. Schönberger, Frahm,
    Structure-from-motion revisited, CVPR 2016. Larsson and contributors, PoseLib, 2020.

    Parameters
    ----------
    pixels : (M, 2) array-like
        In the image at its full size, from its corner: add 0.5 to OpenCV's keypoints.
    points3d : (M, 3) array-like
        In metres, of any frame with orthogonal axes of one scale.
    camera : (3, 3) array-like
        K = [fx 0 cx; 0 fy cy; 0 0 1] in pixels of the same image.
    distortion : (4,) or (5,) array-like, optional
        k1 k2 p1 p2 and k3, as OpenCV has them.
    solver : {"colmap", "colmap+refine", "poselib"}
        The first is LO-RANSAC of COLMAP, without refinement.
    max_error_px : float
        Largest reprojection error of an inlier.
    seed : int
        Of the random samples, 100,000 at most.
    """
    arg.choice("solver", solver, get_args(SolverName))
    at = arg.floats("pixels", pixels, (None, 2), finite=True)
    points = arg.coordinates("points3d", points3d)
    arg.check_pairs(pixels=pixels, points3d=points3d)
    limit, seed = arg.positive("max_error_px", max_error_px), arg.whole("seed", seed, 0)
    settings = arg.shipped("matching", "solver", name=solver, seed=seed, max_error_px=limit)
    K = arg.floats("camera", camera, (3, 3))
    lens = None if distortion is None else arg.floats("distortion", distortion, (None,))[None]
    # The size of the image is no part of the problem; solvers only carry it along.
    width, height = np.maximum(1.0, np.ceil(2.0 * np.nan_to_num(K[:2, 2])))
    with arg.refused("camera"):
        cameras = Cameras.from_matrices(K[None], width, height, lens)
    return solving.solve_pose(cameras, at, points, settings)


def cloud_scores(
    predicted: ArrayLike, true: ArrayLike, threshold: float = 10.0, *, plain: bool = False
) -> Scores:
    """Score a predicted cloud as the reconstruction track does once it is aligned.

    Both clouds are cropped to the columns that the truth covers, grown by the threshold, and
    thinned by voxels of a twentieth of it; recall is over all true points (``region = "all"``).

    Returns ``precision``, ``recall``, ``f1``, 0 to 1; ``accuracy`` and ``completeness``, the mean
    distances to the truth and back, and their mean ``chamfer``, infinite where nothing is
    predicted; ``not_finite``, ``outside``, ``thinned``, numbers of predicted points that are not
    compared; ``to_truth`` (P,) and ``to_prediction`` (T,), the distance of each other one. Raises
    an `ArgumentError` for another shape, too few digits, a threshold not above 0, no true point.

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
    """
    limit = arg.positive("threshold", threshold)
    # The sizes of the shipped protocols, as shares of the threshold.
    sizes: dict[str, Any] = {"crop_margin_m": limit, "crop_cell_m": limit / 2}
    sizes |= {"crop": "none", "voxel_m": "none"} if plain else {"voxel_m": limit / 20}
    settings = arg.shipped("reconstruction", "preparation", **sizes)
    clouds = []
    for name, values in (("predicted", predicted), ("true", true)):
        points = arg.floats(name, values, (None, 3))
        finite = points[np.isfinite(points).all(axis=1)]
        arg.check_digits(name, finite, arg.as_array(name, values).dtype.type, coarsest=limit / 20)
        clouds.append(cloud_of(points))
    block = max(*(cloud.count for cloud in clouds), 1)
    with arg.refused("true"):
        crop = find_crop(clouds[1], bounding_box(clouds[1]), settings, block)
        kept, known = (prepare_cloud(cloud, settings, crop, block) for cloud in clouds)
    found = cloud_distances(kept.source, known.source, block_points=block, jobs=os.cpu_count() or 1)
    means = mean_distances(*found, None if plain else 10 * limit)
    below = curve(*found, np.array([limit]))
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

    Returns ``scale``; ``matrix`` (4, 4) and ``transform``, whose ``apply`` moves points (N, 3);
    ``inliers`` (N,), to which it is fitted; ``residuals`` (N,), metres from the true centres,
    infinite without a pose; ``used_orientations``, of cameras on a line. Raises an `ArgumentError`
    for fewer than 3 cameras, centres at one point, or on a line without orientations, bad arrays.

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
    """
    found, known = _read_pairs(predicted, true)
    limit, seed = arg.positive("inlier_m", inlier_m), arg.whole("seed", seed, 0)
    inliers: Any = np.isfinite(found.centres).all(axis=1)
    rows, turned = np.flatnonzero(inliers), False
    if len(rows) < 3:
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
