"""Poses from Python: errors, scores, and the solver."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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
from airzoo_bench.reconstruction.alignment import PosedCameras
from airzoo_bench.results.result import summarise

__all__ = ["pose_errors", "pose_scores", "solve_pose"]


def pose_errors(predicted: ArrayLike, true: ArrayLike) -> PoseErrors:
    """Compare camera poses with the true ones: metres and degrees.

    Source: Hartley, Trumpf, Dai, Li, Rotation averaging, IJCV 103, 2013 (geodesic angle).

    Parameters
    ----------
    predicted : (N, 3, 4) or (N, 4, 4) array-like
        World-to-camera, x_cam = R X + t, metres, x right, y down, z forward; all NaN is a failure.
    true : (N, 3, 4), (N, 4, 4) or (N, 3) array-like
        True poses, or camera centres, which leave the rotations of the errors None.

    Returns
    -------
    PoseErrors
        A value a pose, infinite for failures.

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
    found, known = read_cameras("predicted", predicted), read_cameras("true", true)
    arg.check_pairs(predicted=predicted, true=true)
    if found.rotation is None:
        raise arg.fault("predicted", "are centres", "poses of shape (N, 3, 4)")
    return metrics.pose_errors(found.rotation, found.centres, known.rotation, known.centres)


def read_cameras(name: str, values: ArrayLike) -> PosedCameras:
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
    errors: PoseErrors | tuple[ArrayLike, ArrayLike | None],
    thresholds: Iterable[tuple[float, float]] = ((5, 1), (10, 1), (20, 2)),
) -> Scores:
    """Score pose errors: recall strictly below thresholds, medians and areas under the error curve.

    Source: Sarlin, DeTone, Malisiewicz, Rabinovich, SuperGlue, CVPR 2020 (area; its code joins the
    steps by lines, which gives up to 1 / (2 N) more).

    Parameters
    ----------
    errors : PoseErrors, or (translation, rotation)
        Of `pose_errors`, or (N,) metres and degrees, or None; infinite for failures.
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
    """
    found = errors if isinstance(errors, PoseErrors) else _pair_errors(errors)
    if len(found.translation_m) == 0:
        raise arg.fault("errors", "hold no query", "at least one")
    rows = arg.floats("thresholds", arg.listed("thresholds", thresholds), (None, 2)).tolist()
    pairs = sorted({tuple(arg.positive("thresholds", limit) for limit in row) for row in rows})
    if not pairs:
        raise arg.fault("thresholds", "are none", "pairs of metres and degrees, such as (5, 1)")
    metres = tuple(sorted({limit for limit, _ in pairs}))
    limits: dict[str, Any] = {"translation_below_m": metres, "auc_up_to_m": metres}
    limits |= {"pose_below_m_deg": tuple(pairs), "failed_rotation_deg": "infinite"}
    trusted = found.rotation_deg is not None
    settings = arg.shipped("matching", "scores", orientation_is_trusted=trusted, **limits)
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
    metres, degrees = arg.floats("errors", errors[0], (None,)), None
    bad, unknown = ~(metres >= 0.0), np.full_like(metres, np.nan)
    if errors[1] is not None:
        degrees = arg.floats("errors", errors[1], (None,))
        arg.check_pairs(**{"errors[0]": errors[0], "errors[1]": errors[1]})
        bad |= ~((degrees >= 0.0) & ((degrees <= 180.0) | np.isinf(degrees)))
    arg.refuse_rows("errors", bad, "a number out of range", expected)
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
    max_trials, seed : int
        The most samples, at least 1,000, and their seed.

    Returns
    -------
    PoseEstimate
        NaN where there is no pose, as with fewer than four different matches.

    Raises
    ------
    ArgumentError
        Shapes that do not fit, NaN, a K that is none, settings out of range, too few digits.
    """
    arg.choice("solver", solver, get_args(SolverName))
    at = arg.floats("pixels", pixels, (None, 2), finite=True)
    points = arg.coordinates("points3d", points3d)
    arg.check_pairs(pixels=pixels, points3d=points3d)
    limits = {"max_error_px": arg.positive("max_error_px", max_error_px)}
    limits["max_trials"] = arg.whole("max_trials", max_trials, 1_000)
    seed = arg.whole("seed", seed, 0)
    settings = arg.shipped("matching", "solver", name=solver, seed=seed, **limits)
    K = arg.floats("camera", camera, (3, 3))
    lens = None if distortion is None else arg.floats("distortion", distortion, (None,))[None]
    # The size of the image is no part of the problem; solvers only carry it along.
    width, height = np.maximum(1.0, np.ceil(2.0 * np.nan_to_num(K[:2, 2])))
    with arg.refused("camera"):
        cameras = Cameras.from_matrices(K[None], width, height, lens)
    return solving.solve_pose(cameras, at, points, settings)
