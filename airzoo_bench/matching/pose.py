"""Camera poses from 2D-3D matches, by robust solvers whose answers do not depend on threads.

The default, ``colmap``, is the setting of AerialExtreMatch's evaluation: LO-RANSAC and
no refinement after it. Points go to the solver relative to their median: in projected coordinates
(millions of metres) the refining solvers stop centimetres away from their optimum.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from threading import current_thread, main_thread
from time import perf_counter
from typing import NamedTuple, TypedDict, Unpack

import numpy as np

from airzoo_bench.core.optional_imports import load_pycolmap
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.geometry.arrays import Floats, Ints, apply_matrix
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.matching.solvers import (
    PoseEstimate,
    Ransac,
    Solver,
    Status,
    check_settings,
    find_pose,
)

__all__ = [
    "MIN_MATCHES",
    "PoseEstimate",
    "PoseProblem",
    "PoseSettings",
    "Status",
    "solve_pose",
    "solve_poses",
]

MIN_MATCHES = 4  # three have up to four poses, and nothing tells which

# Points nearer to a line than this share of its length leave the turn about it to rounding.
_LINE_TOLERANCE = 1e-6
# Problems under way or waiting, for each job: enough that a slow one does not idle the others.
_WINDOW = 64


class PoseProblem(NamedTuple):
    """One query: its camera (Cameras of one), query_xy (M, 2) and points (M, 3)."""

    camera: Cameras
    query_xy: Floats
    points: Floats


class PoseSettings(TypedDict):
    """The keyword arguments of `solve_pose`."""

    solver: Solver
    max_error_px: float
    min_inlier_ratio: float
    min_trials: int
    max_trials: int
    confidence: float
    seed: int
    max_matches: int
    max_trials_times_matches: int


def solve_pose(
    camera: Cameras,
    query_xy: Floats,
    points: Floats,
    *,
    solver: Solver,
    max_error_px: float,
    min_inlier_ratio: float,
    min_trials: int,
    max_trials: int,
    confidence: float,
    seed: int,
    max_matches: int,
    max_trials_times_matches: int,
) -> PoseEstimate:
    """Find the camera pose that most matches agree on."""
    ransac = Ransac(max_error_px, min_inlier_ratio, min_trials, max_trials, confidence, seed)
    check_settings(solver, ransac)
    _check_problem(camera, query_xy, points)
    given = np.concatenate((query_xy, points), axis=1)
    rows, place = np.unique(given, axis=0, return_inverse=True)
    if len(rows) < MIN_MATCHES:
        return _failure(Status.TOO_FEW_MATCHES, len(points))
    chosen = _chosen(len(rows), max_matches, seed)
    most = max(1, max_trials_times_matches // len(chosen))
    bounded = ransac._replace(
        min_trials=min(ransac.min_trials, most), max_trials=min(ransac.max_trials, most)
    )
    estimate = _solve(solver, camera, rows[chosen], bounded)
    of_rows = np.zeros(len(rows), np.bool_)
    of_rows[chosen] = estimate.inliers
    left_out = len(points) - int(np.isin(place, chosen).sum())
    return replace(estimate, inliers=of_rows[place], left_out=left_out)


def _chosen(count: int, most: int, seed: int) -> Ints:
    if count <= most:
        return np.arange(count)
    return np.sort(np.random.default_rng(seed).choice(count, most, replace=False))


def _solve(solver: Solver, camera: Cameras, rows: Floats, ransac: Ransac) -> PoseEstimate:
    """Solve for rows (M, 5) of query_xy and points."""
    query_xy, points = np.ascontiguousarray(rows[:, :2]), rows[:, 2:]
    origin = _middle(points)
    # Points so far away that numbers overflow make no pose, or one that is not finite.
    with np.errstate(over="ignore", invalid="ignore"):
        local = points - origin
        found = find_pose(solver, camera, query_xy, local, ransac)
        if found is None or _on_a_line(local[found.inliers]):
            return _failure(Status.NO_POSE, len(points))
        centre = origin - apply_matrix(found.rotation.T, found.translation)
    if not np.isfinite(centre).all():  # as it is not where the rotation is not
        return _failure(Status.NO_POSE, len(points))
    return PoseEstimate(found.rotation, centre, found.inliers, Status.SOLVED)


def solve_poses(
    problems: Sequence[PoseProblem],
    *,
    jobs: int,
    progress: Progress = silent,
    **settings: Unpack[PoseSettings],
) -> list[PoseEstimate]:
    """Solve many problems, one thread each."""
    if jobs < 1:
        raise ValueError(f"jobs is {jobs}, expected at least 1")

    def solve(problem: PoseProblem) -> PoseEstimate:
        begin = perf_counter()
        estimate = solve_pose(*problem, **settings)
        return replace(estimate, seconds=perf_counter() - begin)

    load_pycolmap()  # here, since signals that it takes are given back in the main thread only
    return list(progress(_threaded(solve, problems, jobs), "poses", len(problems)))


def _threaded(
    solve: Callable[[PoseProblem], PoseEstimate], problems: Sequence[PoseProblem], jobs: int
) -> Iterator[PoseEstimate]:
    """Map in order, with a bounded number of problems taken and not yet answered."""
    if jobs == 1 and current_thread() is not main_thread():
        yield from map(solve, problems)
        return
    pending: deque[Future[PoseEstimate]] = deque()
    pool = ThreadPoolExecutor(jobs)
    try:
        for problem in problems:
            if len(pending) == _WINDOW * jobs:
                yield pending.popleft().result()
            pending.append(pool.submit(solve, problem))
        while pending:
            yield pending.popleft().result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _check_problem(camera: Cameras, query_xy: Floats, points: Floats) -> None:
    if len(camera) != 1:
        raise ValueError(f"{len(camera)} cameras, expected one")
    if query_xy.shape != (len(points), 2) or points.shape != (len(points), 3):
        raise ValueError(
            f"query_xy {query_xy.shape} and points {points.shape}, expected (M, 2) and (M, 3)"
        )
    if not (np.isfinite(query_xy).all() and np.isfinite(points).all()):
        raise ValueError("query_xy or points hold NaN or infinity")


def _middle(points: Floats) -> Floats:
    """Return a median of each axis, which outliers do not move."""
    half = len(points) // 2
    middle: Floats = np.partition(points, half, axis=0)[half]
    return middle


def _on_a_line(points: Floats) -> bool:
    away = points - points[0]
    axis = away[np.argmax(np.abs(away).max(axis=1))]
    across = np.cross(away, axis)
    return bool(np.abs(across).max() <= _LINE_TOLERANCE * (axis @ axis))


def _failure(status: Status, count: int) -> PoseEstimate:
    nothing = np.zeros(count, dtype=np.bool_)
    return PoseEstimate(np.full((3, 3), np.nan), np.full(3, np.nan), nothing, status)
