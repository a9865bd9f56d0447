"""The solvers behind `pose`: pycolmap and PoseLib, called alike and repeatable.

Pixels, poses and distortion are the same in both and here: image corner (0, 0), world-to-camera,
Brown-Conrady.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Literal, NamedTuple

import numpy as np

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.optional_imports import load_pycolmap
from airzoo_bench.core.shown import Shown, number
from airzoo_bench.geometry.arrays import Bools, Floats, apply_matrix
from airzoo_bench.geometry.cameras import Cameras

__all__ = ["Found", "PoseEstimate", "Ransac", "Solver", "Status", "check_settings", "find_pose"]

Solver = Literal["colmap", "colmap+refine", "poselib"]

# Both libraries multiply the number of trials that the confidence asks for; both default to 3.
_TRIALS_MULTIPLIER = 3.0


class Ransac(NamedTuple):
    """Settings that the solvers share; see `pose.solve_pose`."""

    max_error_px: float
    min_inlier_ratio: float
    min_trials: int
    max_trials: int
    confidence: float
    seed: int


class Status(StrEnum):
    """How the search for a pose ended."""

    SOLVED = "solved"
    TOO_FEW_MATCHES = "too few matches"
    NO_POSE = "no pose"


@dataclass(frozen=True, eq=False, repr=False)
class PoseEstimate(Shown):
    """The answer of a solver for one query of M matches.

    Attributes
    ----------
    rotation : (3, 3) array
        World-to-camera; NaN on failure.
    centre : (3,) array
        Camera centre in the coordinates of the points; NaN on failure.
    inliers : (M,) bool array
        Matches that the pose explains; none on failure.
    status : Status
        A failure is anything but ``SOLVED``.
    left_out : int
        Matches beyond `max_matches`, which were not used.
    seconds : float
        Spent on it; the one thing that differs from run to run.
    """

    rotation: Floats
    centre: Floats
    inliers: Bools
    status: Status
    left_out: int = 0
    seconds: float = 0.0

    @property
    def matrix(self) -> Floats:
        """The pose [R | t], (3, 4), world-to-camera; NaN on failure."""
        return np.column_stack([self.rotation, -apply_matrix(self.rotation, self.centre)])

    def _shown(self) -> Mapping[str, object]:
        inliers = f"{int(self.inliers.sum())} of {len(self.inliers)}"
        centre = ", ".join(map(number, self.centre.tolist()))
        return {"status": self.status.value, "inliers": inliers, "centre": centre}


class Found(NamedTuple):
    """A pose x_cam = R X + t, and which of the (M,) matches are its inliers."""

    rotation: Floats
    translation: Floats
    inliers: Bools


def check_settings(solver: Solver, ransac: Ransac) -> None:
    """Raise ValueError for an unknown solver, or settings that it could not work with."""
    if solver not in _SOLVERS:
        raise ValueError(f"unknown solver {solver!r}, expected one of {', '.join(_SOLVERS)}")
    possible = {
        "max_error_px": 0 < ransac.max_error_px < np.inf,
        "min_inlier_ratio": 0 < ransac.min_inlier_ratio < 1,
        "min_trials": 0 < ransac.min_trials <= ransac.max_trials,
        "max_trials": ransac.max_trials < 2**31,
        "confidence": 0 < ransac.confidence < 1,
        "seed": 0 <= ransac.seed < 2**31,
    }
    bad = [f"{name} {getattr(ransac, name)}" for name, fits in possible.items() if not fits]
    if bad:
        raise ValueError(f"settings that are not possible: {', '.join(bad)}")


def find_pose(
    solver: Solver, camera: Cameras, query_xy: Floats, points: Floats, ransac: Ransac
) -> Found | None:
    """Find a pose, in the coordinates of the points."""
    return _SOLVERS[solver](camera, query_xy, points, ransac)


def _colmap(camera: Cameras, query_xy: Floats, points: Floats, ransac: Ransac) -> Found | None:
    pycolmap = load_pycolmap()

    arguments = _colmap_arguments(camera, ransac)
    return _from_colmap(pycolmap.estimate_absolute_pose(query_xy, points, *arguments))


def _colmap_refined(
    camera: Cameras, query_xy: Floats, points: Floats, ransac: Ransac
) -> Found | None:
    pycolmap = load_pycolmap()

    arguments = (*_colmap_arguments(camera, ransac), _refinement())
    return _from_colmap(pycolmap.estimate_and_refine_absolute_pose(query_xy, points, *arguments))


def _from_colmap(answer: dict[str, Any] | None) -> Found | None:
    if answer is None:
        return None
    pose = answer["cam_from_world"]
    return Found(pose.rotation.matrix(), pose.translation, answer["inlier_mask"])


def _colmap_arguments(camera: Cameras, ransac: Ransac) -> tuple[Any, Any]:
    pycolmap = load_pycolmap()

    options = {
        "max_error": ransac.max_error_px,
        "min_inlier_ratio": ransac.min_inlier_ratio,
        "min_num_trials": ransac.min_trials,
        "max_num_trials": ransac.max_trials,
        "confidence": ransac.confidence,
        "dyn_num_trials_multiplier": _TRIALS_MULTIPLIER,
        # Random numbers are a thread's own; with a seed every call starts them anew, whatever
        # `pycolmap.set_random_seed` or earlier calls of the thread have done.
        "random_seed": ransac.seed,
        "num_threads": 1,
    }
    return (
        pycolmap.Camera(**_camera_fields(camera)),
        pycolmap.AbsolutePoseEstimationOptions(estimate_focal_length=False, ransac=options),
    )


def _refinement() -> Any:
    pycolmap = load_pycolmap()

    # COLMAP's own values, written down so that a new version of it does not change scores.
    return pycolmap.AbsolutePoseRefinementOptions(
        loss_function_scale=1.0,
        gradient_tolerance=1.0,
        max_num_iterations=100,
        refine_focal_length=False,
        refine_extra_params=False,
    )


def _poselib(camera: Cameras, query_xy: Floats, points: Floats, ransac: Ransac) -> Found | None:
    try:
        poselib: Any = importlib.import_module("poselib")
    except ImportError as error:
        raise UsageError(
            "the solver 'poselib' needs PoseLib, which is not installed",
            fix="pip install poselib, or choose the solver 'colmap' or 'colmap+refine'",
        ) from error
    options = {
        "max_reproj_error": ransac.max_error_px,
        "min_iterations": ransac.min_trials,
        "max_iterations": ransac.max_trials,
        "success_prob": ransac.confidence,
        "dyn_num_trials_mult": _TRIALS_MULTIPLIER,
        "seed": ransac.seed,
    }
    pose, report = poselib.estimate_absolute_pose(query_xy, points, _camera_fields(camera), options)
    if report["num_inliers"] < 3:  # as COLMAP has it: less than a minimal sample is no support
        return None
    return Found(pose.R, pose.t, np.array(report["inliers"], dtype=np.bool_))


def _camera_fields(camera: Cameras) -> dict[str, Any]:
    """Return the camera as both libraries take it; a pinhole is twice as fast as zeros."""
    parameters = [*camera.focal[0], *camera.principal_point[0]]
    lens = camera.distortion[0]
    return {
        "model": "FULL_OPENCV" if lens.any() else "PINHOLE",
        "width": int(camera.width[0]),
        "height": int(camera.height[0]),
        "params": [*parameters, *lens, 0.0, 0.0, 0.0] if lens.any() else parameters,
    }


_SOLVERS: dict[Solver, Callable[[Cameras, Floats, Floats, Ransac], Found | None]] = {
    "colmap": _colmap,
    "colmap+refine": _colmap_refined,
    "poselib": _poselib,
}
