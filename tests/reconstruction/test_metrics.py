"""Scores of clouds from distances, and of camera poses, by hand and by their properties."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.metrics import (
    auc_of_depth_anything_3,
    centre_errors,
    counts_below,
    curve,
    exact_mean,
    mean_distances,
    pair_errors,
    pose_auc,
    rms_of_placed,
    step_errors,
)
from tests.geometry.support import quick, seeds
from tests.reconstruction.world import poses, shaken, similarity

INF = math.inf
SAME = np.tile(np.eye(3), (4, 1, 1))
CORNER = np.array(((0.0, 0, 0), (10, 0, 0), (0, 10, 0)))

distances = hnp.arrays(
    np.float64,
    st.integers(1, 60),
    elements=st.one_of(
        st.sampled_from((0.0, 0.1, 1.0, 10.0, 1e16, INF)), st.floats(0.0, 1e12, allow_nan=False)
    ),
)


def scored(there: Any, back: Any, most: float | None = None) -> list[object]:
    """Return Chamfer, accuracy, completeness, medians; precision, recall, F1 below 1 and 10."""
    both = np.array(there, np.float64), np.array(back, np.float64)
    shares = curve(*both, np.array((1.0, 10.0)))
    below = (shares.precision, shares.recall, shares.f1)
    return [*mean_distances(*both, most).values(), *(one.tolist() for one in below)]


BY_HAND: dict[str, tuple[list[float], list[float], float | None, list[object]]] = {
    "10 is not below 10": (
        *([0.0, 2.0, 9.0, 10.0], [0.5, 20.0], None),
        [7.75, 5.25, 10.25, 5.5, 10.25, [0.25, 0.75], [0.5, 0.5], [0.25 / 0.75, 0.6]],
    ),
    "perfect": ([0.0], [0.0, 0.0], None, [0.0] * 5 + [[1.0, 1.0]] * 3),
    "nothing near": ([50.0], [50.0, 50.0], None, [50.0] * 5 + [[0.0, 0.0]] * 3),
    "nothing predicted": ([], [INF, INF], 20.0, [INF] * 5 + [[0.0, 0.0]] * 3),
    "clipping changes means only": (
        *([1.0, 50.0], [3.0, 30.0], 20.0),
        [11.0, 10.5, 11.5, 25.5, 16.5, [0.0, 0.5], [0.0, 0.5], [0.0, 0.5]],
    ),
}


@pytest.mark.parametrize("case", BY_HAND)
def test_scores_by_hand(case: str) -> None:
    there, back, most, expected = BY_HAND[case]
    assert scored(there, back, most) == expected


@given(distances, distances, seeds)
@quick
def test_no_bit_depends_on_order_and_a_sorted_list_agrees(found, other, seed) -> None:
    random, scores = np.random.default_rng(seed), scored(found, other)
    assert scored(random.permutation(found), random.permutation(other)) == scores
    ordered, count = sorted(found.tolist()), len(found)
    median = (ordered[(count - 1) // 2] + ordered[count // 2]) / 2
    assert [scores[1], scores[3]] == [math.fsum(ordered) / count, median]
    thresholds = np.array((0.1, 1.0, 1.5, 10.0, 1e16))
    assert counts_below(found, thresholds).tolist() == (found[:, None] < thresholds).sum(0).tolist()


def test_sums_beyond_single_precision() -> None:
    # A float32 sum of ones stays at 16,777,216.
    assert counts_below(np.zeros(16_777_220), np.array([1.0])).tolist() == [16_777_220]
    assert exact_mean(np.array([1e16, 1.0, 1.0, 0.0])) == (1e16 + 2) / 4


# --- camera poses ---


def level(centres: Any, rotation: Floats = SAME) -> Poses:
    """Return cameras of one orientation, unless rotations are given."""
    return Poses(rotation=rotation[: len(centres)], centres=np.asarray(centres, np.float64))


def without(given: Poses, *rows: int) -> Poses:
    """Return poses without the centres of some."""
    centres = given.centres.copy()
    centres[[*rows]] = np.nan
    return Poses(rotation=given.rotation, centres=centres)


def turned(axis: str, degrees: float) -> Floats:
    return np.asarray(Rotation.from_euler(axis, degrees, degrees=True).as_matrix())


def errors(predicted: Poses, truth: Poses, least_baseline: float = 1e-3) -> Floats:
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


@quick
@given(seeds)
def test_neither_the_frame_nor_the_order_nor_the_scale_matters(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = poses(rng, 7)
    predicted, order = shaken(truth, rng, 4.0, 3.0), rng.permutation(7)
    usual = np.sort(errors(predicted, truth).max(axis=0))
    world = similarity(rng, 0.01)
    for one, other in (
        (world.apply_poses(predicted), truth),
        (predicted.take(order), truth.take(order)),
        (Poses(rotation=predicted.rotation, centres=predicted.centres * 2.0**-60), truth),
    ):
        np.testing.assert_allclose(np.sort(errors(one, other).max(axis=0)), usual, atol=1e-5)
    mirrored = Poses(rotation=truth.rotation, centres=-truth.centres)
    np.testing.assert_allclose(errors(mirrored, truth)[1], 180.0)


def test_a_missing_camera_fails_all_its_pairs() -> None:
    truth = poses(np.random.default_rng(1), 5)
    rotation = truth.rotation.copy()
    rotation[3] = np.nan
    predicted = Poses(rotation=rotation, centres=without(truth, 1).centres)
    assert np.isinf(step_errors(predicted, truth)).all()  # each step begins or ends at 1 or 3
    found = errors(predicted, truth)
    # 3 cameras are left, 6 of 20 pairs.
    assert np.isinf(found.max(axis=0)).sum() == 14
    assert pose_auc(*found, 3.0) == pytest.approx(6 / 20)
    assert pose_auc(*errors(without(truth, 0, 1, 2, 3, 4), truth), 30.0) == 0.0


def test_pairs_without_baseline() -> None:
    truth = level(np.eye(3) * (0, 0, 5.0))
    # Cameras 0 and 1 share a place, 2 is elsewhere; the prediction moves 1, or has no motion.
    assert errors(level(truth.centres + np.eye(3)[1][:, None] * 9), truth)[1, 0] == 0.0
    # No motion: at one point, or up to the rounding far from it.
    for place in (0.1, 1e6 + 1e-9 * np.arange(9.0).reshape(3, 3)):
        still = level(np.zeros((3, 3)) + place)
        rotation, direction = errors(still, truth)
        assert np.isinf(direction).tolist() == [False, True, False, True, True, True]
        assert rotation.max() == 0.0
    # At most so far apart: 5 is not above 5.
    assert errors(still, truth, least_baseline=5.0)[1].max() == 0.0


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


# --- the rule of Depth Anything 3 ---


TURNED = level(CORNER, np.stack((np.eye(3), np.eye(3), turned("z", 4.5))))
FOUR = level(((0.0, 0, 0), (10, 0, 0), (0, 20, 0), (0, 20, 0)))
MOVED = level(((0.0, 0, 0), (10, 0, 0), (0, 20, 0), (0, 25, 0)))
# Predicted and true poses; the area below some whole degrees.
OF_DEPTH_ANYTHING_3: dict[str, tuple[Poses, Poses, dict[int, float]]] = {
    # Two of three pairs are right from 5 degrees on.
    "one turned by 4.5": (TURNED, level(CORNER), {3: 1 / 3, 10: (4 * 1 + 6 * 3) / 3 / 10}),
    "one pair left": (without(TURNED, 2), level(CORNER), {10: 1 / 3}),
    "no pair left": (without(TURNED, 1, 2), level(CORNER), {10: 0.0}),
    # Of 6 pairs, 1 has cameras that share a place: 90 degrees off, even without an error. The last
    # bin of a histogram has both its borders: 90 degrees are right below 91, and at 90.
    "exact": (FOUR, FOUR, {3: 5 / 6, 90: (5 * 90 + 1) / 90 / 6}),
    # 13 is seen 4.76 degrees off; 23 is 90 off, whatever the prediction has.
    "one camera moved": (MOVED, FOUR, {3: 4 / 6, 90: (4 * 90 + 86 + 1) / 90 / 6}),
    "opposite directions are one": (level(-FOUR.centres), FOUR, {3: 5 / 6}),
    # 02 and 03 are right; 12 and 13 are seen at 26.6 degrees from where they are; 01 and 23 are at
    # 90 degrees, which is below 91 alone.
    "no baseline of 0 and 1": (
        level(FOUR.centres * (0, 1, 0)),
        FOUR,
        {89: (2 * 89 + 2 * 63) / 89 / 6, 91: (2 * 91 + 2 * 65 + 2 * 1) / 91 / 6},
    ),
}


@pytest.mark.parametrize("case", OF_DEPTH_ANYTHING_3)
def test_the_area_of_depth_anything_3_by_hand(case: str) -> None:
    predicted, truth, areas = OF_DEPTH_ANYTHING_3[case]
    found = auc_of_depth_anything_3(predicted, truth, [*areas])
    assert found == pytest.approx([*areas.values()])


def test_the_first_camera_that_is_there_is_the_frame_of_depth_anything_3() -> None:
    rng = np.random.default_rng(4)
    truth = poses(rng, 6)
    predicted, limits = shaken(truth, rng, 4.0, 3.0), [5, 15, 30]
    rest = auc_of_depth_anything_3(predicted.take(range(1, 6)), truth.take(range(1, 6)), limits)
    # 10 of 15 pairs are left, and score as if the lost camera had never been there.
    found = auc_of_depth_anything_3(without(predicted, 0), truth, limits)
    assert found == pytest.approx([area * 10 / 15 for area in rest])
