"""The columns of a query's record and their titles, by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from airzoo_bench.matching.metrics import PoseErrors, matching_scores, pose_columns
from airzoo_bench.matching.settings import MatchingScores
from airzoo_bench.protocol.model import load_protocol, shipped_protocols

INF = math.inf
# Four queries; the last has failed. The third is as far off as its limits, which are strict.
METRES = np.array([0.5, 2.0, 3.0, INF])
ERRORS = PoseErrors(METRES, METRES / 2, METRES / 4, np.array([1.0, 4.0, 2.0, INF]))


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


def test_columns_by_hand() -> None:
    expected = {
        "error_m": [0.5, 2.0, 3.0, INF],
        "horizontal_m": [0.25, 1.0, 1.5, INF],
        "vertical_m": [0.125, 0.5, 0.75, INF],
        "rotation_deg": [1.0, 4.0, 2.0, INF],
        "within_1m": [1.0, 0.0, 0.0, 0.0],
        "within_3m": [1.0, 1.0, 0.0, 0.0],
        "within_3m_3deg": [1.0, 0.0, 0.0, 0.0],
        "auc_4m": [0.875, 0.5, 0.25, 0.0],
    }
    found = pose_columns(ERRORS, settings())
    assert {name: values.tolist() for name, values in found.items()} == expected


def test_a_failure_may_have_a_stated_rotation() -> None:
    found = pose_columns(ERRORS, settings(failed_rotation_deg=180.0))
    assert found["rotation_deg"].tolist() == [1.0, 4.0, 2.0, 180.0]


def test_without_a_trusted_orientation_only_positions_count() -> None:
    errors = PoseErrors(METRES, METRES, METRES, None)
    found = pose_columns(errors, settings(orientation_is_trusted=False))
    assert not {name for name in found if "deg" in name}
    listed = matching_scores(settings(orientation_is_trusted=False))
    assert {score.column for score in listed} == set(found)


@pytest.mark.parametrize(
    ("column", "title", "unit", "higher", "average", "headline"),
    [
        ("error_m", "Median", "m", False, "median", True),
        ("within_1m", "@1m", "", True, "mean", True),
        ("within_3m_3deg", "@3m,3°", "", True, "mean", True),
        ("horizontal_m", "Horizontal", "m", False, "median", False),
        ("vertical_m", "Vertical", "m", False, "median", False),
        ("rotation_deg", "Rotation", "deg", False, "median", False),
        ("auc_4m", "AUC@4m", "", True, "mean", False),
    ],
)
def test_each_score_says_what_it_is(
    column: str, title: str, unit: str, higher: bool, average: str, headline: bool
) -> None:
    (score,) = (one for one in matching_scores(settings()) if one.column == column)
    assert (score.title, score.higher_is_better, score.average) == (title, higher, average)
    assert score.headline is headline
    if unit:
        assert score.unit == unit


def test_errors_show_their_medians() -> None:
    shown = repr(ERRORS)
    for part in ("poses", "4", "failures", "1", "median_m", "2.5000", "median_deg", "3.0000"):
        assert part in shown
    alone = repr(PoseErrors(METRES[:0], METRES[:0], METRES[:0], None))
    assert "median" not in alone
