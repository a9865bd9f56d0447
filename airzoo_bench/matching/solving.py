"""Camera poses from 2D-3D matches, by robust solvers whose answers do not depend on threads.

The default, ``colmap``, is the setting of AerialExtreMatch's evaluation: LO-RANSAC and no
refinement after it. Points go to the solver relative to their median: in projected coordinates
(millions of metres) the refining solvers stop centimetres away from their optimum. Pixels, poses
and distortion are the same in pycolmap, in PoseLib and here: image corner (0, 0),
world-to-camera, Brown-Conrady.
"""

from __future__ import annotations

import importlib
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from enum import StrEnum
from threading import current_thread, main_thread
from time import perf_counter
from typing import Any, Literal, NamedTuple, TypedDict, Unpack, overload

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.optional_imports import load_pycolmap
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.core.shown import Shown, number
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.arrays import Bools, Floats, Ints, apply_matrix
from airzoo_bench.geometry.cameras import Cameras

__all__ = [
    "MIN_MATCHES",
    "PoseEstimate",
    "PoseProblem",
    "PoseQueries",
    "PoseSettings",
    "QueryPoses",
    "Solver",
    "Status",
    "solve_pose",
    "solve_poses",
    "solve_queries",
]

Solver = Literal["colmap", "colmap+refine", "poselib"]

MIN_MATCHES = 4  # three have up to four poses, and nothing tells which

# Both libraries multiply the number of trials that the confidence asks for; both default to 3.
_TRIALS_MULTIPLIER = 3.0
# Points nearer to a line than this share of its length leave the turn about it to rounding.
_LINE_TOLERANCE = 1e-6
# Problems under way or waiting, for each job: enough that a slow one does not idle the others.
_WINDOW = 64
# A query may take ten seconds, and photos taken one after the other are hard together: each is a
# task, and the engine sends short ones together. Only of very many queries some go into one.
_TASKS, _QUERIES_A_TASK, _QUERIES_A_THREAD = 10_000, 64, 16


class Status(StrEnum):
    """How the search for a pose ended."""

    SOLVED = "solved"
    TOO_FEW_MATCHES = "too few matches"
    NO_POSE = "no pose"


_STATUSES = tuple(Status)


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


class PoseProblem(NamedTuple):
    """One query: its camera (Cameras of one), query_xy (M, 2) and points (M, 3)."""

    camera: Cameras
    query_xy: Floats
    points: Floats


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


class QueryPoses(NamedTuple):
    """The poses of Q queries with M matches, from the solver or the file to the records.

    Attributes
    ----------
    rotations : (Q, 3, 3) array
    centres : (Q, 3) array
        NaN on failure, as rotations are.
    status : list of Q str
    inliers : (M,) bool array
        Empty where poses were given.
    left_out : (Q,) int array
    seconds : (Q,) array
        See `PoseEstimate` for all of them.
    """

    rotations: Floats
    centres: Floats
    status: list[str]
    inliers: Bools
    left_out: Ints
    seconds: Floats


@dataclass(frozen=True, eq=False)
class PoseQueries(Sequence[PoseProblem]):
    """Queries whose poses are to be found; their problems are made as they are asked for.

    Attributes
    ----------
    name : str
        What they are called in messages.
    cameras : Cameras
        Of Q queries.
    offsets : (Q + 1,) int64
        Query q has the matches ``offsets[q]:offsets[q + 1]``; the first is 0.
    query_xy : (M, 2) float64
    points : (M, 3) float64
    """

    name: str
    cameras: Cameras
    offsets: Ints
    query_xy: Floats
    points: Floats

    def __len__(self) -> int:
        return len(self.offsets) - 1

    @overload
    def __getitem__(self, index: int) -> PoseProblem: ...
    @overload
    def __getitem__(self, index: slice) -> PoseQueries: ...
    def __getitem__(self, index: int | slice) -> PoseProblem | PoseQueries:
        if isinstance(index, int):
            if not 0 <= index < len(self):
                raise IndexError(index)
            one = slice(*self.offsets[index : index + 2].tolist())
            return PoseProblem(self.cameras.take(index), self.query_xy[one], self.points[one])
        first, stop, _ = index.indices(len(self))
        some = slice(*self.offsets[[first, stop]].tolist())
        return PoseQueries(
            f"queries {first + 1:,} to {stop:,} of {self.name}",
            self.cameras.take(index),
            self.offsets[first : stop + 1] - self.offsets[first],
            self.query_xy[some],
            self.points[some],
        )


class _Found(NamedTuple):
    """A pose x_cam = R X + t, and which of the (M,) matches are its inliers."""

    rotation: Floats
    translation: Floats
    inliers: Bools


