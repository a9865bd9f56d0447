from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

from airzoo_bench.geometry.poses import matrix_to_quaternion, quaternion_to_matrix
from airzoo_bench.matching import metrics
from tests.geometry.support import quick, seeds

INF, NAN = math.inf, math.nan

# Six queries; the fourth and the sixth have failed.
#            dx    dy   dz  turn    3D   horizontal  vertical
TABLE = [
    (3.0, 0.0, 4.0, 0.5, 5.0, 3.0, 4.0),
    (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    (-6.0, 8.0, 0.0, 2.0, 10.0, 10.0, 0.0),
    (NAN, NAN, NAN, NAN, INF, INF, INF),
    (2.0, 3.0, -6.0, 1.0, 7.0, math.sqrt(13.0), 6.0),
    (NAN, NAN, NAN, NAN, INF, INF, INF),
]
T, R = (np.array([row[column] for row in TABLE]) for column in (4, 3))
R[np.isnan(R)] = INF

errors = hnp.arrays(
    np.float64, st.integers(1, 30), elements=st.one_of(st.just(INF), st.floats(0.0, 30.0))
)


def table_poses():
    rng = np.random.default_rng(0)
    truth = Rotation.random(len(TABLE), random_state=rng)
    axes = rng.normal(size=(len(TABLE), 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    turn = np.radians([row[3] for row in TABLE])
    shift = np.array([row[:3] for row in TABLE])
    turned = Rotation.from_rotvec(axes * np.nan_to_num(turn)[:, None]) * truth
    rotation = np.where(np.isnan(turn)[:, None, None], NAN, turned.as_matrix())
    centres = rng.uniform(0.0, 1e6, (len(TABLE), 3))
    return rotation, centres + shift, truth.as_matrix(), centres


# --- errors of each query -----------------------------------------------------------------------


def test_errors_by_hand():
    found = metrics.pose_errors(*table_poses())
    np.testing.assert_allclose(found.translation_m, T, atol=1e-8)
    np.testing.assert_allclose(found.horizontal_m, [row[5] for row in TABLE], atol=1e-8)
    np.testing.assert_allclose(found.vertical_m, [row[6] for row in TABLE], atol=1e-8)
    np.testing.assert_allclose(found.rotation_deg, R, atol=1e-9)


def test_truth_without_orientation():
    rotation, centres, _, true_centres = table_poses()
    found = metrics.pose_errors(rotation, centres, None, true_centres)
    assert found.rotation_deg is None
    np.testing.assert_allclose(found.translation_m, T, atol=1e-8)
    assert metrics.within(found.translation_m, None, 6.0).mean() == 2 / 6
    with pytest.raises(ValueError, match="no orientation"):
        metrics.within(found.translation_m, None, 5.0, 1.0)


@pytest.mark.parametrize("value", [NAN, INF, -INF])
@pytest.mark.parametrize("where", ["rotation", "centre"])
def test_one_bad_entry_is_a_failure_of_the_query(where, value):
    rotation, centres, true_rotation, true_centres = (array[:2] for array in table_poses())
    (rotation if where == "rotation" else centres)[1].flat[2] = value
    found = metrics.pose_errors(rotation, centres, true_rotation, true_centres)
    for array in (found.translation_m, found.horizontal_m, found.vertical_m, found.rotation_deg):
        assert array[1] == INF
        assert array[0] < 6.0


def test_huge_errors_are_infinite_not_nan():
    truth = np.eye(3)[None]
    found = metrics.pose_errors(truth, np.full((1, 3), 1.7e308), truth, np.full((1, 3), -1.7e308))
    assert found.translation_m.tolist() == [INF]
    assert found.rotation_deg.tolist() == [0.0]


@quick
@given(seeds, st.floats(-12.0, 0.0))
def test_rotation_error_is_scipys(seed, magnitude):
    rng = np.random.default_rng(seed)
    truth = Rotation.random(20, random_state=rng)
    turn = Rotation.from_rotvec(rng.normal(size=(20, 3)) * 10.0**magnitude)
    centres = np.zeros((20, 3))
    found = metrics.pose_errors(
        (turn * truth).as_matrix(), centres, truth.as_matrix(), centres
    ).rotation_deg
    np.testing.assert_allclose(found, np.degrees(turn.magnitude()), rtol=1e-9, atol=1e-13)


def test_wrong_conventions_have_large_errors():
    _, _, truth, centres = table_poses()
    translations = -(truth @ centres[..., None])[..., 0]
    xyzw = quaternion_to_matrix(np.roll(matrix_to_quaternion(truth), -1, axis=1))
    for rotation, given_centres in [
        (np.swapaxes(truth, 1, 2), centres),  # camera-to-world
        (xyzw, centres),
        (truth, translations),  # t for C
    ]:
        found = metrics.pose_errors(rotation, given_centres, truth, centres)
        assert not metrics.within(found.translation_m, found.rotation_deg, 20.0, 2.0).any()


def test_errors_refuse():
    rotation, centres, true_rotation, true_centres = table_poses()
    for bad in [
        (rotation[1:], centres, true_rotation, true_centres),
        (rotation, centres[:, :2], true_rotation, true_centres),
        (rotation, centres, true_rotation[1:], true_centres),
        (rotation, centres, true_rotation, true_centres[:1]),
    ]:
        with pytest.raises(ValueError, match=r"^centres and rotations have shapes"):
            metrics.pose_errors(*bad)
    for truth in [(true_rotation * NAN, true_centres), (None, true_centres + INF)]:
        with pytest.raises(ValueError, match=r"^the true poses hold NaN or infinity$"):
            metrics.pose_errors(rotation, centres, *truth)


# --- scores -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("limit_m", "limit_deg", "expected"),
    [
        (5.0, 1.0, [0, 1, 0, 0, 0, 0]),  # 5 m is not below 5 m
        (10.0, 1.0, [1, 1, 0, 0, 0, 0]),  # 1 degree is not below 1 degree
        (10.0, 1.5, [1, 1, 0, 0, 1, 0]),
        (20.0, 2.5, [1, 1, 1, 0, 1, 0]),
        (20.0, 0.1, [0, 1, 0, 0, 0, 0]),
        (INF, INF, [1, 1, 1, 0, 1, 0]),  # a failure is in no limit
    ],
)
def test_pose_recall(limit_m, limit_deg, expected):
    found = metrics.within(T, R, limit_m, limit_deg)
    assert found.dtype == np.float64
    assert found.tolist() == expected


@pytest.mark.parametrize(
    ("limit_m", "expected"),
    [(5.0, [0, 1, 0, 0, 0, 0]), (7.5, [1, 1, 0, 0, 1, 0]), (INF, [1, 1, 1, 0, 1, 0])],
)
def test_translation_recall(limit_m, expected):
    assert metrics.within(T, None, limit_m).tolist() == expected
    assert metrics.within(T, R, limit_m).tolist() == expected


@pytest.mark.parametrize(
    ("limit", "shares"),
    [(10.0, [0.5, 1, 0, 0, 0.3, 0]), (5.0, [0, 1, 0, 0, 0, 0]), (20.0, [0.75, 1, 0.5, 0, 0.65, 0])],
)
def test_auc_by_hand(limit, shares):
    np.testing.assert_allclose(metrics.area_share(T, limit), shares, rtol=1e-15)


@given(errors, st.floats(0.5, 40.0))
def test_auc_is_the_area_under_recall(values, limit):
    edges = np.unique(np.append(values[values < limit], (0.0, limit)))
    recall = [(values <= edge).mean() for edge in edges[:-1]]
    area = float(np.sum(np.diff(edges) * recall)) / limit
    assert metrics.area_share(values, limit).mean() == pytest.approx(area, abs=1e-12)


@given(errors, st.floats(0.5, 40.0))
def test_auc_is_at_most_half_a_step_below_superglues(values, limit):
    below = np.sort(values[values < limit])
    recall = np.arange(len(below) + 1) / len(values)
    curve = np.append(recall, recall[-1]), np.concatenate(([0.0], below, [limit]))
    theirs = float(np.trapezoid(*curve)) / limit
    excess = theirs - metrics.area_share(values, limit).mean()
    assert -1e-12 <= excess <= 0.5 / len(values) + 1e-12


@given(errors)
def test_scores_are_numbers_whatever_fails(values):
    with_failure = np.append(values, INF)
    assert metrics.within(with_failure, None, 5.0).tolist() == [*(values < 5.0), False]
    assert metrics.area_share(with_failure, 5.0)[-1] == 0.0


@pytest.mark.parametrize("bad", [[1.0, NAN], [-1.0, 2.0], [[1.0]]])
def test_errors_must_be_errors(bad):
    values = np.array(bad)
    for score in (
        lambda: metrics.area_share(values, 5.0),
        lambda: metrics.within(values, None, 5.0),
        lambda: metrics.within(np.zeros(values.shape), values, 5.0, 1.0),
    ):
        with pytest.raises(ValueError, match=r"^errors must be \(Q,\), not NaN and not negative$"):
            score()


def test_errors_must_fit_together():
    with pytest.raises(ValueError, match="shape"):
        metrics.within(T, R[:1], 5.0, 1.0)


@pytest.mark.parametrize("limit", [0.0, -1.0, INF, NAN])
def test_auc_limit_must_be_possible(limit):
    with pytest.raises(ValueError, match="limit"):
        metrics.area_share(T, limit)
