from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from scipy.spatial.transform import Rotation

from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.alignment import Similarity
from airzoo_bench.reconstruction.metrics import (
    auc_of_depth_anything_3,
    centre_errors,
    pair_errors,
    pose_auc,
    rms_of_placed,
    step_errors,
)
from tests.geometry.support import quick, seeds

Array = np.ndarray[Any, Any]
SAME = np.tile(np.eye(3), (4, 1, 1))
CORNER = np.array(((0.0, 0, 0), (10, 0, 0), (0, 10, 0)))


def poses(rng: np.random.Generator, count: int) -> Poses:
    rotation = Rotation.random(count, random_state=rng).as_matrix()
    return Poses(rotation=rotation, centres=rng.normal(size=(count, 3)) * 50)


def level(centres: Any, rotation: Array = SAME) -> Poses:
    """Return cameras of one orientation, unless rotations are given."""
    return Poses(rotation=rotation[: len(centres)], centres=np.asarray(centres, np.float64))


def shaken(truth: Poses, rng: np.random.Generator, degrees: float, metres: float) -> Poses:
    count = len(truth)
    turn = Rotation.from_rotvec(rng.normal(0, degrees, (count, 3)), degrees=True).as_matrix()
    centres = truth.centres + rng.normal(0, metres, (count, 3))
    return Poses(rotation=turn @ truth.rotation, centres=centres)


def without(given: Poses, *rows: int) -> Poses:
    """Return poses without the centres of some."""
    centres = given.centres.copy()
    centres[[*rows]] = np.nan
    return Poses(rotation=given.rotation, centres=centres)


def turned(axis: str, degrees: float) -> Array:
    matrix: Array = Rotation.from_euler(axis, degrees, degrees=True).as_matrix()
    return matrix


def errors(predicted: Poses, truth: Poses, least_baseline: float = 1e-3) -> Array:
    """Return degrees of rotation, and of direction, by pair."""
    return np.stack(pair_errors(predicted, truth, least_baseline=least_baseline))


def test_three_cameras_by_hand() -> None:
    # Camera 0 is turned about z by 10 degrees; camera 2 is 45 degrees off, as seen from 0.
    rotation = np.stack((turned("z", 10), np.eye(3), np.eye(3)))
    predicted = level(((0.0, 0, 0), (10, 0, 0), (10, 10, 0)), rotation)
    # Pairs 01, 02, 10, 12, 20, 21.
    turns, directions = errors(predicted, level(CORNER))
    assert turns.tolist() == pytest.approx([10, 10, 10, 0, 10, 0])
    # 0 looks 10 degrees past 1. 2 is seen at 45 instead of 90 degrees, turned by 10: 55 or 35.
    assert directions.tolist() == pytest.approx([10, 35, 0, 45, 45, 45])


def test_auc_by_hand() -> None:
    found = np.array(((0.0, 3.0, 1.0, 9.0), (0.0, 1.0, 4.0, np.inf)))
    # Shares of 5 degrees beyond 0, 3, 4 and infinity.
    assert pose_auc(*found, 5.0) == pytest.approx((1 + 0.4 + 0.2 + 0) / 4)
    assert pose_auc(np.zeros(1), np.array([0.1]), 0.5) == pytest.approx(0.8)


