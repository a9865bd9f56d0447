from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from scipy.spatial.transform import Rotation

from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction import pose_metrics
from airzoo_bench.reconstruction.alignment.similarity import Similarity
from airzoo_bench.reconstruction.pose_metrics import (
    PairErrors,
    auc_of_depth_anything_3,
    centre_errors,
    pair_errors,
    pose_auc,
    rms_of_placed,
    step_errors,
)
from tests.geometry.support import quick, seeds


def poses(rng: np.random.Generator, count: int) -> Poses:
    rotation = Rotation.random(count, random_state=rng).as_matrix()
    return Poses(rotation=rotation, centres=rng.normal(size=(count, 3)) * 50)


def shaken(truth: Poses, rng: np.random.Generator, degrees: float, metres: float) -> Poses:
    count = len(truth)
    turn = Rotation.from_rotvec(rng.normal(0, degrees, (count, 3)), degrees=True).as_matrix()
    centres = truth.centres + rng.normal(0, metres, (count, 3))
    return Poses(rotation=turn @ truth.rotation, centres=centres)


def turned(axis: str, degrees: float) -> np.ndarray:
    return Rotation.from_euler(axis, degrees, degrees=True).as_matrix()


def errors(predicted: Poses, truth: Poses) -> PairErrors:
    return pair_errors(predicted, truth, least_baseline=1e-3)


def test_three_cameras_by_hand() -> None:
    centres = np.array(((0.0, 0, 0), (10, 0, 0), (0, 10, 0)))
    truth = Poses(rotation=np.tile(np.eye(3), (3, 1, 1)), centres=centres)
    # Camera 0 is turned about z by 10 degrees; camera 2 stands 45 degrees off, as seen from 0.
    predicted = Poses(
        rotation=np.stack((turned("z", 10), np.eye(3), np.eye(3))),
        centres=np.array(((0.0, 0, 0), (10, 0, 0), (10, 10, 0))),
    )
    found = errors(predicted, truth)
    pairs = ["01", "02", "10", "12", "20", "21"]
    rotation = dict(zip(pairs, found.rotation_deg, strict=True))
    direction = dict(zip(pairs, found.direction_deg, strict=True))
    assert rotation == pytest.approx({"01": 10, "02": 10, "10": 10, "12": 0, "20": 10, "21": 0})
    # 0 looks 10 degrees past 1. 2 is seen at 45 instead of 90 degrees, turned by 10: 55 or 35.
    expected = {"01": 10, "02": 35, "10": 0, "12": 45, "20": 45, "21": 45}
    assert direction == pytest.approx(expected)
    assert found.worse_deg.tolist() == pytest.approx([10, 35, 10, 45, 45, 45])


def test_auc_by_hand() -> None:
    found = PairErrors(np.array((0.0, 3.0, 1.0, 9.0)), np.array((0.0, 1.0, 4.0, np.inf)))
    # Shares of 5 degrees beyond 0, 3, 4 and infinity.
    assert pose_auc(found, 5.0) == pytest.approx((1 + 0.4 + 0.2 + 0) / 4)
    with pytest.raises(ValueError, match="limit is 0"):
        pose_auc(found, 0.0)


