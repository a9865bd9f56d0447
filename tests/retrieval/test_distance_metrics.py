"""Metrics of how far the ranked tiles are: by hand, and what does not fit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from airzoo_bench.retrieval import distance_metrics

INF = np.inf
METRES = np.array([[0.0, 100.0, INF], [30.0, 0.0, 10.0], [INF, INF, INF]])


def test_top1_distance_and_what_is_within():
    top1 = distance_metrics.top1_distance(METRES)
    assert top1.tolist() == [0, 30, INF]
    assert distance_metrics.is_within(top1, 30).tolist() == [1, 0, 0]  # strict
    assert distance_metrics.is_within(top1, 30.1).tolist() == [1, 1, 0]
    assert distance_metrics.is_within(top1, INF).tolist() == [1, 1, 0]  # a miss is never within
    assert distance_metrics.top1_distance(METRES[:, :0]).tolist() == [INF] * 3


def test_sdm():
    # k = 2: weights 2 and 1.
    tenth = math.exp(-0.1)
    expected = [(2 + tenth) / 3, (2 * math.exp(-0.03) + 1) / 3, 0]
    np.testing.assert_allclose(distance_metrics.sdm_at(METRES, 2, 0.001), expected, rtol=1e-15)
    # k = 5 on a list of three: weights 5, 4, 3 of 15.
    expected = [(5 + 4 * tenth) / 15, (5 * math.exp(-0.03) + 4 + 3 * math.exp(-0.01)) / 15, 0]
    np.testing.assert_allclose(distance_metrics.sdm_at(METRES, 5, 0.001), expected, rtol=1e-15)


AUTHORS = {"steepness": 6.0, "tolerance": 0.9}


def test_pdm():
    # Tiles of 100 m: the gain is 1/2 at 90 m, 1/(1 + e^-5.4) at 0, 1/(1 + e^0.6) at 100 m.
    zero, hundred = 1 / (1 + math.exp(-5.4)), 1 / (1 + math.exp(0.6))
    metres = np.array([[90.0, 100.0], [0.0, 0.0], [INF, 0.0], [1e9, INF]])
    expected = [(2 * 0.5 + hundred) / 3, zero, zero / 3, 0]
    scores = distance_metrics.pdm_at(metres, 2, tile_size_m=100, **AUTHORS)
    np.testing.assert_allclose(scores, expected, rtol=1e-14)


def test_pdm_takes_a_size_for_each_tile():
    metres, sizes = np.array([[50.0, 200.0, 7.0]]), np.array([[100.0, 400.0, 1.0]])
    scores = distance_metrics.pdm_at(metres, 2, tile_size_m=sizes, **AUTHORS)
    np.testing.assert_allclose(scores, 1 / (1 + math.exp(6 * (0.5 - 0.9))), rtol=1e-15)
    each_query = distance_metrics.pdm_at(metres, 2, tile_size_m=np.array([[100.0]]), **AUTHORS)
    assert each_query == distance_metrics.pdm_at(metres, 2, tile_size_m=100.0, **AUTHORS)


DISTANCES = hnp.arrays(
    np.float64,
    hnp.array_shapes(min_dims=2, max_dims=2, max_side=6),
    elements=st.floats(0, 1e6) | st.just(INF),
)


@given(DISTANCES, st.integers(1, 8), st.floats(0, 1))
def test_nearer_is_never_worse(metres, k, share):
    near = np.minimum(metres, 1e6) * share
    for score in (
        lambda d: distance_metrics.sdm_at(d, k, 0.001),
        lambda d: distance_metrics.pdm_at(d, k, tile_size_m=300.0, **AUTHORS),
    ):
        far_score, near_score = score(metres), score(near)
        assert ((far_score >= 0) & (near_score <= 1)).all()
        assert (far_score <= near_score + 1e-15).all()  # exp is monotone but for its last bit


def test_distances_refuse_what_does_not_fit():
    with pytest.raises(
        ValueError, match=r"^distances_m holds NaN, expected infinity where there is no tile$"
    ):
        distance_metrics.top1_distance(np.array([[np.nan]]))
    with pytest.raises(ValueError, match=r"expected \(Q, K\)"):
        distance_metrics.pdm_at(METRES[0], 1, tile_size_m=1.0, **AUTHORS)
    with pytest.raises(ValueError, match="k is 0"):
        distance_metrics.sdm_at(METRES, 0, 0.001)
    with pytest.raises(ValueError, match=r"^scale is not above 0$"):
        distance_metrics.sdm_at(METRES, 1, 0.0)
    with pytest.raises(ValueError, match=r"^tile_size_m is not above 0$"):
        distance_metrics.pdm_at(METRES, 1, tile_size_m=np.nan, **AUTHORS)
    with pytest.raises(ValueError, match=r"^steepness is not above 0$"):
        distance_metrics.pdm_at(METRES, 1, tile_size_m=1.0, steepness=-1.0, tolerance=0.9)
