"""From matches to camera poses: pixels of the map become points, and poses are solved for.

Points are lifted onto the surface model block by block. No answer depends on threads or on the
order of matches. The default, ``colmap``, is the setting of AerialExtreMatch's evaluation:
LO-RANSAC and no refinement after it. Points go to the solver relative to their median: in projected
coordinates (millions of metres) the refining solvers stop centimetres away from their optimum.
Pixels, poses and distortion are the same in pycolmap, in PoseLib and here: image corner (0, 0),
world-to-camera, Brown-Conrady.
"""

from __future__ import annotations

import importlib
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rasterio.windows import Window
from scipy.sparse import csr_array

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.optional_imports import load_pycolmap
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.arrays import Bools, Floats, Ints, apply_matrix, are_on_a_line
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import change_of_plane
from airzoo_bench.geometry.heightfield import (
    HeightField,
    are_inside,
    read_metres,
    small_cache,
    window_shape,
)
from airzoo_bench.geometry.rasters import (
    RasterInfo,
    open_info,
    open_raster,
    pixel_to_world,
    world_to_pixel,
)
from airzoo_bench.matching.predictions import Correspondences
from airzoo_bench.matching.protocol import Solver

_BLOCK_PIXELS = 1 << 20
_CHUNK = 1 << 13  # points located at a time: few enough for the processor's cache
_POINTS = 1 << 16  # sampled at a time, which bounds the memory of a thread


class LiftStatus(IntEnum):
    """The end of a match; its name in lower case is a column of the records."""

    LIFTED = 0
    OUTSIDE_MAP = 1
    OUTSIDE_DSM = 2  # or beyond the domain of one of the two CRS
    NO_HEIGHT = 3  # of a neighbour nearer than a pixel, or one not above `heights_above_m`


class Lifted(NamedTuple):
    """Points (M, 3) in the surface model's CRS, NaN where a match is dropped, and a LiftStatus."""

    points: Floats
    status: NDArray[np.uint8]


