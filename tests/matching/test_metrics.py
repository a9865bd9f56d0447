"""Errors of poses, the scores of each query and the columns of both, by hand and by other code."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.spatial.transform import Rotation

from airzoo_bench.matching import metrics
from airzoo_bench.matching.metrics import PoseErrors, matching_scores, pose_columns
from airzoo_bench.matching.protocol import MatchingScores
from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from tests.geometry.support import quick, seeds

INF, NAN = math.inf, math.nan

# Six queries; the fourth and the sixth have failed: dx, dy, dz, turn; in 3D, horizontal, vertical.
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


def table_poses() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
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


def test_errors_by_hand() -> None:
    rotation, centres, true_rotation, true_centres = table_poses()
    found = metrics.pose_errors(rotation, centres, true_rotation, true_centres)
    lengths = np.transpose((found.translation_m, found.horizontal_m, found.vertical_m))
    np.testing.assert_allclose(lengths, [row[4:] for row in TABLE], atol=1e-8)
    np.testing.assert_allclose(found.rotation_deg, R, atol=1e-9)
    of_places = metrics.pose_errors(rotation, centres, None, true_centres)
    assert of_places.rotation_deg is None
    assert of_places.translation_m.tolist() == found.translation_m.tolist()


@pytest.mark.parametrize("value", [NAN, INF, -INF])
@pytest.mark.parametrize("part", [0, 1])
def test_one_bad_entry_is_a_failure_of_the_query(part: int, value: float) -> None:
    arrays = [array[:2] for array in table_poses()]
    arrays[part][1].flat[2] = value
    found = metrics.pose_errors(*arrays)
    rows = np.array([found.translation_m, found.horizontal_m, found.vertical_m, found.rotation_deg])
    assert (rows[:, 1] == INF).all()
    assert (rows[:, 0] < 6.0).all()


def test_huge_errors_are_infinite_not_nan() -> None:
    truth, far = np.eye(3)[None], np.full((1, 3), 1.7e308)
    found = metrics.pose_errors(truth, far, truth, -far)
    assert found.translation_m.tolist() == [INF]
    assert found.rotation_deg is not None
    assert found.rotation_deg.tolist() == [0.0]


@quick
@given(seeds, st.floats(-12.0, 0.0))
def test_rotation_error_is_scipys(seed: int, magnitude: float) -> None:
    rng = np.random.default_rng(seed)
    truth = Rotation.random(20, random_state=rng)
    turn = Rotation.from_rotvec(rng.normal(size=(20, 3)) * 10.0**magnitude)
    centres = np.zeros((20, 3))
    turned = (turn * truth).as_matrix()
    found = metrics.pose_errors(turned, centres, truth.as_matrix(), centres).rotation_deg
    np.testing.assert_allclose(found, np.degrees(turn.magnitude()), rtol=1e-9, atol=1e-13)


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
        (5.0, None, [0, 1, 0, 0, 0, 0]),
        (7.5, None, [1, 1, 0, 0, 1, 0]),
    ],
)
def test_recall(limit_m: float, limit_deg: float | None, expected: list[int]) -> None:
    limits = (R, limit_m, limit_deg) if limit_deg else (None, limit_m)
    found = metrics.within(T, *limits)  # type: ignore[arg-type]
    assert found.dtype == np.float64
    assert found.tolist() == expected


@pytest.mark.parametrize(
    ("limit", "shares"),
    [(10.0, [0.5, 1, 0, 0, 0.3, 0]), (5.0, [0, 1, 0, 0, 0, 0]), (20.0, [0.75, 1, 0.5, 0, 0.65, 0])],
)
def test_auc_by_hand(limit: float, shares: list[float]) -> None:
    np.testing.assert_allclose(metrics.area_share(T, limit), shares, rtol=1e-15)


@given(errors, st.floats(0.5, 40.0))
def test_auc_is_the_area_under_recall(values: np.ndarray, limit: float) -> None:
    below = np.sort(values[values < limit])
    recall = np.arange(len(below) + 1) / len(values)
    edges = np.concatenate(([0.0], below, [limit]))
    found = metrics.area_share(values, limit).mean()
    assert found == pytest.approx(float(np.diff(edges) @ recall) / limit, abs=1e-12)
    # SuperGlue's curve is at most half a step above.
    theirs = float(np.trapezoid(np.append(recall, recall[-1]), edges)) / limit
    assert -1e-12 <= theirs - found <= 0.5 / len(values) + 1e-12


# --- columns ------------------------------------------------------------------------------------

# Four queries; the last has failed. The third is as far off as its limits, which are strict.
METRES = np.array([0.5, 2.0, 3.0, INF])
ERRORS = PoseErrors(METRES, METRES / 2, METRES / 4, np.array([1.0, 4.0, 2.0, INF]))
# By column: its values, then the score's title, unit, and whether it is in the foreground.
COLUMNS: dict[str, tuple[list[float], str, str, bool]] = {
    "error_m": ([0.5, 2.0, 3.0, INF], "Median", "m", True),
    "within_1m": ([1.0, 0.0, 0.0, 0.0], "@1m", "share", True),
    "within_3m": ([1.0, 1.0, 0.0, 0.0], "@3m", "share", True),
    "within_3m_3deg": ([1.0, 0.0, 0.0, 0.0], "@3m,3°", "share", True),
    "horizontal_m": ([0.25, 1.0, 1.5, INF], "Horizontal", "m", False),
    "vertical_m": ([0.125, 0.5, 0.75, INF], "Vertical", "m", False),
    "rotation_deg": ([1.0, 4.0, 2.0, INF], "Rotation", "deg", False),
    "auc_4m": ([0.875, 0.5, 0.25, 0.0], "AUC@4m", "share", False),
}


def settings(**changes: Any) -> MatchingScores:
    shipped: Any = load_protocol(shipped_protocols()["airzoo-demo-matching"])
    given = {
        "translation_below_m": (1.0, 3.0),
        "pose_below_m_deg": ((3.0, 3.0),),
        "auc_up_to_m": (4.0,),
        "failed_rotation_deg": "infinite",
        "orientation_is_trusted": True,
    }
    return shipped.scores.model_copy(update=given | changes)


def test_columns_and_scores_by_hand() -> None:
    found = pose_columns(ERRORS, settings())
    assert {k: v.tolist() for k, v in found.items()} == {k: v[0] for k, v in COLUMNS.items()}
    scores = matching_scores(settings())
    assert [one.key for one in scores] == [*COLUMNS]
    for one in scores:
        assert (one.title, one.unit, one.headline) == COLUMNS[one.key][1:]
        assert one.higher_is_better == (one.unit == "share")
        assert one.average == ("mean" if one.unit == "share" else "median")


def test_variants_of_the_columns() -> None:
    found = pose_columns(ERRORS, settings(failed_rotation_deg=180.0))
    assert found["rotation_deg"].tolist() == [1.0, 4.0, 2.0, 180.0]
    # Without a trusted orientation only positions count.
    places = settings(orientation_is_trusted=False)
    found = pose_columns(PoseErrors(METRES, METRES, METRES, None), places)
    assert not {name for name in found if "deg" in name}
    assert {score.key for score in matching_scores(places)} == set(found)
