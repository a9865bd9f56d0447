from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.reconstruction import metrics as metrics_module
from airzoo_bench.reconstruction.metrics import (
    CloudScores,
    counts_below,
    curve,
    exact_mean,
    score_distances,
)
from tests.geometry.support import quick, seeds

INF = math.inf
CUBE = np.array([(x, y, z) for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])

distances = hnp.arrays(
    np.float64,
    st.integers(1, 60),
    elements=st.one_of(
        st.sampled_from((0.0, 0.1, 1.0, 10.0, 1e16, INF)), st.floats(0.0, 1e12, allow_nan=False)
    ),
)


def scored(
    to_truth: list[float] | Floats, to_prediction: list[float] | Floats, most: float | None = None
) -> CloudScores:
    there, back, limits = (np.array(one) for one in (to_truth, to_prediction, (1.0, 10.0)))
    return score_distances(there, back, thresholds=limits, max_distance=most)


def test_by_hand() -> None:
    scores = scored([0.0, 2.0, 9.0, 10.0], [0.5, 20.0])
    # 10 is not below 10.
    assert scores.curve.precision.tolist() == [0.25, 0.75]
    assert scores.curve.recall.tolist() == [0.5, 0.5]
    assert scores.curve.f1.tolist() == pytest.approx([2 * 0.25 * 0.5 / 0.75, 0.6], rel=1e-15)
    assert (scores.accuracy, scores.completeness, scores.chamfer) == (5.25, 10.25, 7.75)
    assert (scores.accuracy_median, scores.completeness_median) == (5.5, 10.25)
    assert scored([7.0, 1.0, 2.0], [3.0]).accuracy_median == 2.0


@pytest.mark.parametrize(
    ("there", "back", "share", "mean"),
    [([0.0], [0.0, 0.0], 1.0, 0.0), ([50.0], [50.0, 50.0], 0.0, 50.0), ([], [INF, INF], 0.0, INF)],
    ids=["perfect", "nothing near", "nothing predicted"],
)
def test_the_best_and_the_worst(
    there: list[float], back: list[float], share: float, mean: float
) -> None:
    scores = scored(there, back)
    for shares in (scores.curve.precision, scores.curve.recall, scores.curve.f1):
        assert shares.tolist() == [share, share]
    assert {scores.accuracy, scores.completeness, scores.chamfer} == {mean}
    assert scores.accuracy_median == scores.completeness_median == mean


def test_clipping_by_name_changes_means_only() -> None:
    clipped, plain = (scored([1.0, 50.0], [3.0, 30.0], most) for most in (20.0, None))
    assert (clipped.accuracy, clipped.completeness, clipped.chamfer) == (10.5, 11.5, 11.0)
    assert plain.chamfer == (25.5 + 16.5) / 2
    assert clipped.curve.f1.tolist() == plain.curve.f1.tolist()
    assert clipped.accuracy_median == plain.accuracy_median
    empty = scored([], [INF], 20.0)
    assert (empty.accuracy, empty.completeness, empty.chamfer) == (INF, INF, INF)


@given(distances, distances, seeds)
@quick
def test_no_bit_depends_on_order(to_truth: Floats, to_prediction: Floats, seed: int) -> None:
    random = np.random.default_rng(seed)
    shuffled = random.permutation(to_truth), random.permutation(to_prediction)
    assert values(scored(*shuffled)) == values(scored(to_truth, to_prediction))


def values(scores: CloudScores) -> list[object]:
    single = (scores.accuracy, scores.completeness, scores.chamfer)
    medians = (scores.accuracy_median, scores.completeness_median)
    return [*single, *medians, scores.curve.precision.tolist(), scores.curve.recall.tolist()]


@given(distances)
@quick
def test_mean_median_and_counts_against_a_sorted_list(found: Floats) -> None:
    ordered, count = sorted(found.tolist()), len(found)
    scores = scored(found, [1.0])
    assert scores.accuracy == math.fsum(ordered) / count
    assert scores.accuracy_median == (ordered[(count - 1) // 2] + ordered[count // 2]) / 2
    thresholds = np.array((0.1, 1.0, 1.5, 10.0, 1e16))
    assert counts_below(found, thresholds).dtype == np.int64
    assert counts_below(found, thresholds).tolist() == (found[:, None] < thresholds).sum(0).tolist()


def test_several_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    found = np.random.default_rng(0).random(1000)
    counted, mean = counts_below(found, np.array([0.2, 0.7])), exact_mean(found)
    monkeypatch.setattr(metrics_module, "_CHUNK", 7)
    assert counts_below(found, np.array([0.2, 0.7])).tolist() == counted.tolist()
    assert exact_mean(found) == mean


def test_sums_beyond_single_precision_and_roundings() -> None:
    # A float32 sum of ones stays at 16,777,216.
    assert counts_below(np.zeros(16_777_220), np.array([1.0])).tolist() == [16_777_220]
    found = np.array([1e16, 1.0, 1.0, 0.0])
    assert exact_mean(found) == (1e16 + 2) / 4
    assert np.cumsum(found)[-1] == 1e16


def test_curve_by_hand() -> None:
    steps = np.array([1.0, 2.0, 3.0, 4.0])
    curves = curve(np.array([0.5, 1.5]), np.array([1.0, 2.0, 3.0, INF]), steps)
    assert curves.thresholds.tolist() == [1.0, 2.0, 3.0, 4.0]
    assert curves.precision.tolist() == [0.5, 1.0, 1.0, 1.0]
    assert curves.recall.tolist() == [0.0, 0.25, 0.5, 0.75]
    assert curves.f1.tolist() == pytest.approx([0.0, 0.4, 2 / 3, 6 / 7])