@quick
@given(seeds)
def test_neither_the_frame_nor_the_order_matters(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = poses(rng, 7)
    predicted, order = shaken(truth, rng, 4.0, 3.0), rng.permutation(7)
    usual = np.sort(errors(predicted, truth).max(axis=0))
    rotation = Rotation.random(random_state=rng).as_matrix()
    world = Similarity(0.01, rotation, rng.normal(size=3) * 1e3)
    for one, other in (
        (world.apply_poses(predicted), truth),
        (predicted.take(order), truth.take(order)),
    ):
        np.testing.assert_allclose(np.sort(errors(one, other).max(axis=0)), usual, atol=1e-8)
    assert errors(world.apply_poses(truth), truth).max() < 1e-8


def test_a_missing_camera_fails_all_its_pairs() -> None:
    truth = poses(np.random.default_rng(1), 5)
    rotation = truth.rotation.copy()
    rotation[3] = np.nan
    found = errors(Poses(rotation=rotation, centres=without(truth, 1).centres), truth)
    # 3 cameras are left, 6 of 20 pairs.
    assert np.isinf(found.max(axis=0)).sum() == 14
    assert pose_auc(*found, 3.0) == pytest.approx(6 / 20)
    assert pose_auc(*errors(without(truth, 0, 1, 2, 3, 4), truth), 30.0) == 0.0


def test_pairs_without_baseline() -> None:
    truth = level(np.eye(3) * (0, 0, 5.0))
    # Cameras 0 and 1 share a place, 2 is elsewhere; the prediction moves 1, or has no motion.
    assert errors(level(truth.centres + np.eye(3)[1][:, None] * 9), truth)[1, 0] == 0.0
    # No motion: at one point, all at the origin, or up to the rounding far from it.
    for place in (0.1, 0.0, 1e6 + 1e-9 * np.arange(9.0).reshape(3, 3)):
        still = level(np.zeros((3, 3)) + place)
        rotation, direction = errors(still, truth)
        assert np.isinf(direction).tolist() == [False, True, False, True, True, True]
        assert rotation.max() == 0.0
    # At most so far apart: 5 is not above 5.
    assert errors(still, truth, least_baseline=5.0)[1].max() == 0.0


def test_directions_of_any_scale_and_of_the_wrong_side() -> None:
    rng = np.random.default_rng(6)
    truth = poses(rng, 4)
    predicted = shaken(truth, rng, 4.0, 3.0)
    tiny = Poses(rotation=predicted.rotation, centres=predicted.centres * 2.0**-60)
    np.testing.assert_allclose(errors(tiny, truth), errors(predicted, truth))
    mirrored = Poses(rotation=truth.rotation, centres=-truth.centres)
    np.testing.assert_allclose(errors(mirrored, truth)[1], 180.0)


def test_small_angles_keep_their_digits() -> None:
    truth = poses(np.random.default_rng(2), 2)
    tiny = Rotation.from_rotvec((1e-9, 0, 0), degrees=True).as_matrix()
    rotation = np.stack((truth.rotation[0], tiny @ truth.rotation[1]))
    found = errors(Poses(rotation=rotation, centres=truth.centres), truth)
    np.testing.assert_allclose(found[0], 1e-9, rtol=1e-3)


def test_absolute_and_step_errors_by_hand() -> None:
    truth = level(np.arange(4.0)[:, None] * (10.0, 0.0, 0.0))
    rotation = SAME.copy()
    rotation[2] = turned("x", 30)
    off = truth.centres + np.array(((0, 3, 0), (0, 0, 4), (0, 0, 4), (np.nan, 0, 0)))
    predicted = level(off, rotation)
    np.testing.assert_array_equal(centre_errors(predicted, truth), (3.0, 4.0, 4.0, np.inf))
    assert rms_of_placed(centre_errors(predicted, truth)) == pytest.approx((41 / 3) ** 0.5)
    translation, rotation_deg = step_errors(predicted, truth)
    np.testing.assert_allclose(translation, (5.0, 0.0, np.inf), atol=1e-12)
    np.testing.assert_allclose(rotation_deg, (0.0, 30.0, np.inf), atol=1e-12)
    assert rms_of_placed(np.full(3, np.inf)) == np.inf


def test_steps_between_cameras_that_turn() -> None:
    rng = np.random.default_rng(5)
    truth = poses(rng, 4)
    predicted = shaken(truth, rng, 20.0, 5.0)
    translation, rotation_deg = step_errors(predicted, truth)
    for step in range(3):
        # E_i^-1 E_j of camera-to-world matrices, and the rest once the one of the truth is undone.
        one, true = (
            np.linalg.inv(to_world(chosen, step)) @ to_world(chosen, step + 1)
            for chosen in (predicted, truth)
        )
        left = np.linalg.inv(true) @ one
        assert translation[step] == pytest.approx(np.linalg.norm(left[:3, 3]))
        angle = np.degrees(Rotation.from_matrix(left[:3, :3]).magnitude())
        assert rotation_deg[step] == pytest.approx(angle)
    lost, lost_deg = step_errors(without(predicted, 1), truth)
    assert lost.tolist() == [np.inf, np.inf, translation[2]]
    assert lost_deg.tolist() == [np.inf, np.inf, rotation_deg[2]]


def to_world(chosen: Poses, row: int) -> Array:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = chosen.rotation[row].T, chosen.centres[row]
    return matrix


# --- the rule of Depth Anything 3 ---


def test_the_area_of_depth_anything_3_by_hand() -> None:
    truth = level(CORNER)
    # The last camera is turned by 4.5 degrees: two of three pairs are right from 5 degrees on.
    predicted = level(CORNER, np.stack((np.eye(3), np.eye(3), turned("z", 4.5))))
    found = auc_of_depth_anything_3(predicted, truth, [3, 10])
    assert found == pytest.approx([1 / 3, (4 * 1 + 6 * 3) / 3 / 10])
    # One camera less: one pair is left, and the others have failed; and then none.
    found = auc_of_depth_anything_3(without(predicted, 2), truth, [10])
    assert found == pytest.approx([1 / 3])
    assert auc_of_depth_anything_3(without(predicted, 1, 2), truth, [10]) == [0.0]


def test_depth_anything_3_folds_directions_and_counts_whole_degrees() -> None:
    centres = np.array(((0.0, 0, 0), (10, 0, 0), (0, 20, 0), (0, 20, 0)))
    truth = level(centres)
    # Of 6 pairs, 1 has cameras that share a place: 90 degrees off, even without an error.
    assert auc_of_depth_anything_3(truth, truth, [3]) == pytest.approx([5 / 6])
    # Even where the claim says that they are apart; 1 sees camera 3 too far up by 8 degrees.
    apart = level(centres + np.eye(4)[3][:, None] * (0, 10, 0))
    assert auc_of_depth_anything_3(apart, truth, [3]) == pytest.approx([4 / 6])
    # So has a claim without a baseline: of 0 and 1, and of 0 and 2, and so of 0 and 3.
    found = auc_of_depth_anything_3(level(centres * (0, 1, 0)), truth, [89, 91])
    # Right are 02 and 03; 12 and 13 are seen at 26.6 degrees from where they are; 01 and 23 are at
    # 90 degrees, which is below 91 alone.
    assert found == pytest.approx([(2 * 89 + 2 * 63) / 89 / 6, (2 * 91 + 2 * 65 + 2 * 1) / 91 / 6])
    # Opposite directions are one.
    assert auc_of_depth_anything_3(level(-centres), truth, [3]) == pytest.approx([5 / 6])
    # The last bin of a histogram has both its borders: 90 degrees are right below 91, and at 90.
    assert auc_of_depth_anything_3(truth, truth, [90]) == pytest.approx([(5 * 90 + 1) / 90 / 6])


def test_the_first_camera_that_is_there_is_the_frame_of_depth_anything_3() -> None:
    rng = np.random.default_rng(4)
    truth = poses(rng, 6)
    predicted, limits = shaken(truth, rng, 4.0, 3.0), [5, 15, 30]
    rest = auc_of_depth_anything_3(predicted.take(range(1, 6)), truth.take(range(1, 6)), limits)
    # 10 of 15 pairs are left, and score as if the lost camera had never been there.
    found = auc_of_depth_anything_3(without(predicted, 0), truth, limits)
    assert found == pytest.approx([area * 10 / 15 for area in rest])
