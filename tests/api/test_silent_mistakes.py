"""What could give a wrong number in silence: refused, or exact."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import airzoo_bench as ab
from airzoo_bench.core.errors import ArgumentError

MASKED = np.ma.array([1.0, 0.0], mask=[True, False])
SQUARE = np.eye(3)


@pytest.mark.parametrize(
    ("ranked", "positives", "expected"),
    [
        ([[2**63 + 1], [5]], [[2**63 + 2], [5]], 0.5),
        ([[2**62 + 1], [2**62 + 9], [2**63]], [[2**62 + 2], [2**62 + 10], [2**63]], 1 / 3),
        ([np.array([2**63 + 1], np.uint64), np.array([-1])], [[2**63 + 1], [5]], 0.5),
    ],
)
def test_ids_of_64_bits_are_not_rounded(ranked: Any, positives: Any, expected: float) -> None:
    found = ab.retrieval_scores(ranked, positives, ks=(1,))
    assert found["recall@1"] == pytest.approx(expected)


@pytest.mark.parametrize(
    "call",
    [
        lambda: ab.recall_at_k([MASKED], k=1),
        lambda: ab.descriptor_scores(np.ma.array(SQUARE, mask=SQUARE > 0), SQUARE, [[0], [1], [2]]),
        lambda: ab.descriptor_scores(SQUARE, np.ma.array(SQUARE, mask=SQUARE > 0), [[0], [1], [2]]),
        lambda: ab.cloud_scores([np.ma.array([1.0, 2, 3], mask=[1, 0, 0])], SQUARE, threshold=1.0),
    ],
)
def test_masked_entries_are_refused(call: Any) -> None:
    with pytest.raises(ArgumentError, match="masked entries") as error:
        call()
    assert str(error.value).count("masked entries") == 1


@pytest.mark.parametrize("missing", [np.nan, None])
def test_a_scene_without_a_name_is_refused(missing: Any) -> None:
    with pytest.raises(ArgumentError, match="missing"):
        ab.bootstrap_ci([1] * 5 + [0] * 5, ["a"] * 5 + [missing] * 5, statistic="share")


def test_float32_clouds_of_projected_coordinates_are_refused() -> None:
    cloud = np.random.default_rng(0).random((100, 3)) * 20 + (5e5, 5e6, 0)
    with pytest.raises(ArgumentError, match="float32"):
        ab.cloud_scores(cloud.astype(np.float32), cloud, threshold=0.2)
    assert ab.cloud_scores(cloud.astype(np.float32), cloud, threshold=10.0).f1 == 1.0
    local = (cloud - (5e5, 5e6, 0)).astype(np.float32)
    assert ab.cloud_scores(local, local, threshold=0.2).f1 == 1.0


def test_limits_that_rounding_would_make_are_refused() -> None:
    with pytest.raises(ArgumentError, match="confidence"):
        ab.bootstrap_ci([1, 0, 1], statistic="share", confidence=1 - 1e-16)


def test_an_angle_beyond_a_half_turn_is_refused() -> None:
    with pytest.raises(ArgumentError, match="180"):
        ab.pose_scores(([1.0, 2.0], [400.0, 1.0]))
    assert ab.pose_scores(([1.0, 2.0], [np.inf, 180.0]))["within_5m_1deg"] == 0.0


@pytest.mark.parametrize("path", [None, 3, "a" * 5000, "a\0b"])
@pytest.mark.parametrize(
    "call",
    [
        ab.load_result,
        ab.load_benchmark,
        lambda path: ab.PredictionWriter(path, "airzoo-mini-retrieval"),
    ],
)
def test_what_is_no_path_is_refused(call: Any, path: Any, tmp_path: Path) -> None:
    with pytest.raises(ArgumentError, match="path"):
        call(path)
