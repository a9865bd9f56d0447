"""What poses are solved from: what is refused, in which order it may stand, how much counts."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import UsageError
from airzoo_bench.matching import solving
from airzoo_bench.matching.solving import PoseSettings, Status, solve_pose, solve_poses
from tests.matching.pose_support import SETTINGS, errors, make_scene


@pytest.mark.parametrize("where", ["query_xy", "points"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_coordinates_must_be_finite(where, value):
    problem = make_scene(8).problem
    getattr(problem, where)[5, 1] = value
    with pytest.raises(ValueError, match="NaN or infinity"):
        solve_pose(*problem, **SETTINGS)
    getattr(problem, where)[:] = value
    with pytest.raises(ValueError, match="NaN or infinity"):
        solve_pose(*problem, **SETTINGS)


def test_shapes_must_fit():
    camera, xy, points = make_scene(8).problem
    for bad_xy, bad_points in [(xy[:-1], points), (xy, points[:, :2]), (points, points)]:
        with pytest.raises(ValueError, match=r"expected \(M, 2\) and \(M, 3\)"):
            solve_pose(camera, bad_xy, bad_points, **SETTINGS)
    with pytest.raises(ValueError, match="2 cameras"):
        solve_pose(camera.take([0, 0]), xy, points, **SETTINGS)


@pytest.mark.parametrize(
    "bad",
    [
        {"solver": "opencv"},
        {"max_error_px": 0.0},
        {"max_error_px": np.nan},
        {"min_inlier_ratio": 1.5},
        {"min_trials": 2000, "max_trials": 1000},
        {"max_trials": 2**31},
        {"confidence": 1.0},
        {"seed": -1},  # which would be a random seed to COLMAP
        {"seed": 2**31},
    ],
)
def test_settings_must_be_possible(bad):
    with pytest.raises(ValueError, match=str(next(iter(bad.values())))):
        solve_pose(*make_scene(8).problem, **SETTINGS | bad)


def test_workers_must_be_possible():
    with pytest.raises(ValueError, match="jobs is 0"):
        solve_poses([], jobs=0, **SETTINGS)


def test_poselib_that_is_not_there(monkeypatch):
    monkeypatch.setitem(sys.modules, "poselib", None)
    with pytest.raises(UsageError, match="pip install poselib"):
        solve_pose(*make_scene(8).problem, **SETTINGS | {"solver": "poselib"})
    assert solve_pose(*make_scene(8).problem, **SETTINGS).status is Status.SOLVED


def test_the_order_of_matches_changes_nothing() -> None:
    scene = make_scene(31, count=300, noise_px=3.0, outliers=0.8)
    camera, xy, points = scene.problem
    first = solve_pose(*scene.problem, **SETTINGS)
    for seed in range(6):
        order = np.random.default_rng(seed).permutation(len(xy))
        again = solve_pose(camera, xy[order], points[order], **SETTINGS)
        np.testing.assert_array_equal(again.centre, first.centre)
        np.testing.assert_array_equal(again.rotation, first.rotation)
        np.testing.assert_array_equal(again.inliers, first.inliers[order])


def test_matches_that_stand_twice_count_once() -> None:
    scene = make_scene(32, count=200, noise_px=3.0, outliers=0.6)
    camera, xy, points = scene.problem
    first = solve_pose(*scene.problem, **SETTINGS)
    copies = np.concatenate([np.arange(200), np.full(500, 7), np.arange(50)])
    again = solve_pose(camera, xy[copies], points[copies], **SETTINGS)
    np.testing.assert_array_equal(again.centre, first.centre)
    np.testing.assert_array_equal(again.inliers, first.inliers[copies])


def test_beyond_the_limit_a_choice_is_solved() -> None:
    scene = make_scene(33, count=3000, noise_px=1.0, outliers=0.3)
    camera, xy, points = scene.problem
    limited = SETTINGS | {"max_matches": 1000}
    first = solve_pose(*scene.problem, **limited)
    assert first.left_out == 2000
    assert first.inliers.sum() <= 1000
    assert errors(first, scene)[0] < 1.0
    order = np.random.default_rng(0).permutation(3000)
    again = solve_pose(camera, xy[order], points[order], **limited)
    np.testing.assert_array_equal(again.centre, first.centre)
    np.testing.assert_array_equal(again.inliers, first.inliers[order])
    other = solve_pose(*scene.problem, **limited | {"seed": 1})
    assert (other.inliers != first.inliers).any()
    assert solve_pose(*scene.problem, **SETTINGS).left_out == 0


@pytest.mark.parametrize(
    ("count", "trials"), [(4_000, 100_000), (5_000, 100_000), (10_000, 50_000), (20_000, 25_000)]
)
def test_trials_are_bounded_by_the_matches(
    count: int, trials: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def find(camera: Any, xy: Any, points: Any, settings: PoseSettings) -> None:
        asked.append((len(xy), settings["min_trials"], settings["max_trials"]))

    monkeypatch.setitem(solving._SOLVERS, "colmap", find)
    scene = make_scene(34, count=count, outliers=1.0)
    assert solve_pose(*scene.problem, **SETTINGS).status is Status.NO_POSE
    tight = SETTINGS | {"max_trials_times_matches": 500 * count}
    solve_pose(*scene.problem, **tight)
    assert asked == [(count, 1000, trials), (count, 500, 500)]
