"""The pose solver of the matching track."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.api.arrays import choice, coordinates, finite, floats, positive, refused, whole
from airzoo_bench.api.labels import same_index
from airzoo_bench.core.errors import ArgumentError
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.matching import solving
from airzoo_bench.matching.settings import Solver, SolverName
from airzoo_bench.matching.solving import PoseEstimate

__all__ = ["solve_pose"]


def solve_pose(
    pixels: ArrayLike,
    points3d: ArrayLike,
    camera: ArrayLike,
    *,
    distortion: ArrayLike | None = None,
    solver: SolverName = "colmap",
    max_error_px: float = 5.0,
    min_inlier_ratio: float = 0.01,
    min_trials: int = 1_000,
    max_trials: int = 100_000,
    confidence: float = 0.9999,
    seed: int = 0,
    max_matches: int = 20_000,
    max_trials_times_matches: int = 500_000_000,
) -> PoseEstimate:
    """Find a camera's pose from 2D-3D matches, as the matching track does.

    The defaults are those of all shipped protocols: LO-RANSAC of COLMAP, without refinement.

    Parameters
    ----------
    pixels : (M, 2) array-like
        In the image at its full size; its corner is (0, 0), so that the first pixel's centre is
        (0.5, 0.5). OpenCV's and most matchers' keypoints need 0.5 added.
    points3d : (M, 3) array-like
        In metres, of any frame with orthogonal axes of one scale.
    camera : (3, 3) array-like
        K = [fx 0 cx; 0 fy cy; 0 0 1] in pixels of the same image.
    distortion : (4,) or (5,) array-like, optional
        k1 k2 p1 p2 and k3, as OpenCV has them.
    solver : {"colmap", "colmap+refine", "poselib"}
    max_error_px : float
        Largest reprojection error of an inlier.
    min_inlier_ratio : float
        Caps the number of trials, for COLMAP.
    min_trials, max_trials : int
        Samples that are drawn at least, and at most.
    confidence : float
        Trials end when a sample without outliers was drawn with this probability.
    seed : int
        The answer depends on the arguments alone, and not on the order of the matches.
    max_matches, max_trials_times_matches : int
        Bounds of the work: of more matches, this many are chosen by the seed; trials end early.

    Returns
    -------
    PoseEstimate
        ``status``, ``matrix`` (3, 4) world-to-camera, ``rotation``, ``centre`` and ``inliers``
        (M,). Where there are fewer than four different matches, or no pose explains them, the
        pose is NaN and `status` says why: that is a result and no error.

    Raises
    ------
    ArgumentError
        Shapes that do not fit, NaN, a K that is none, settings out of range; float32 points in
        projected coordinates.
    UsageError
        PoseLib is asked for and not installed.

    References
    ----------
    Chum, Matas, Kittler, Locally optimized RANSAC, DAGM 2003. Schönberger, Frahm,
    Structure-from-motion revisited, CVPR 2016. Larsson and contributors, PoseLib, 2020.

    Examples
    --------
    >>> K = [[500.0, 0, 320], [0, 500.0, 240], [0, 0, 1]]
    >>> points = [[-1.0, -1, 4], [1, -1, 5], [1, 1, 6], [-1, 1, 7], [0, 0, 5], [0.5, -0.5, 4]]
    >>> pixels = [[320 + 500 * x / z, 240 + 500 * y / z] for x, y, z in points]
    >>> found = solve_pose(pixels, points, K)
    >>> found.status.value, int(found.inliers.sum()), found.centre.round(6).tolist() == [0, 0, 0]
    ('solved', 6, True)
    """
    choice("solver", solver, get_args(SolverName))
    same_index({"pixels": pixels, "points3d": points3d})
    at = finite("pixels", floats("pixels", pixels, (None, 2)))
    points = coordinates("points3d", points3d)
    if len(at) != len(points):
        raise ArgumentError(
            f"have {len(at)} and {len(points)} rows",
            where="pixels, points3d",
            expected="a row a match in both",
        )
    settings = Solver.model_construct(
        name=solver,
        max_error_px=positive("max_error_px", max_error_px),
        min_inlier_ratio=_share("min_inlier_ratio", min_inlier_ratio),
        min_trials=whole("min_trials", min_trials),
        max_trials=whole("max_trials", max_trials, whole("min_trials", min_trials)),
        confidence=_share("confidence", confidence),
        seed=whole("seed", seed, 0),
        least_matches=solving.MIN_MATCHES,
        max_matches=whole("max_matches", max_matches, solving.MIN_MATCHES),
        max_trials_times_matches=whole("max_trials_times_matches", max_trials_times_matches),
    )
    return solving.solve_pose(_camera(camera, distortion), at, points, settings)


def _camera(matrix: ArrayLike, distortion: ArrayLike | None) -> Cameras:
    K = floats("camera", matrix, (3, 3))
    lens = None if distortion is None else floats("distortion", distortion, (None,))[None]
    # The size of the image is no part of the problem; solvers only carry it along.
    width, height = np.maximum(1.0, np.ceil(2.0 * np.nan_to_num(K[:2, 2])))
    with refused("camera"):
        return Cameras.from_matrices(K[None], width, height, lens)


def _share(name: str, value: Any) -> float:
    share = positive(name, value)
    if share >= 1.0:
        raise ArgumentError(f"is {value!r}", where=name, expected="a number between 0 and 1")
    return share
