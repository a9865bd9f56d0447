from __future__ import annotations

import math
from typing import get_args

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from airzoo_bench.retrieval import metrics

LOG3, LOG5 = math.log2(3), math.log2(5)

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


def offsets_of(lists: list[list[int]]) -> tuple[np.ndarray, np.ndarray]:
    offsets = np.cumsum([0, *map(len, lists)], dtype=np.int64)
    return offsets, np.array([tile for row in lists for tile in row], dtype=np.int32)


@st.composite
def hit_cases(draw):
    """Hits (Q, K) and numbers of positives that fit them."""
    shape = (draw(st.integers(1, 5)), draw(st.integers(1, 12)))
    found = draw(hnp.arrays(bool, shape))
    missed = draw(hnp.arrays(np.int64, shape[0], elements=st.integers(0, 6)))
    return found, found.sum(axis=1) + missed


# --- hit matrix -------------------------------------------------------------------------------


def test_hit_matrix_by_hand():
    ranked = np.array([[3, 0, 2], [0, 3, -1], [-1, -1, -1], [1, 2, 0]], dtype=np.int32)
    offsets, tiles = offsets_of([[0, 3], [1, 2], [0, 1, 2, 3], []])
    expected = [[1, 1, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]
    assert (
        metrics.hit_matrix(ranked, offsets, tiles, 4).tolist() == np.array(expected, bool).tolist()
    )


def test_no_tile_is_no_hit_even_beside_the_last_tile_of_another_query():
    # -1 lies one cell before tile 0, which is where the last tile of the query before would be.
    ranked = np.full((3, 2), -1, dtype=np.int32)
    offsets, tiles = offsets_of([[0, 1], [0, 1], [0, 1]])
    assert not metrics.hit_matrix(ranked, offsets, tiles, 2).any()


@given(st.data(), st.sampled_from([1, 7, 40, metrics._BITMAP_CELLS]))
def test_hit_matrix_is_membership_for_any_block(data, cells):
    n_tiles = data.draw(st.integers(1, 9))
    lists = data.draw(
        st.lists(st.lists(st.integers(0, n_tiles - 1), unique=True).map(sorted), max_size=8)
    )
    shape = (len(lists), data.draw(st.integers(0, 6)))
    ranked = data.draw(hnp.arrays(np.int32, shape, elements=st.integers(-1, n_tiles - 1)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(metrics, "_BITMAP_CELLS", cells)
        found = metrics.hit_matrix(ranked, *offsets_of(lists), n_tiles)
    assert found.dtype == bool
    assert found.shape == shape
    assert found.tolist() == [
        [tile in positives for tile in row]
        for row, positives in zip(ranked.tolist(), lists, strict=True)
    ]


# --- scores by hand ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("k", "expected"), [(1, [0, 1, 0, 1, 0]), (2, [1, 1, 0, 1, 0]), (9, [1, 1, 0, 1, 0])]
)
def test_recall(k, expected):
    assert metrics.recall_at(HITS, k).tolist() == expected


@pytest.mark.parametrize(
    ("variant", "k", "expected"),
    [
        # hits / k
        ("precision", 3, [1 / 3, 1 / 3, 0, 1, 0]),
        # a list of four ranks has no hit at the fifth
        ("precision", 5, [2 / 5, 1 / 5, 0, 4 / 5, 0]),
        # first query: precision 1/2 at rank 2, then 2/4 at rank 4
        ("trec", 3, [(1 / 2) / 2, 1 / 3, 0, 3 / 9, 0]),
        ("trec", 5, [(1 / 2 + 2 / 4) / 2, 1 / 3, 0, 4 / 9, 0]),
        # min(R, k): 2, 3, 1, 3, (0)
        ("min", 3, [(1 / 2) / 2, 1 / 3, 0, 3 / 3, 0]),
        # min(R, k): 2, 3, 1, 5, (0)
        ("min", 5, [(1 / 2 + 2 / 4) / 2, 1 / 3, 0, 4 / 5, 0]),
        # hits among the first three: 1, 1, 0, 3, 0
        ("hits", 3, [1 / 2, 1, 0, 1, 0]),
        ("hits", 5, [(1 / 2 + 2 / 4) / 2, 1, 0, 1, 0]),
    ],
)
def test_average_precision_at(variant, k, expected):
    scores = metrics.average_precision_at(HITS, POSITIVES, k, variant)
    np.testing.assert_allclose(scores, expected, rtol=1e-15)


def test_average_precision():
    scores = metrics.average_precision(HITS, POSITIVES)
    np.testing.assert_allclose(scores, [(1 / 2 + 2 / 4) / 2, 1 / 3, 0, 4 / 9, 0], rtol=1e-15)


def test_first_hit_and_its_reciprocal():
    assert metrics.first_hit_rank(HITS).tolist() == [2, 1, 0, 1, 0]
    assert metrics.reciprocal_rank(HITS).tolist() == [1 / 2, 1, 0, 1, 0]


def test_ndcg():
    # Discounts 1, 1/log2(3), 1/2, 1/log2(5); first query hits ranks 2 and 4 of an ideal 1 and 2.
    at_four = [(1 / LOG3 + 1 / LOG5) / (1 + 1 / LOG3), 1 / (1 + 1 / LOG3 + 1 / 2), 0, 1, 0]
    np.testing.assert_allclose(metrics.ndcg_at(HITS, POSITIVES, 4), at_four, rtol=1e-15)
    at_two = [(1 / LOG3) / (1 + 1 / LOG3), 1 / (1 + 1 / LOG3), 0, 1, 0]
    np.testing.assert_allclose(metrics.ndcg_at(HITS, POSITIVES, 2), at_two, rtol=1e-15)


@pytest.mark.parametrize("shape", [(0, 4), (3, 0), (0, 0)])
def test_empty_lists_score_zero(shape):
    found, positives = np.zeros(shape, bool), np.ones(shape[0], dtype=np.int64)
    scores = [
        metrics.recall_at(found, 5),
        metrics.average_precision(found, positives),
        metrics.first_hit_rank(found),
        metrics.reciprocal_rank(found),
        metrics.ndcg_at(found, positives, 5),
        *(
            metrics.average_precision_at(found, positives, 5, v)
            for v in get_args(metrics.ApVariant)
        ),
    ]
    assert all(score.tolist() == [0] * shape[0] for score in scores)
    assert metrics.first_hit_rank(found).dtype == np.int64


def test_scores_do_not_depend_on_the_block(monkeypatch):
    rng = np.random.default_rng(3)
    found = rng.random((57, 23)) < 0.4
    positives = found.sum(axis=1) + 2
    whole = metrics.average_precision(found, positives), metrics.ndcg_at(found, positives, 9)
    monkeypatch.setattr(metrics, "_HIT_CELLS", 50)
    blocks = metrics.average_precision(found, positives), metrics.ndcg_at(found, positives, 9)
    assert all(a.tobytes() == b.tobytes() for a, b in zip(whole, blocks, strict=True))


# --- properties of the scores -----------------------------------------------------------------


def all_scores(found: np.ndarray, positives: np.ndarray, k: int) -> dict[str, np.ndarray]:
    return {
        "recall": metrics.recall_at(found, k),
        "map": metrics.average_precision(found, positives),
        "mrr": metrics.reciprocal_rank(found),
        "ndcg": metrics.ndcg_at(found, positives, k),
    } | {
        variant: metrics.average_precision_at(found, positives, k, variant)
        for variant in get_args(metrics.ApVariant)
    }


@given(hit_cases(), st.integers(1, 15))
def test_bounds(case, k):
    for score in all_scores(*case, k).values():
        assert score.dtype == np.float64
        assert ((score >= 0) & (score <= 1)).all()


@given(hit_cases(), st.integers(1, 15))
def test_recall_and_first_hit_and_mean_precision(case, k):
    found, positives = case
    recall, first = metrics.recall_at(found, k), metrics.first_hit_rank(found)
    assert (recall == ((first >= 1) & (first <= k))).all()
    precision = metrics.average_precision_at(found, positives, k, "precision")
    assert (recall / k <= precision).all()
    assert (precision <= recall).all()


@given(hit_cases(), st.integers(1, 14))
def test_a_deeper_cut_never_loses(case, k):
    # Not so for the other variants and nDCG, whose divisor grows with k.
    found, positives = case
    assert (metrics.recall_at(found, k) <= metrics.recall_at(found, k + 1)).all()
    trec = [metrics.average_precision_at(found, positives, depth, "trec") for depth in (k, k + 1)]
    assert (trec[0] <= trec[1]).all()
    assert (trec[1] <= metrics.average_precision(found, positives)).all()


@given(hit_cases(), st.integers(1, 15), st.data())
def test_moving_a_hit_up_never_lowers_a_score(case, k, data):
    found, positives = case
    query, low = data.draw(st.sampled_from(np.argwhere(found).tolist() or [(0, 0)]))
    free = np.flatnonzero(~found[query, :low])
    assume(len(free))
    better = found.copy()
    better[query, [data.draw(st.sampled_from(free.tolist())), low]] = True, False
    before, after = all_scores(found, positives, k), all_scores(better, positives, k)
    if low >= k:
        del before["hits"]  # one more hit among the first k may lower the mean over hits
    for name, score in before.items():
        assert (score <= after[name]).all(), name
    assert after["map"][query] > before["map"][query]


@given(st.integers(1, 12), st.integers(1, 15))
def test_the_best_list_scores_one(n_positives, k):
    found = np.arange(20)[None] < n_positives
    scores = all_scores(found, np.array([n_positives]), k)
    assert scores.pop("trec") == min(n_positives, k) / n_positives
    assert scores.pop("precision") == min(n_positives, k) / k
    assert all(score == 1 for score in scores.values())


# --- distances ---------------------------------------------------------------------------------

INF = np.inf
METRES = np.array([[0.0, 100.0, INF], [30.0, 0.0, 10.0], [INF, INF, INF]])


def test_sdm():
    # k = 2: weights 2 and 1.
    tenth = math.exp(-0.1)
    expected = [(2 + tenth) / 3, (2 * math.exp(-0.03) + 1) / 3, 0]
    np.testing.assert_allclose(metrics.sdm_at(METRES, 2, 0.001), expected, rtol=1e-15)
    # k = 5 on a list of three: weights 5, 4, 3 of 15.
    expected = [(5 + 4 * tenth) / 15, (5 * math.exp(-0.03) + 4 + 3 * math.exp(-0.01)) / 15, 0]
    np.testing.assert_allclose(metrics.sdm_at(METRES, 5, 0.001), expected, rtol=1e-15)


AUTHORS = (6.0, 0.9)  # steepness, tolerance


def test_pdm():
    # Tiles of 100 m: the gain is 1/2 at 90 m, 1/(1 + e^-5.4) at 0, 1/(1 + e^0.6) at 100 m.
    zero, hundred = 1 / (1 + math.exp(-5.4)), 1 / (1 + math.exp(0.6))
    metres = np.array([[90.0, 100.0], [0.0, 0.0], [INF, 0.0], [1e9, INF]])
    expected = [(2 * 0.5 + hundred) / 3, zero, zero / 3, 0]
    scores = metrics.pdm_at(metres, 2, np.full(metres.shape, 100.0), *AUTHORS)
    np.testing.assert_allclose(scores, expected, rtol=1e-14)


def test_pdm_takes_a_size_for_each_tile():
    metres, sizes = np.array([[50.0, 200.0, 7.0]]), np.array([[100.0, 400.0, 1.0]])
    scores = metrics.pdm_at(metres, 2, sizes, *AUTHORS)
    np.testing.assert_allclose(scores, 1 / (1 + math.exp(6 * (0.5 - 0.9))), rtol=1e-15)


DISTANCES = hnp.arrays(
    np.float64,
    hnp.array_shapes(min_dims=2, max_dims=2, max_side=6),
    elements=st.floats(0, 1e6) | st.just(INF),
)


@given(DISTANCES, st.integers(1, 8), st.floats(0, 1))
def test_nearer_is_never_worse(metres, k, share):
    near = np.minimum(metres, 1e6) * share
    for score in (
        lambda d: metrics.sdm_at(d, k, 0.001),
        lambda d: metrics.pdm_at(d, k, np.full(d.shape, 300.0), *AUTHORS),
    ):
        far_score, near_score = score(metres), score(near)
        assert ((far_score >= 0) & (near_score <= 1)).all()
        assert (far_score <= near_score + 1e-15).all()  # exp is monotone but for its last bit


def test_dis_counts_ranks_without_a_tile_as_the_farthest():
    distances, farthest = np.array([[1.0, 4.0], [2.0, np.inf]]), np.array([10.0, 20.0])
    assert metrics.dis_at(distances, 3, farthest).tolist() == [5.0, 14.0]
    assert metrics.dis_at(distances, 1, farthest).tolist() == [1.0, 2.0]