def solve_pose(
    camera: Cameras, query_xy: Floats, points: Floats, **settings: Unpack[PoseSettings]
) -> PoseEstimate:
    """Find the camera pose that most matches agree on, whatever their order and repetitions."""
    _check_settings(settings)
    _check_problem(camera, query_xy, points)
    matches = np.concatenate((query_xy, points), axis=1)
    rows, place = np.unique(matches, axis=0, return_inverse=True)
    if len(rows) < MIN_MATCHES:
        return _failure(Status.TOO_FEW_MATCHES, len(points))
    chosen = np.arange(len(rows))
    if len(rows) > settings["max_matches"]:
        random = np.random.default_rng(settings["seed"])
        chosen = np.sort(random.choice(len(rows), settings["max_matches"], replace=False))
    most = max(1, settings["max_trials_times_matches"] // len(chosen))
    settings["min_trials"] = min(settings["min_trials"], most)
    settings["max_trials"] = min(settings["max_trials"], most)
    estimate = _solve_rows(camera, rows[chosen], settings)
    of_rows = np.zeros(len(rows), np.bool_)
    of_rows[chosen] = estimate.inliers
    left_out = len(points) - int(np.isin(place, chosen).sum())
    return replace(estimate, inliers=of_rows[place], left_out=left_out)


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
    return list(progress(_map_in_threads(solve, problems, jobs), "poses", len(problems)))


def solve_queries(queries: PoseQueries, settings: PoseSettings, run: Run) -> QueryPoses:
    """Solve for the poses of queries in blocks, wherever the engine has it done."""
    size = _queries_a_task(len(queries), run.jobs)
    blocks = [queries[cut] for cut in run.engine.cut(len(queries), size)]
    # Where all is one task, it shows how far it is; tasks are shown by the engine.
    progress = run.progress if len(blocks) == 1 else silent
    found = run.engine.map(
        _solve_block,
        blocks,
        shared=(settings, run.jobs, progress),
        stage="blocks of queries",
        name=lambda block: block.name,
    )
    results = [_to_arrays([]), *found]
    inliers = [np.unpackbits(one["inliers"], count=int(one["matches"][0])) for one in results]
    joined = {name: np.concatenate([one[name] for one in results]) for name in results[0]}
    return QueryPoses(
        joined["rotations"],
        joined["centres"],
        [_STATUSES[code].value for code in joined["status"].tolist()],
        np.concatenate(inliers).astype(np.bool_),
        joined["left_out"],
        joined["seconds"],
    )


def _queries_a_task(count: int, jobs: int) -> int:
    size = min(_QUERIES_A_TASK, max(1, count // _TASKS))
    return size if jobs == 1 else max(size, _QUERIES_A_THREAD * jobs)


def _solve_block(
    shared: tuple[PoseSettings, int, Progress], block: PoseQueries
) -> dict[str, NDArray[Any]]:
    settings, jobs, progress = shared
    return _to_arrays(solve_poses(block, jobs=jobs, progress=progress, **settings))


def _to_arrays(found: list[PoseEstimate]) -> dict[str, NDArray[Any]]:
    """Return estimates as arrays, which engines send and keep without pickle."""
    inliers = np.concatenate([np.zeros(0, np.bool_), *(one.inliers for one in found)])
    return {
        "rotations": np.array([one.rotation for one in found]).reshape(-1, 3, 3),
        "centres": np.array([one.centre for one in found]).reshape(-1, 3),
        "status": np.array([_STATUSES.index(one.status) for one in found], np.uint8),
        "matches": np.array([len(inliers)]),
        "inliers": np.packbits(inliers),  # an eighth on its way back
        "left_out": np.array([one.left_out for one in found], np.int64),
        "seconds": np.array([one.seconds for one in found], np.float64),
    }


def _map_in_threads(
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


def _check_settings(settings: PoseSettings) -> None:
    """Raise ValueError for an unknown solver, or settings that it could not work with."""
    if settings["solver"] not in _SOLVERS:
        raise ValueError(
            f"unknown solver {settings['solver']!r}, expected one of {', '.join(_SOLVERS)}"
        )
    possible = {
        "max_error_px": 0 < settings["max_error_px"] < np.inf,
        "min_inlier_ratio": 0 < settings["min_inlier_ratio"] < 1,
        "min_trials": 0 < settings["min_trials"] <= settings["max_trials"],
        "max_trials": settings["max_trials"] < 2**31,
        "confidence": 0 < settings["confidence"] < 1,
        "seed": 0 <= settings["seed"] < 2**31,
    }
    values: Mapping[str, object] = {**settings}
    bad = [f"{name} {values[name]}" for name, fits in possible.items() if not fits]
    if bad:
        raise ValueError(f"settings that are not possible: {', '.join(bad)}")


def _check_problem(camera: Cameras, query_xy: Floats, points: Floats) -> None:
    if len(camera) != 1:
        raise ValueError(f"{len(camera)} cameras, expected one")
    if query_xy.shape != (len(points), 2) or points.shape != (len(points), 3):
        raise ValueError(
            f"query_xy {query_xy.shape} and points {points.shape}, expected (M, 2) and (M, 3)"
        )
    if not (np.isfinite(query_xy).all() and np.isfinite(points).all()):
        raise ValueError("query_xy or points hold NaN or infinity")


def _solve_rows(camera: Cameras, rows: Floats, settings: PoseSettings) -> PoseEstimate:
    """Solve for rows (M, 5) of query_xy and points."""
    query_xy, points = np.ascontiguousarray(rows[:, :2]), rows[:, 2:]
    origin = _middle(points)
    # Points so far away that numbers overflow make no pose, or one that is not finite.
    with np.errstate(over="ignore", invalid="ignore"):
        local = points - origin
        found = _SOLVERS[settings["solver"]](camera, query_xy, local, settings)
        if found is None or _on_a_line(local[found.inliers]):
            return _failure(Status.NO_POSE, len(points))
        centre = origin - apply_matrix(found.rotation.T, found.translation)
    if not np.isfinite(centre).all():  # as it is not where the rotation is not
        return _failure(Status.NO_POSE, len(points))
    return PoseEstimate(found.rotation, centre, found.inliers, Status.SOLVED)


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


def _find_by_colmap(
    camera: Cameras, query_xy: Floats, points: Floats, settings: PoseSettings
) -> _Found | None:
    pycolmap = load_pycolmap()
    ransac = {
        "max_error": settings["max_error_px"],
        "min_inlier_ratio": settings["min_inlier_ratio"],
        "min_num_trials": settings["min_trials"],
        "max_num_trials": settings["max_trials"],
        "confidence": settings["confidence"],
        "dyn_num_trials_multiplier": _TRIALS_MULTIPLIER,
        # Random numbers are a thread's own; with a seed every call starts them anew, whatever
        # `pycolmap.set_random_seed` or earlier calls of the thread have done.
        "random_seed": settings["seed"],
        "num_threads": 1,
    }
    options = pycolmap.AbsolutePoseEstimationOptions(estimate_focal_length=False, ransac=ransac)
    arguments = (query_xy, points, pycolmap.Camera(**_camera_fields(camera)), options)
    if settings["solver"] == "colmap":
        answer = pycolmap.estimate_absolute_pose(*arguments)
    else:
        # COLMAP's own values, written down so that a new version of it does not change scores.
        refinement = pycolmap.AbsolutePoseRefinementOptions(
            loss_function_scale=1.0,
            gradient_tolerance=1.0,
            max_num_iterations=100,
            refine_focal_length=False,
            refine_extra_params=False,
        )
        answer = pycolmap.estimate_and_refine_absolute_pose(*arguments, refinement)
    if answer is None:
        return None
    pose = answer["cam_from_world"]
    return _Found(pose.rotation.matrix(), pose.translation, answer["inlier_mask"])


def _find_by_poselib(
    camera: Cameras, query_xy: Floats, points: Floats, settings: PoseSettings
) -> _Found | None:
    try:
        poselib: Any = importlib.import_module("poselib")
    except ImportError as error:
        raise UsageError(
            "the solver 'poselib' needs PoseLib, which is not installed",
            fix="pip install poselib, or choose the solver 'colmap' or 'colmap+refine'",
        ) from error
    options = {
        "max_reproj_error": settings["max_error_px"],
        "min_iterations": settings["min_trials"],
        "max_iterations": settings["max_trials"],
        "success_prob": settings["confidence"],
        "dyn_num_trials_mult": _TRIALS_MULTIPLIER,
        "seed": settings["seed"],
    }
    pose, report = poselib.estimate_absolute_pose(query_xy, points, _camera_fields(camera), options)
    if report["num_inliers"] < 3:  # as COLMAP has it: less than a minimal sample is no support
        return None
    return _Found(pose.R, pose.t, np.array(report["inliers"], dtype=np.bool_))


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


_SOLVERS: dict[str, Callable[[Cameras, Floats, Floats, PoseSettings], _Found | None]] = {
    "colmap": _find_by_colmap,
    "colmap+refine": _find_by_colmap,
    "poselib": _find_by_poselib,
}