@quick
@given(seeds)
def test_neither_the_frame_nor_the_order_matters(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = poses(rng, 7)
    predicted = shaken(truth, rng, 4.0, 3.0)
    usual = np.sort(errors(predicted, truth).worse_deg)
    rotation = Rotation.random(random_state=rng).as_matrix()
    world = Similarity(0.01, rotation, rng.normal(size=3) * 1e3)
    elsewhere = errors(world.apply_poses(predicted), truth)
    np.testing.assert_allclose(np.sort(elsewhere.worse_deg), usual, atol=1e-8)
    order = rng.permutation(7)
    mixed = errors(predicted.take(order), truth.take(order))
    np.testing.assert_allclose(np.sort(mixed.worse_deg), usual, atol=1e-8)
    assert errors(world.apply_poses(truth), truth).worse_deg.max() < 1e-8


def test_blocks_do_not_change_a_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    truth = poses(rng, 23)
    predicted = shaken(truth, rng, 4.0, 3.0)
    whole = errors(predicted, truth)
    monkeypatch.setattr(pose_metrics, "_BLOCK_PAIRS", 70)
    parts = errors(predicted, truth)
    assert len(whole.rotation_deg) == 23 * 22
    assert whole.rotation_deg.tobytes() == parts.rotation_deg.tobytes()
    assert whole.direction_deg.tobytes() == parts.direction_deg.tobytes()


def test_a_missing_camera_fails_all_its_pairs() -> None:
    rng = np.random.default_rng(1)
    truth = poses(rng, 5)
    centres, rotation = truth.centres.copy(), truth.rotation.copy()
    centres[1] = np.nan
    rotation[3] = np.nan
    found = errors(Poses(rotation=rotation, centres=centres), truth)
    # 3 cameras are left, 6 of 20 pairs.
    assert np.isinf(found.worse_deg).sum() == 14
    assert pose_auc(found, 3.0) == pytest.approx(6 / 20)
    gone = Poses(rotation=np.full((5, 3, 3), np.nan), centres=np.full((5, 3), np.nan))
    assert pose_auc(errors(gone, truth), 30.0) == 0.0


def test_pairs_without_baseline() -> None:
    truth = Poses(rotation=np.tile(np.eye(3), (3, 1, 1)), centres=np.eye(3) * (0, 0, 5.0))
    # Cameras 0 and 1 share a place, 2 is elsewhere; the prediction moves 1, or has no motion.
    moved = Poses(rotation=truth.rotation, centres=truth.centres + np.eye(3)[1][:, None] * 9)
    assert errors(moved, truth).direction_deg[0] == 0.0
    still = Poses(rotation=truth.rotation, centres=np.full((3, 3), 0.1))
    found = errors(still, truth)
    assert np.isinf(found.direction_deg).tolist() == [False, True, False, True, True, True]
    assert found.rotation_deg.max() == 0.0


def test_the_wrong_side_is_wrong() -> None:
    truth = Poses(rotation=np.tile(np.eye(3), (2, 1, 1)), centres=np.eye(3)[:2])
    mirrored = Poses(rotation=truth.rotation, centres=-truth.centres)
    np.testing.assert_allclose(errors(mirrored, truth).direction_deg, 180.0)


def test_small_angles_keep_their_digits() -> None:
    rng = np.random.default_rng(2)
    truth = poses(rng, 2)
    tiny = Rotation.from_rotvec((1e-9, 0, 0), degrees=True).as_matrix()
    rotation = np.stack((truth.rotation[0], tiny @ truth.rotation[1]))
    found = errors(Poses(rotation=rotation, centres=truth.centres), truth)
    np.testing.assert_allclose(found.rotation_deg, 1e-9, rtol=1e-3)


def test_absolute_and_step_errors_by_hand() -> None:
    centres = np.arange(4.0)[:, None] * (10.0, 0.0, 0.0)
    truth = Poses(rotation=np.tile(np.eye(3), (4, 1, 1)), centres=centres)
    rotation = truth.rotation.copy()
    rotation[2] = turned("x", 30)
    off = centres + np.array(((0, 3, 0), (0, 0, 4), (0, 0, 4), (np.nan, 0, 0)))
    predicted = Poses(rotation=rotation, centres=off)
    np.testing.assert_array_equal(centre_errors(predicted, truth), (3.0, 4.0, 4.0, np.inf))
    assert rms_of_placed(centre_errors(predicted, truth)) == pytest.approx((41 / 3) ** 0.5)
    found = step_errors(predicted, truth)
    np.testing.assert_allclose(found.translation, (5.0, 0.0, np.inf), atol=1e-12)
    np.testing.assert_allclose(found.rotation_deg, (0.0, 30.0, np.inf), atol=1e-12)
    assert rms_of_placed(np.full(3, np.inf)) == np.inf


def test_refusals() -> None:
    truth = poses(np.random.default_rng(3), 3)
    with pytest.raises(ValueError, match="2 predicted cameras, 3 true ones"):
        errors(truth.take([0, 1]), truth)
    with pytest.raises(ValueError, match="true poses hold NaN"):
        errors(truth, Poses(rotation=truth.rotation, centres=truth.centres * np.nan))


def test_the_area_of_depth_anything_3_by_hand() -> None:
    centres = np.array(((0.0, 0, 0), (10, 0, 0), (0, 10, 0)))
    truth = Poses(rotation=np.tile(np.eye(3), (3, 1, 1)), centres=centres)
    # The last camera is turned by 4.5 degrees: two of three pairs are right from 5 degrees on.
    rotation = np.stack((np.eye(3), np.eye(3), turned("z", 4.5)))
    predicted = Poses(rotation=rotation, centres=centres)
    found = auc_of_depth_anything_3(predicted, truth, [3, 10])
    assert found[0] == pytest.approx(1 / 3)
    assert found[1] == pytest.approx((4 * 1 + 6 * 3) / 3 / 10)
    # One camera less: one pair is left, and the others have failed.
    lost = centres.copy()
    lost[2] = np.nan
    found = auc_of_depth_anything_3(Poses(rotation=rotation, centres=lost), truth, [10])
    assert found == pytest.approx([1 / 3])
    lost[1] = np.nan
    found = auc_of_depth_anything_3(Poses(rotation=rotation, centres=lost), truth, [10])
    assert found == [0.0]
