"""Formulas of scores, worked by hand, and properties that hold of any ranking."""

from __future__ import annotations

import math
from typing import get_args

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from airzoo_bench.retrieval import metrics
from tests.retrieval.ranking_support import positives_of

LOG3, LOG5, INF = math.log2(3), math.log2(5), math.inf
VARIANTS = get_args(metrics.ApVariant)

# Five queries on the same gallery, four ranks.
#            ranks 1..4   R
CASES = [
    ([0, 1, 0, 1], 2),  # second and fourth, and no positive is left out
    ([1, 0, 0, 0], 3),  # first; two positives were not ranked
    ([0, 0, 0, 0], 1),  # nothing found
    ([1, 1, 1, 1], 9),  # all hits; more positives than ranks
    ([0, 0, 0, 0], 0),  # unanswerable
]
HITS = np.array([row for row, _ in CASES], dtype=bool)
POSITIVES = np.array([count for _, count in CASES])


@given(st.data(), st.sampled_from([1, 7, 40, metrics._BITMAP_CELLS]))
def test_hit_matrix_is_membership_for_any_block(data, cells) -> None:
    # -1 lies one cell before tile 0, which is where the last tile of the query before would be.
    n_tiles = data.draw(st.integers(1, 9))
    lists = data.draw(
        st.lists(st.lists(st.integers(0, n_tiles - 1), unique=True).map(sorted), max_size=8)
    )
    shape = (len(lists), data.draw(st.integers(0, 6)))
    ranked = data.draw(hnp.arrays(np.int32, shape, elements=st.integers(-1, n_tiles - 1)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(metrics, "_BITMAP_CELLS", cells)
        right = positives_of(*lists)
        found = metrics.hit_matrix(ranked, right.offsets, right.tiles, n_tiles)
    assert (found.dtype, found.shape) == (bool, shape)
    pairs = zip(ranked.tolist(), lists, strict=True)
    assert found.tolist() == [[tile in positives for tile in row] for row, positives in pairs]


AP_AT, NDCG = metrics.average_precision_at, metrics.ndcg_at


BY_HAND = {
    "recall@1": (lambda: metrics.recall_at(HITS, 1), [0, 1, 0, 1, 0]),
    "recall@2": (lambda: metrics.recall_at(HITS, 2), [1, 1, 0, 1, 0]),
    "recall@9": (lambda: metrics.recall_at(HITS, 9), [1, 1, 0, 1, 0]),
    "first rank": (lambda: metrics.first_hit_rank(HITS), [2, 1, 0, 1, 0]),
    "first rank of no tiles": (lambda: metrics.first_hit_rank(HITS[:, :0]), [0] * 5),
    "mrr": (lambda: metrics.reciprocal_rank(HITS), [1 / 2, 1, 0, 1, 0]),
    # hits / k; a list of four ranks has no hit at the fifth
    "ap@3": (lambda: AP_AT(HITS, POSITIVES, 3, "precision"), [1 / 3, 1 / 3, 0, 1, 0]),
    "ap@5": (lambda: AP_AT(HITS, POSITIVES, 5, "precision"), [2 / 5, 1 / 5, 0, 4 / 5, 0]),
    # first query: precision 1/2 at rank 2, then 2/4 at rank 4
    "ap@3/trec": (lambda: AP_AT(HITS, POSITIVES, 3, "trec"), [1 / 4, 1 / 3, 0, 3 / 9, 0]),
    "ap@5/trec": (lambda: AP_AT(HITS, POSITIVES, 5, "trec"), [1 / 2, 1 / 3, 0, 4 / 9, 0]),
    "map": (lambda: metrics.average_precision(HITS, POSITIVES), [1 / 2, 1 / 3, 0, 4 / 9, 0]),
    # min(R, k): 2, 3, 1, 3, (0); then 2, 3, 1, 5, (0)
    "ap@3/min": (lambda: AP_AT(HITS, POSITIVES, 3, "min"), [1 / 4, 1 / 3, 0, 3 / 3, 0]),
    "ap@5/min": (lambda: AP_AT(HITS, POSITIVES, 5, "min"), [1 / 2, 1 / 3, 0, 4 / 5, 0]),
    # hits among the first three: 1, 1, 0, 3, 0
    "ap@3/hits": (lambda: AP_AT(HITS, POSITIVES, 3, "hits"), [1 / 2, 1, 0, 1, 0]),
    "ap@5/hits": (lambda: AP_AT(HITS, POSITIVES, 5, "hits"), [1 / 2, 1, 0, 1, 0]),
    # Discounts 1, 1/log2(3), 1/2, 1/log2(5); the first query hits ranks 2 and 4.
    "ndcg@4": (
        lambda: NDCG(HITS, POSITIVES, 4),
        [(1 / LOG3 + 1 / LOG5) / (1 + 1 / LOG3), 1 / (1.5 + 1 / LOG3), 0, 1, 0],
    ),
    "ndcg@2": (
        lambda: NDCG(HITS, POSITIVES, 2),
        [(1 / LOG3) / (1 + 1 / LOG3), 1 / (1 + 1 / LOG3), 0, 1, 0],
    ),
}


@pytest.mark.parametrize("score", BY_HAND)
def test_scores_by_hand(score) -> None:
    compute, expected = BY_HAND[score]
    found = compute()
    assert found.shape == (5,)
    np.testing.assert_allclose(found, expected, rtol=1e-15)


def all_scores(found: np.ndarray, positives: np.ndarray, k: int) -> dict[str, np.ndarray]:
    return {
        "recall": metrics.recall_at(found, k),
        "map": metrics.average_precision(found, positives),
        "mrr": metrics.reciprocal_rank(found),
        "ndcg": metrics.ndcg_at(found, positives, k),
    } | {variant: AP_AT(found, positives, k, variant) for variant in VARIANTS}


@given(st.data(), st.integers(1, 15))
def test_moving_a_hit_up_never_lowers_a_score(data, k) -> None:
    shape = (data.draw(st.integers(1, 5)), data.draw(st.integers(1, 12)))
    found = data.draw(hnp.arrays(bool, shape))
    missed = data.draw(hnp.arrays(np.int64, shape[0], elements=st.integers(0, 6)))
    positives = found.sum(axis=1) + missed
    query, low = data.draw(st.sampled_from(np.argwhere(found).tolist() or [(0, 0)]))
    free = np.flatnonzero(~found[query, :low])
    assume(len(free))
    better = found.copy()
    better[query, [data.draw(st.sampled_from(free.tolist())), low]] = True, False
    before, after = all_scores(found, positives, k), all_scores(better, positives, k)
    assert all(((score >= 0) & (score <= 1)).all() for score in before.values())
    if low >= k:
        del before["hits"]  # one more hit among the first k may lower the mean over hits
    for name, score in before.items():
        assert (score <= after[name]).all(), name
    assert after["map"][query] > before["map"][query]


# --- distances ---

METRES = np.array([[0.0, 100.0, INF], [30.0, 0.0, 10.0], [INF, INF, INF]])
AUTHORS = (6.0, 0.9)  # steepness, tolerance


def test_sdm() -> None:
    # k = 2: weights 2 and 1; k = 5 on a list of three: weights 5, 4, 3 of 15.
    tenth = math.exp(-0.1)
    two = [(2 + tenth) / 3, (2 * math.exp(-0.03) + 1) / 3, 0]
    five = [(5 + 4 * tenth) / 15, (5 * math.exp(-0.03) + 4 + 3 * math.exp(-0.01)) / 15, 0]
    np.testing.assert_allclose(metrics.sdm_at(METRES, 2, 0.001), two, rtol=1e-15)
    np.testing.assert_allclose(metrics.sdm_at(METRES, 5, 0.001), five, rtol=1e-15)


def test_pdm() -> None:
    # Tiles of 100 m: the gain is 1/2 at 90 m, 1/(1 + e^-5.4) at 0, 1/(1 + e^0.6) at 100 m.
    zero, hundred = 1 / (1 + math.exp(-5.4)), 1 / (1 + math.exp(0.6))
    metres = np.array([[90.0, 100.0], [0.0, 0.0], [INF, 0.0], [1e9, INF]])
    expected = [(2 * 0.5 + hundred) / 3, zero, zero / 3, 0]
    scores = metrics.pdm_at(metres, 2, np.full(metres.shape, 100.0), *AUTHORS)
    np.testing.assert_allclose(scores, expected, rtol=1e-14)
    metres, sizes = np.array([[50.0, 200.0, 7.0]]), np.array([[100.0, 400.0, 1.0]])
    scores = metrics.pdm_at(metres, 2, sizes, *AUTHORS)  # a size for each tile
    np.testing.assert_allclose(scores, 1 / (1 + math.exp(6 * (0.5 - 0.9))), rtol=1e-15)


def test_dis_counts_ranks_without_a_tile_as_the_farthest() -> None:
    distances, farthest = np.array([[1.0, 4.0], [2.0, np.inf]]), np.array([10.0, 20.0])
    assert metrics.dis_at(distances, 3, farthest).tolist() == [5.0, 14.0]
    assert metrics.dis_at(distances, 1, farthest).tolist() == [1.0, 2.0]
