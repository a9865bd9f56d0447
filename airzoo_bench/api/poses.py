"""Poses from Python: errors, scores, the solver, and the alignment of cameras."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, get_args

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from airzoo_bench.api import arguments as arg
from airzoo_bench.api.scores import Scores
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses, check_rotations
from airzoo_bench.geometry.precision import COARSEST_M, pose_errors_m
from airzoo_bench.matching import metrics, solving
from airzoo_bench.matching.metrics import PoseErrors, matching_scores, pose_columns
from airzoo_bench.matching.protocol import MatchingScores, Solver, SolverName
from airzoo_bench.matching.solving import PoseEstimate
from airzoo_bench.reconstruction.alignment import (
    LEAST_CAMERAS,
    PosedCameras,
    fit_cameras,
    shipped_alignment,
    umeyama,
)
from airzoo_bench.results.result import summarise

__all__ = ["align_cameras", "pose_errors", "pose_scores", "solve_pose"]


def pose_errors(predicted: ArrayLike, true: ArrayLike) -> PoseErrors:
    """Compare camera poses with the true ones: metres and degrees.

    Source: Hartley, Trumpf, Dai, Li, Rotation averaging, IJCV 103, 2013 (geodesic angle).

    Parameters
    ----------
    predicted : (N, 3, 4) or (N, 4, 4) array-like
        World-to-camera poses [R | t], x_cam = R X + t, in metres, x right, y down, z forward. All
        NaN is a missing pose: its errors are infinite.
    true : (N, 3, 4), (N, 4, 4) or (N, 3) array-like
        The true poses; or camera centres, and the rotations of the errors are None.

    Returns
    -------
    PoseErrors
        A value a pose.

    Raises
    ------
    ArgumentError
        Shapes that do not fit; matrices that are no poses; too few digits for a centimetre.

    Examples
    --------
    >>> import numpy as np
    >>> true = np.tile(np.eye(4), (2, 1, 1))
    >>> predicted = true.copy()
    >>> predicted[0, 0, 3], predicted[1] = -3.0, np.nan  # 3 m too far east; none
    >>> pose_errors(predicted, true).translation_m.tolist()
    [3.0, inf]
    """
    found, known = _read_cameras("predicted", predicted), _read_cameras("true", true)
    arg.check_pairs(predicted=predicted, true=true)
    if found.rotation is None:
        raise arg.fault("predicted", "are centres", "poses of shape (N, 3, 4)")
    return metrics.pose_errors(found.rotation, found.centres, known.rotation, known.centres)


def pose_scores(
    errors: PoseErrors | tuple[ArrayLike, ArrayLike | None],
    thresholds: Iterable[tuple[float, float]] = ((5, 1), (10, 1), (20, 2)),
) -> Scores:
    """Score pose errors: recall strictly below thresholds, medians and areas under the error curve.

    Source: Sarlin, DeTone, Malisiewicz, Rabinovich, SuperGlue, CVPR 2020 (area; its code joins the
    steps by lines, which gives up to 1 / (2 N) more).

    Parameters
    ----------
    errors : PoseErrors, or (translation, rotation)
        Or (N,) metres and degrees, infinite for failures; None where degrees are not known.
    thresholds : iterable of (metres, degrees)
        Of pose recall; translation recall and area are at the same metres.

    Returns
    -------
    Scores
        ``error_m`` and ``rotation_deg``, the medians; ``within_5m_1deg``, pose recall;
        ``within_5m``, translation recall; ``auc_5m``, the area from 0 to 5 m as a share of the
        best possible; how many ``queries`` and ``failures``; and ``records``, a row a query.

    Raises
    ------
    ArgumentError
        No query; errors that are NaN, negative or of different lengths; thresholds not above 0.

    Examples
    --------
    >>> found = pose_scores(([0.5, 4.0, float("inf")], [0.2, 1.5, float("inf")]), [(5, 1)])
    >>> found["within_5m_1deg"], found["error_m"], found["failures"]
    (0.3333333333333333, 4.0, 1)
    """
    found = errors if isinstance(errors, PoseErrors) else _pair_errors(errors)
    if len(found.translation_m) == 0:
        raise arg.fault("errors", "hold no query", "at least one")
    limits = arg.floats("thresholds", arg.listed("thresholds", thresholds), (None, 2))
    pairs = sorted({tuple(arg.positive("thresholds", limit) for limit in row) for row in limits})
    metres = tuple(sorted({limit for limit, _ in pairs}))
    if not pairs or len({f"{limit:g}" for limit in metres}) < len(metres):
        expected = "pairs of metres and degrees, such as (5, 1), that differ in 6 digits"
        raise arg.fault("thresholds", f"are {limits.tolist()}", expected)
    settings = MatchingScores.model_construct(
        orientation_is_trusted=found.rotation_deg is not None,
        failed_rotation_deg="infinite",
        translation_below_m=metres,
        pose_below_m_deg=tuple(pairs),
        auc_up_to_m=metres,
    )
    # Of a pair of errors there are no horizontal and vertical parts.
    columns = pose_columns(found, settings).items()
    known = {name: values for name, values in columns if not np.isnan(values).any()}
    records = pd.DataFrame({"scene": "", **known})
    scores = [score for score in matching_scores(settings) if score.key in known]
    failures = int(np.isinf(found.translation_m).sum())
    counts = {"queries": len(records), "failures": failures}
    averages = summarise(records, scores, [""]).overall
    return Scores(counts | averages, records=records.drop(columns="scene"))


def _pair_errors(errors: Any) -> PoseErrors:
    expected = "metres, and degrees up to 180, or None; infinite for a failure"
    if not isinstance(errors, Sequence) or len(errors) != 2:
        raise arg.fault("errors", f"is {type(errors).__name__}", f"of pose_errors, or {expected}")
    metres = arg.floats("errors", errors[0], (None,))
    degrees = None if errors[1] is None else arg.floats("errors", errors[1], (None,))
    bad = ~(metres >= 0.0)
    if degrees is not None:
        arg.check_pairs(**{"errors[0]": errors[0], "errors[1]": errors[1]})
        bad |= ~((degrees >= 0.0) & ((degrees <= 180.0) | np.isinf(degrees)))
    arg.refuse_rows("errors", bad, "a number out of range", expected)
    unknown = np.full_like(metres, np.nan)
    return PoseErrors(metres, unknown, unknown, degrees)


def solve_pose(
    pixels: ArrayLike,
    points3d: ArrayLike,
    camera: ArrayLike,
    *,
    distortion: ArrayLike | None = None,
    solver: SolverName = "colmap",
    max_error_px: float = 5.0,
    max_trials: int = 100_000,
    seed: int = 0,
) -> PoseEstimate:
    """Find a camera's pose from 2D-3D matches in any order, as the shipped matching protocols do.

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
    max_trials : int
        The most samples, of at least 1,000.
    seed : int
        Of the samples.

    Returns
    -------
    PoseEstimate
        NaN where there is no pose, as with fewer than four different matches.

    Raises
    ------
    ArgumentError
        Shapes that do not fit, NaN, a K that is none, settings out of range, too few digits.

    Examples
    --------
    >>> K = [[500.0, 0, 320], [0, 500.0, 240], [0, 0, 1]]
    >>> points = [[-1.0, -1, 4], [1, -1, 5], [1, 1, 6], [-1, 1, 7], [0, 0, 5], [0.5, -0.5, 4]]
    >>> pixels = [[320 + 500 * x / z, 240 + 500 * y / z] for x, y, z in points]
    >>> found = solve_pose(pixels, points, K)
    >>> found.status.value, int(found.inliers.sum())
    ('solved', 6)
    """
    arg.choice("solver", solver, get_args(SolverName))
    at = arg.floats("pixels", pixels, (None, 2), finite=True)
    points = arg.coordinates("points3d", points3d)
    arg.check_pairs(pixels=pixels, points3d=points3d)
    settings = Solver.model_construct(
        name=solver,
        max_error_px=arg.positive("max_error_px", max_error_px),
        min_inlier_ratio=0.01,
        min_trials=1_000,
        max_trials=arg.whole("max_trials", max_trials, 1_000),
        confidence=0.9999,
        seed=arg.whole("seed", seed, 0),
        least_matches=solving.MIN_MATCHES,
        max_matches=20_000,
        max_trials_times_matches=500_000_000,
    )
    K = arg.floats("camera", camera, (3, 3))
    lens = None if distortion is None else arg.floats("distortion", distortion, (None,))[None]
    # The size of the image is no part of the problem; solvers only carry it along.
    width, height = np.maximum(1.0, np.ceil(2.0 * np.nan_to_num(K[:2, 2])))
    with arg.refused("camera"):
        cameras = Cameras.from_matrices(K[None], width, height, lens)
    return solving.solve_pose(cameras, at, points, settings)


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
    inlier_m : float
        Inliers are nearer.
    seed : int
        Of RANSAC's samples.

    Returns
    -------
    Scores
        ``scale``; ``matrix`` (4, 4) and ``transform``, whose ``apply`` moves points (N, 3) into the
        frame of the truth; ``inliers`` (N,), the cameras to which it is fitted; ``residuals``
        (N,), distances of the moved centres from the true ones, infinite without a pose;
        ``used_orientations``, where centres lie on a line and orientations gave the turn about it.

    Raises
    ------
    ArgumentError
        Fewer than 3 cameras; centres at one point, or on a line without orientations; arrays that
        do not fit.

    Examples
    --------
    >>> true = [[0.0, 0, 50], [40, 0, 50], [40, 30, 60], [0, 30, 55], [20, 15, 52]]
    >>> predicted = [[x / 10, y / 10, z / 10] for x, y, z in true]
    >>> predicted[4] = [90.0, 0, 0]  # an outlier
    >>> found = align_cameras(predicted, true)
    >>> round(found.scale, 9), found.inliers.tolist()
    (10.0, [True, True, True, True, False])
    """
    found, known = _read_cameras("predicted", predicted), _read_cameras("true", true)
    arg.check_pairs(predicted=predicted, true=true)
    limit, seed = arg.positive("inlier_m", inlier_m), arg.whole("seed", seed, 0)
    rows = np.flatnonzero(np.isfinite(found.centres).all(axis=1))
    if len(rows) < LEAST_CAMERAS:
        expected = f"at least {LEAST_CAMERAS}, which a similarity needs"
        raise arg.fault("predicted", f"has {len(rows)} cameras with a pose", expected)
    source, target = found.take(rows), known.take(rows)
    with arg.refused("predicted, true"):
        if robust:
            fit = fit_cameras(source, target, shipped_alignment(inlier_below_m=limit, seed=seed))
            transform, turned = fit.transform, fit.used_orientations
            inliers = np.isin(known.names, fit.inlier_names)
        else:
            transform = umeyama(source.centres, target.centres, with_scale=True)
            inliers, turned = np.isin(np.arange(len(known.names)), rows), False
    residuals = np.full(len(inliers), np.inf)
    offsets = transform.apply(source.centres) - target.centres
    residuals[rows] = np.sqrt((offsets * offsets).sum(axis=1))
    rms = float(np.sqrt((residuals[inliers] ** 2).mean()))
    return Scores(
        {"scale": transform.scale, "rms_of_inliers": rms, "used_orientations": turned},
        **{"transform": transform, "matrix": transform.matrix},
        **{"inliers": inliers, "residuals": residuals},
    )