def lift(
    map_xy: ArrayLike,
    dom: RasterInfo,
    dsm: RasterInfo | str | Path,
    *,
    heights_above_m: float | None = None,
    jobs: int,
) -> Lifted:
    """Lift pixels (M, 2) of the map onto the surface model in `jobs` threads.

    A height is that of `HeightField.sample`, to the last bit. Points are sorted by blocks of the
    raster, so that each block is read once and the raster is never whole in memory.
    """
    ground = dsm if isinstance(dsm, RasterInfo) else open_info(dsm)
    xy, to_dsm = np.asarray(map_xy, dtype=np.float64), change_of_plane(dom.crs, ground.crs)
    points, status = np.empty((len(xy), 3)), np.empty(len(xy), np.uint8)

    # Threads fill rows of their own.
    def locate(start: int) -> None:
        """Find X and Y, the status except for the height, and the block of the raster."""
        part = slice(start, start + _CHUNK)
        on_map = are_inside(xy[part], dom.width, dom.height)
        usable = xy[part] if on_map.all() else np.where(on_map[:, None], xy[part], np.nan)
        world = to_dsm(pixel_to_world(dom.transform, usable))
        pixel = world_to_pixel(ground.transform, world)
        on_dsm = are_inside(pixel, ground.width, ground.height)
        # By columns: NumPy is some times slower over an axis of two.
        (points[part, 0], points[part, 1]), status[part] = world.T, LiftStatus.LIFTED
        if not on_dsm.all():
            points[part][~on_dsm], pixel[~on_dsm] = np.nan, 0.0
            status[part][~on_dsm] = LiftStatus.OUTSIDE_DSM
            status[part][~on_map] = LiftStatus.OUTSIDE_MAP
        column, row = (pixel.T[0] - 0.5) / width, (pixel.T[1] - 0.5) / height
        block[part] = np.where(on_dsm, row.astype(int) * across + column.astype(int), blocks)

    def sample(dataset: Any, runs: Ints) -> None:
        """Find the heights of runs of points, each in one block."""
        for start, stop in runs.tolist():
            rows = order[start:stop].astype(np.int64)
            flat, x = points.reshape(-1), 3 * rows
            world = np.stack((flat.take(x), flat.take(x + 1)), axis=-1)
            pixel = world_to_pixel(ground.transform, world)
            heights = _sample_block(dataset, ground, pixel, heights_above_m)
            flat[x + 2] = heights
            lost = rows[np.isnan(heights)]
            status[lost], points[lost] = LiftStatus.NO_HEIGHT, np.nan

    with ExitStack() as stack, ThreadPoolExecutor(jobs) as pool:
        stack.enter_context(small_cache())
        datasets = [stack.enter_context(open_raster(ground.path))]
        width, height = window_shape(datasets[0], _BLOCK_PIXELS)
        across = -(-ground.width // width)
        blocks = across * -(-ground.height // height)
        block = np.empty(len(xy), np.int32)
        list(pool.map(locate, range(0, len(xy), _CHUNK)))
        # A change of rows for columns sorts by counting, twice as fast as `argsort`.
        by_point = (np.ones(len(xy), np.bool_), block, np.arange(len(xy) + 1, dtype=np.int32))
        by_block = csr_array(by_point, shape=(len(xy), blocks + 1)).tocsc()
        order, borders = by_block.indices, by_block.indptr[:-1].tolist()
        starts = [start for ends in pairwise(borders) for start in range(*ends, _POINTS)]
        runs = list(pairwise([*starts, borders[-1]]))
        shares = [share for share in np.array_split(runs, jobs) if share.size]
        # Opened here and not by the threads, which share the warnings that `opened` sets.
        datasets += [stack.enter_context(open_raster(ground.path)) for _ in shares[1:]]
        list(pool.map(sample, datasets, shares))
    return Lifted(points, status)


def _sample_block(
    dataset: Any, ground: RasterInfo, pixel: Floats, heights_above_m: float | None
) -> Floats:
    """Return heights at pixel coordinates that lie in one block."""
    first = np.array([(axis.min(), axis.max()) for axis in pixel.T]) - 0.5
    (left, right), (top, bottom) = np.maximum(first, 0.0).astype(np.int64).tolist()
    # The neighbours of the last cell, where the raster has them.
    right, bottom = min(right + 2, ground.width), min(bottom + 2, ground.height)
    heights = read_metres(dataset, Window(left, top, right - left, bottom - top))
    field = HeightField(heights, ground.transform, ground.crs)
    local = np.stack((pixel[:, 0] - left, pixel[:, 1] - top), axis=-1)
    sampled = field.sample_pixels(local)
    if heights_above_m is not None:
        last = np.array(heights.shape[::-1]) - 1
        ends = [np.clip(end(local - 0.5), 0, last).astype(np.int64) for end in (np.floor, np.ceil)]
        # All neighbours that have a weight.
        for columns, rows in ((x[:, 0], y[:, 1]) for x in ends for y in ends):
            sampled[~(field.heights_at(columns, rows) > heights_above_m)] = np.nan
    return sampled


# --- poses from points ---

MIN_MATCHES = 4  # three have up to four poses, and nothing tells which
# Both libraries multiply the number of trials that the confidence asks for; both default to 3.
_TRIALS_MULTIPLIER = 3.0
_QUERIES_A_THREAD = 4  # of a block: a query may take ten seconds, and hard ones come together


class Status(StrEnum):
    """How a query came by its pose, or why it has none."""

    SOLVED = "solved"
    TOO_FEW_MATCHES = "too few matches"
    NO_POSE = "no pose"
    GIVEN = "given"
    NOT_GIVEN = "no pose given"
    MISSING = "missing from the predictions"


@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """The answer of a solver for one query of M matches.

    Attributes
    ----------
    status : Status
        A failure is anything but ``SOLVED``.
    inliers : (M,) bool array
        Matches that the pose explains; none on failure.
    rotation, centre : (3, 3) array, (3,) array
        World-to-camera, and the camera centre in the frame of the points; NaN on failure.
    beyond_limit : int
        Matches beyond `max_matches`, which were not used.
    """

    status: Status
    inliers: Bools
    rotation: Floats
    centre: Floats
    beyond_limit: int = 0

    @property
    def matrix(self) -> Floats:
        """The pose [R | t], (3, 4), world-to-camera; NaN on failure."""
        return np.column_stack([self.rotation, -apply_matrix(self.rotation, self.centre)])


def solve_queries(
    cameras: Cameras, pairs: Correspondences, solver: Solver, run: Run, name: str
) -> list[PoseEstimate]:
    """Solve for the poses of Q queries in blocks; `name` names them in messages."""
    blocks = run.engine.map(
        _solve_block,
        run.engine.cut(len(pairs.offsets) - 1, _QUERIES_A_THREAD * run.jobs),
        shared=(cameras, pairs, solver, run.jobs),
        stage="blocks of queries",
        name=lambda block: f"queries {block.start + 1:,} to {block.stop:,} of {name}",
    )
    return [estimate for estimates in blocks for estimate in estimates]


def _solve_block(
    shared: tuple[Cameras, Correspondences, Solver, int], block: slice
) -> list[PoseEstimate]:
    """Solve some queries by threads, one a query, as long as nothing fails."""
    cameras, pairs, solver, jobs = shared
    assert pairs.points3d is not None
    load_pycolmap()  # here, since signals that it takes are given back in the main thread only
    pool, rows_of, points = ThreadPoolExecutor(jobs), pairs.row_slices(), pairs.points3d

    def solve(query: int) -> PoseEstimate:
        rows = rows_of[query]
        return solve_pose(cameras.take(query), pairs.query_xy[rows], points[rows], solver)

    try:
        return list(pool.map(solve, range(block.start, block.stop)))
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def solve_pose(camera: Cameras, query_xy: Floats, points: Floats, solver: Solver) -> PoseEstimate:
    """Find the camera pose that most matches agree on, whatever their order and repetitions.

    Takes pixels (M, 2) and points (M, 3), all finite, of one camera.
    """
    matches = np.concatenate((query_xy, points), axis=1)
    rows, row_of = np.unique(matches, axis=0, return_inverse=True)
    chosen, inliers = np.arange(len(rows)), np.zeros(len(rows), np.bool_)
    if len(rows) > solver.max_matches:
        random = np.random.default_rng(solver.seed)
        chosen = np.sort(random.choice(len(rows), solver.max_matches, replace=False))
    beyond = len(points) - int(np.isin(row_of, chosen).sum())
    status, pose = Status.TOO_FEW_MATCHES, np.full((4, 3), np.nan)
    if len(rows) >= MIN_MATCHES:
        status, solution = Status.NO_POSE, _solve_rows(camera, rows[chosen], solver)
        if solution is not None:
            status, pose, inliers[chosen] = Status.SOLVED, np.vstack(solution[:2]), solution[2]
    return PoseEstimate(status, inliers[row_of], pose[:3], pose[3], beyond)


_Solution = tuple[Floats, Floats, Bools]  # rotation; centre or translation; inliers


def _solve_rows(camera: Cameras, rows: Floats, solver: Solver) -> _Solution | None:
    """Find rotation, centre and inliers of rows (M, 5); their number limits the trials."""
    most = max(1, solver.max_trials_times_matches // len(rows))
    trials = (min(solver.min_trials, most), min(solver.max_trials, most))
    query_xy, points = np.ascontiguousarray(rows[:, :2]), rows[:, 2:]
    half = len(points) // 2
    origin = np.partition(points, half, axis=0)[half]  # a median, which outliers do not move
    find = _find_by_poselib if solver.name == "poselib" else _find_by_colmap
    # Points so far away that numbers overflow make no pose, or one that is not finite.
    with np.errstate(over="ignore", invalid="ignore"):
        local = points - origin
        solution = find(camera, query_xy, local, solver, trials)
        if solution is None or are_on_a_line(local[solution[2]]):
            return None
        rotation, translation, inliers = solution
        centre = origin - apply_matrix(rotation.T, translation)
    # The centre is not finite where the rotation is not.
    return (rotation, centre, inliers) if np.isfinite(centre).all() else None


def _find_by_colmap(
    camera: Cameras, query_xy: Floats, points: Floats, solver: Solver, trials: tuple[int, int]
) -> _Solution | None:
    pycolmap = load_pycolmap()
    ransac = {
        "max_error": solver.max_error_px,
        "min_inlier_ratio": solver.min_inlier_ratio,
        "min_num_trials": trials[0],
        "max_num_trials": trials[1],
        "confidence": solver.confidence,
        "dyn_num_trials_multiplier": _TRIALS_MULTIPLIER,
        "random_seed": solver.seed,  # every call starts its random numbers anew
        "num_threads": 1,
    }
    options = pycolmap.AbsolutePoseEstimationOptions(estimate_focal_length=False, ransac=ransac)
    arguments = (query_xy, points, pycolmap.Camera(**_camera_fields(camera)), options)
    if solver.name == "colmap":
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
    return pose.rotation.matrix(), pose.translation, answer["inlier_mask"]


def _find_by_poselib(
    camera: Cameras, query_xy: Floats, points: Floats, solver: Solver, trials: tuple[int, int]
) -> _Solution | None:
    try:
        poselib: Any = importlib.import_module("poselib")
    except ImportError as error:
        fix = "pip install poselib, or choose the solver 'colmap' or 'colmap+refine'"
        raise UsageError("the solver 'poselib' needs PoseLib, not installed", fix=fix) from error
    options = {
        "max_reproj_error": solver.max_error_px,
        "min_iterations": trials[0],
        "max_iterations": trials[1],
        "success_prob": solver.confidence,
        "dyn_num_trials_mult": _TRIALS_MULTIPLIER,
        "seed": solver.seed,
    }
    pose, report = poselib.estimate_absolute_pose(query_xy, points, _camera_fields(camera), options)
    if report["num_inliers"] < 3:  # as COLMAP has it: less than a minimal sample is no support
        return None
    return pose.R, pose.t, np.array(report["inliers"], dtype=np.bool_)


def _camera_fields(camera: Cameras) -> dict[str, Any]:
    """Return the camera as both libraries take it; a pinhole is twice as fast as zeros."""
    parameters, lens = [*camera.focal[0], *camera.principal_point[0]], camera.distortion[0]
    return {
        "model": "FULL_OPENCV" if lens.any() else "PINHOLE",
        "width": int(camera.width[0]),
        "height": int(camera.height[0]),
        "params": [*parameters, *lens, 0.0, 0.0, 0.0] if lens.any() else parameters,
    }
