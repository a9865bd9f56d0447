"""Poses of matches: conventions, what may change an answer, and failures as results."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.matching.solving import PoseEstimate, Status, solve_pose, solve_queries
from tests.engines.work import Scattered
from tests.matching.world import PROJECTED, SOLVER, Problem, errors, joined, make_scene


def solve(problem: Problem, **changes: Any) -> PoseEstimate:
    return solve_pose(*problem, SOLVER.model_copy(update=changes))


@pytest.fixture(params=("colmap", "colmap+refine", "poselib"))
def name(request: pytest.FixtureRequest) -> str:
    if request.param == "poselib":
        pytest.importorskip("poselib", reason="the optional PoseLib is not installed")
    return str(request.param)


# A camera 50 m above (100, 200, 0) that looks down, north up: a metre on the ground is 20 pixels,
# and 25 at a height of 10 m.
NADIR = Cameras.from_matrices([[[1000.0, 0, 500], [0, 1000, 400], [0, 0, 1]]], 1000, 800)
BY_HAND = [
    ((500, 400), (100, 200, 0)),
    ((700, 400), (110, 200, 0)),  # east is right
    ((500, 200), (100, 210, 0)),  # north is up
    ((500, 650), (100, 190, 10)),  # south is down
    ((250, 400), (90, 200, 10)),
    ((0, 0), (75, 220, 0)),  # the image's corner
    ((1000, 800), (125, 180, 0)),
]


def test_pose_by_hand(name: str) -> None:
    xy, points = (np.array(column, dtype=np.float64) for column in zip(*BY_HAND, strict=True))
    estimate = solve(Problem(NADIR, xy, points), name=name)
    assert estimate.status is Status.SOLVED
    assert estimate.inliers.all()
    np.testing.assert_allclose(estimate.centre, (100, 200, 50), atol=1e-6)
    np.testing.assert_allclose(estimate.rotation, np.diag((1, -1, -1)), atol=1e-8)


def test_place_on_earth_does_not_matter(name: str) -> None:
    here = make_scene(4, noise_px=1.0, outliers=0.5)
    there = make_scene(4, noise_px=1.0, outliers=0.5, origin=PROJECTED)
    found, moved = (solve(scene.problem, name=name) for scene in (here, there))
    assert np.abs(moved.centre - PROJECTED - found.centre).max() < 1e-6
    assert np.abs(moved.rotation - found.rotation).max() < 1e-8
    assert (moved.inliers == found.inliers).all()


@pytest.mark.parametrize(("most", "beyond"), [(20_000, 0), (100, 200)])
def test_neither_order_nor_doubles_change_a_bit(most: int, beyond: int) -> None:
    scene = make_scene(31, count=300, noise_px=1.0, outliers=0.3)
    camera, xy, points = scene.problem
    first = solve(scene.problem, max_matches=most)
    assert first.beyond_limit == beyond
    assert first.inliers.sum() <= most
    assert errors(first, scene)[0] < 2.0
    random = np.random.default_rng(0)
    copies = np.concatenate([random.permutation(300), np.full(500, 7), np.arange(50)])
    for order in (random.permutation(300), copies):
        again = solve(Problem(camera, xy[order], points[order]), max_matches=most)
        np.testing.assert_array_equal(again.matrix, first.matrix)
        np.testing.assert_array_equal(again.inliers, first.inliers[order])
    other = solve(scene.problem, max_matches=most, seed=1)
    assert (other.inliers != first.inliers).any() or not beyond


@pytest.mark.parametrize(("size", "jobs"), [(1, 3), (2, 1), (None, 3)])
def test_queries_are_solved_alike_in_any_blocks(size: int | None, jobs: int) -> None:
    problems = [make_scene(n, count=100, noise_px=1.0, outliers=0.4).problem for n in range(5)]
    run = Run(jobs=jobs, engine=Scattered(size))
    found = solve_queries(*joined(problems), SOLVER, run, "the made scene")
    for problem, estimate in zip(problems, found, strict=True):
        alone = solve(problem)
        assert estimate.matrix.tobytes() == alone.matrix.tobytes()
        assert estimate.inliers.tobytes() == alone.inliers.tobytes()


# --- failures are results -----------------------------------------------------------------------


def line_problem(origin: Any = (0.0, 0.0, 0.0), noise_px: float = 0.0) -> Problem:
    scene = make_scene(7)
    points = np.linspace(-1.0, 1.0, 200)[:, None] * (30.0, 5.3, 1.7) + (3.0, 30.0, 10.0)
    in_camera = (points - scene.centre) @ scene.rotation.T
    xy = in_camera[:, :2] / in_camera[:, 2:] * (2900.0, 2930.0) + (2010.0, 1480.0)
    xy += np.random.default_rng(0).normal(0.0, noise_px, xy.shape)
    return Problem(scene.problem.camera, xy, points + origin)


def changed(rows: Any, xy: float = 1.0, points: float = 1.0) -> Problem:
    problem = make_scene(8, count=40).problem
    return Problem(problem.camera, problem.query_xy[rows] * xy, problem.points[rows] * points)


FAILURES = {
    "none": (changed([]), Status.TOO_FEW_MATCHES),
    "three often": (changed([0, 1, 2] * 10), Status.TOO_FEW_MATCHES),
    "one pixel": (changed(..., xy=0.0), Status.NO_POSE),
    "one point": (changed(..., points=0.0), Status.NO_POSE),
    "line": (line_problem(), Status.NO_POSE),
    "noisy line far away": (line_problem(PROJECTED, 0.5), Status.NO_POSE),
    "points overflow": (changed(..., points=1e305), Status.NO_POSE),
    "pixels too far": (changed(..., xy=1e300), Status.NO_POSE),
}


@pytest.mark.parametrize("case", FAILURES)
def test_failures(case: str, name: str, capfd: pytest.CaptureFixture[str]) -> None:
    problem, status = FAILURES[case]
    estimate = solve(problem, name=name, max_trials=5000)
    assert estimate.status is status
    assert np.isnan(estimate.matrix).all()
    assert estimate.inliers.tolist() == [False] * len(problem.points)
    assert capfd.readouterr() == ("", "")
