"""Poses from Python: the records of the track, SciPy and evo, edges."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import airzoo_bench as ab
from airzoo_bench.api.arguments import shipped
from airzoo_bench.matching.protocol import MatchingProtocol
from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from tests.matching.world import World, make_world


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return make_world(tmp_path_factory.mktemp("world"))


def track(world: World, folder: Path, fields: dict[str, Any]) -> ab.Result:
    return ab.evaluate(world.write(folder / "method.npz", fields), data=world.root)


def noisy(world: World) -> tuple[np.ndarray, np.ndarray]:
    """Return poses that are metres and degrees off, one missing, and the true ones."""
    true = world.poses()["poses"]
    random = np.random.default_rng(0)
    turn = Rotation.from_rotvec(random.normal(0, 1.0, (len(true), 3)), degrees=True).as_matrix()
    predicted = true.copy()
    predicted[:, :, :3] = turn @ true[:, :, :3]
    centres = world.truth.poses.centres + random.normal(0, 6.0, (len(true), 3))
    predicted[:, :, 3] = -np.einsum("nij,nj->ni", predicted[:, :, :3], centres)
    predicted[1] = np.nan
    return predicted, true


def test_errors_and_scores_are_those_of_the_track(world: World, tmp_path: Path) -> None:
    predicted, true = noisy(world)
    found = track(world, tmp_path, world.named(poses=predicted))
    errors = ab.pose_errors(predicted, true)
    scores = ab.pose_scores(errors, world.protocol.scores.pose_below_m_deg)
    for column in scores.records:
        assert scores.records[column].tolist() == pytest.approx(
            found.records[column].tolist(), rel=1e-9, abs=1e-9
        ), column
    # The truth of a folder is rounded to 0.1 mm; of equal errors the scores are equal.
    again = ab.pose_scores(
        (found.records["error_m"], found.records["rotation_deg"]),
        world.protocol.scores.pose_below_m_deg,
    )
    for one in (again, scores):
        assert (one["queries"], one["failures"]) == (5, 1)
    for name in again.records:
        assert again[name] == found.overall[name], name
    assert 0 < scores["within_10m"] < 1


@pytest.mark.parametrize("order", [1, -1])
def test_solve_pose_gives_the_pose_of_the_track(world: World, tmp_path: Path, order: int) -> None:
    random = np.random.default_rng(1)
    query_xy = [np.clip(xy + random.normal(0, 1, xy.shape), 1, 479) for xy in world.query_xy]
    fields = world.correspondences(query_xy, points3d=world.points)
    rows = track(world, tmp_path, fields).records
    cameras, true = world.truth.cameras, world.truth.poses
    for row, (pixels, points) in enumerate(zip(query_xy, world.points, strict=True)):
        K, lens = cameras.matrices[row], cameras.distortion[row]
        found = ab.solve_pose(pixels[::order], points[::order].tolist(), K, distortion=lens)
        away = np.hypot(*(found.centre - true.centres[row])[:2])
        assert away == rows["horizontal_m"][row]
        assert found.inliers.sum() == rows["inliers"][row] > 10
        errors = ab.pose_errors(found.matrix[None], world.poses()["poses"][row][None])
        assert errors.translation_m[0] == pytest.approx(rows["error_m"][row], abs=1e-8)


def test_the_settings_are_those_of_all_shipped_protocols() -> None:
    """`max_trials` and the like may be changed; all else, and what is not, is the protocols'."""
    rules = [load_protocol(path) for path in shipped_protocols().values()]
    solvers = [one.solver for one in rules if isinstance(one, MatchingProtocol)]
    defaults = {"solver": solvers[0].name, **solvers[0].model_dump(), "distortion": None}
    assert ab.solve_pose.__kwdefaults__.items() <= defaults.items()
    used = [solver.model_copy(update={"least_matches": 4}) for solver in solvers]
    assert used == [shipped("matching", "solver")] * 7


def test_rotation_angles_are_those_of_scipy_and_evo() -> None:
    lie = pytest.importorskip("evo.core.lie_algebra")
    rotations = Rotation.random(6, random_state=3)
    others = Rotation.random(6, random_state=4)
    poses = np.zeros((2, 6, 3, 4))
    poses[0, :, :, :3], poses[1, :, :, :3] = rotations.as_matrix(), others.as_matrix()
    errors = ab.pose_errors(poses[0], poses[1])
    theirs = (rotations * others.inv()).magnitude() * 180 / np.pi
    np.testing.assert_allclose(errors.rotation_deg, theirs, rtol=1e-12)
    of_evo = [
        np.degrees(lie.so3_log_angle(a @ b.T))
        for a, b in zip(poses[0, :, :, :3], poses[1, :, :, :3], strict=True)
    ]
    np.testing.assert_allclose(errors.rotation_deg, of_evo, rtol=1e-9)


def test_failures_stay_and_a_truth_without_orientation_has_no_angles() -> None:
    true = np.tile(np.eye(4), (3, 1, 1))
    predicted = true.copy()
    predicted[:2, :3] = np.nan  # the last row may stay
    errors = ab.pose_errors(predicted, true[:, :3])
    assert errors.translation_m.tolist() == [np.inf, np.inf, 0.0]
    scores = ab.pose_scores(errors)
    assert (scores["error_m"], scores["within_5m_1deg"]) == (np.inf, 1 / 3)
    positions = ab.pose_errors(predicted, np.zeros((3, 3)))
    assert positions.rotation_deg is None
    assert "rotation_deg" not in ab.pose_scores(positions).scores
    assert ab.pose_scores(positions).scores["within_5m"] == 1 / 3
    assert "within_5m_1deg" not in ab.pose_scores(positions).scores
    one = ab.pose_scores(([5.0], [0.0]))
    assert (one["within_5m"], one["within_10m"]) == (0.0, 1.0)  # strictly below
    assert ab.pose_scores(([1.0], [1.0]), [(5, 2), (5, 2)])["within_5m_2deg"] == 1.0
    assert ab.pose_scores(([np.inf], [np.inf]))["auc_20m"] == 0.0
    nothing = ab.pose_errors(np.zeros((0, 3, 4)), np.zeros((0, 3, 4)))
    assert nothing.translation_m.shape == (0,)


@pytest.mark.parametrize(
    ("errors", "median"),
    [
        ([5.0, 0, 10, np.inf, 7, np.inf], 8.5),
        ([1.0, np.inf], np.inf),
        ([1.0, 2, np.inf, np.inf], np.inf),  # one of the two middle ones
        ([1.0, 2, np.inf], 2.0),
        ([np.inf], np.inf),
    ],
)
def test_failures_stay_in_the_median(errors: list[float], median: float) -> None:
    assert ab.pose_scores((errors, None))["error_m"] == median


def test_too_few_matches_are_a_result() -> None:
    K = np.diag([500.0, 500.0, 1.0])
    found = ab.solve_pose(np.zeros((3, 2)), np.zeros((3, 3)), K)
    assert found.status == "too few matches"
    assert np.isnan(found.matrix).all()
    assert ab.solve_pose([], [], K).inliers.tolist() == []
    assert np.isinf(ab.pose_errors(found.matrix[None], np.eye(4)[None]).translation_m).all()
    line = np.arange(30.0)[:, None] * (1.0, 0.0, 0.0) + (0, 0, 9)
    assert ab.solve_pose(line[:, :2], line, K).status == "no pose"