def _read_cameras(name: str, values: ArrayLike) -> PosedCameras:
    """Return world-to-camera poses (N, 3, 4) or (N, 4, 4), or centres (N, 3)."""
    array = arg.as_array(name, values, "poses (N, 3, 4) or centres (N, 3)")
    shape = (3,) if array.ndim == 2 else (3 + (array.shape[1:2] == (4,)), 4)
    numbers = arg.floats(name, array, (None, *shape))
    axes, names = tuple(range(1, numbers.ndim)), tuple(map(str, range(len(numbers))))
    rows = np.flatnonzero(np.isfinite(numbers).all(axis=axes))
    missing = np.isnan(numbers[:, :3]).all(axis=axes) & (name == "predicted")
    bad = ~np.isfinite(numbers).all(axis=axes) & ~missing
    expected = "finite numbers; all of a predicted camera is NaN where it has no pose"
    arg.refuse_rows(name, bad, "NaN or infinity", expected)
    centres = np.full((len(numbers), 3), np.nan)
    if array.ndim == 2:
        if name == "true":
            arg.coordinates(name, array)
        centres[rows] = arg.floats(name, numbers[rows], (None, 3), finite=True)
        return PosedCameras(names, centres)
    matrices = numbers[rows]
    if (np.abs(matrices[:, 3:] - (0, 0, 0, 1)) > 1e-6).any():
        fix = "transpose the matrices, if their last row holds t"
        raise arg.fault(name, "has other last rows", "[R | t] above 0 0 0 1", fix)
    turns, moves = matrices[:, :3, :3], matrices[:, :3, 3]
    with arg.refused(name):
        labels = [f"row {row}" for row in rows.tolist()]
        poses = Poses.from_translations(check_rotations(turns, labels), moves, labels)
    coarse = np.zeros(len(numbers), np.bool_)
    coarse[rows] = pose_errors_m(turns, moves, None) > COARSEST_M
    expected = f"digits that place a camera to {COARSEST_M} m: poses computed in float64"
    arg.refuse_rows(name, coarse, "too few digits", expected)
    rotation = np.full((len(numbers), 3, 3), np.nan)
    rotation[rows], centres[rows] = poses.rotation, poses.centres
    return PosedCameras(names, centres, rotation)
