"""Descriptors are ranked as float64 has them; ties of any kind go against the submitter."""

from __future__ import annotations

import pickle
import random
from dataclasses import dataclass
from typing import Any
from unittest import mock

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.engines.engine import Engine
from airzoo_bench.evaluation.track import Run
from airzoo_bench.retrieval import ranking
from airzoo_bench.retrieval.predictions import check_lists
from airzoo_bench.retrieval.ranking import Depths, rank_by_ids
from airzoo_bench.retrieval.truth import Positives
from tests.retrieval.ranking_support import positives_of, rank

METRICS = ["l2", "cosine", "inner_product"]


def random_positives(rng: Any, n_queries: int, n_tiles: int, most: int = 4) -> Positives:
    counts = rng.integers(0, min(most, n_tiles) + 1, n_queries)
    return positives_of(*[np.sort(rng.choice(n_tiles, n, replace=False)) for n in counts])


def similarities(queries: Any, gallery: Any, metric: str) -> Any:
    """The plain way, in more digits; a query of zeros is alike to all."""
    queries, gallery = (np.asarray(one, np.longdouble) for one in (queries, gallery))
    if metric == "l2":
        return -((queries[:, None] - gallery) ** 2).sum(axis=2) * queries.any(axis=1)[:, None]
    if metric == "cosine":
        queries = queries / np.linalg.norm(queries, axis=1, keepdims=True)
        gallery = gallery / np.linalg.norm(gallery, axis=1, keepdims=True)
    return (queries[:, None] * gallery).sum(axis=2)


def naive(scores: Any, positives: Positives, k: int, scored: int) -> tuple[Any, Any]:
    """Sort whole rows by the tie rule; look at whole runs of equal scores."""
    n_queries, n_tiles = scores.shape
    tiles, tied = np.full((n_queries, k), -1), np.zeros(n_queries, bool)
    for query, row in enumerate(scores):
        positive = np.isin(np.arange(n_tiles), positives.tiles_of(query))
        order = np.lexsort((np.arange(n_tiles), positive, -row))
        tiles[query, : min(k, n_tiles)] = order[:k]
        for tile in order[:scored]:
            run = positive[row == row[tile]]
            tied[query] |= run.any() and not run.all()
        if n_tiles > 1 and (row == row[0]).all() and not positive.all():
            tiles[query] = -1  # no ranking at all
    return tiles, tied


def assert_is(ranking, expected) -> None:
    assert ranking.tiles.dtype == np.int32
    assert ranking.tiles.tolist() == expected[0].tolist()
    assert ranking.tie_dependent.tolist() == expected[1].tolist()


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize(
    ("length", "scale", "apart"),  # the last is below the resolution of float32
    [(3, 1, 1), (64, 1e-12, 1), (64, 1e15, 1), (4_100, 1, 1), (40, 1, 1e-8)],
)
@pytest.mark.parametrize("memory_bytes", [1 << 30, 1 << 13])
def test_no_ties(metric: str, length: int, scale: float, apart: float, memory_bytes: int) -> None:
    rng = np.random.default_rng(2)
    queries, gallery, base = (rng.standard_normal((n, length)) for n in (6, 200, 1))
    gallery = scale * (base * (apart < 1) + apart * gallery)
    queries, positives = scale * queries, random_positives(rng, 6, 200)
    found = rank(queries, gallery, metric, 30, 5, positives, Run(memory_bytes))
    assert_is(found, naive(similarities(queries, gallery, metric), positives, 30, 5))


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize("n_tiles", [2, 900])
def test_equal_tiles_and_queries_of_zeros_have_no_ranking(metric: str, n_tiles: int) -> None:
    """Or by L2 a query of zeros would find the shortest descriptor, which is its only positive."""
    rng = np.random.default_rng(3)
    queries, one = rng.standard_normal((5, 64)), rng.standard_normal(64)
    positives = positives_of(*[[int(tile)] for tile in rng.integers(0, n_tiles, 5)])
    k = min(100, n_tiles)
    found = rank(queries, np.tile(one, (n_tiles, 1)), metric, k, 5, positives)
    assert (found.tiles == -1).all()
    assert found.tie_dependent.all()
    gallery = rng.standard_normal((n_tiles, 64))
    gallery[positives.tiles[1]] *= 0.1
    queries[1] = 0
    found = rank(queries, gallery, metric, k, 5, positives)
    assert (found.tiles >= 0).all(axis=1).tolist() == [True, False, True, True, True]
    assert (found.tiles[1] == -1).all()
    assert found.tie_dependent.tolist() == [False, True, False, False, False]


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize(
    ("n_tiles", "memory_bytes"), [(40, 1 << 14), (300, 1 << 15), (900, 1 << 30)]
)
def test_what_rounding_alone_tells_apart_is_a_tie(metric, n_tiles, memory_bytes) -> None:
    """Mathematically alike for every query, in floating point not: half of the gallery."""
    rng = np.random.default_rng(4)
    base = rng.standard_normal(96)
    queries = np.full((3, 96), 0.1)
    gallery = np.stack([rng.permutation(base) for _ in range(n_tiles)])  # one sum, many orders
    if metric == "cosine":
        gallery *= rng.uniform(0.5, 2, (n_tiles, 1))
    gallery[::2] = -5  # farther, by any metric
    assert len(np.unique(similarities(queries, gallery, metric)[0, 1::2])) > 1
    positives = positives_of([1], [n_tiles - 1], [1, 3, n_tiles - 1])
    found = rank(queries, gallery, metric, 10, 5, positives, Run(memory_bytes))
    others = [np.setdiff1d(np.arange(1, n_tiles, 2), positives.tiles_of(q))[:10] for q in range(3)]
    assert found.tiles.tolist() == [tiles.tolist() for tiles in others]
    assert found.tie_dependent.all()


@pytest.mark.parametrize("metric", METRICS)
def test_crowds_agree_with_a_plain_sort_in_little_memory_and_from_a_map(metric, tmp_path) -> None:
    rng = np.random.default_rng(7)
    gallery = rng.standard_normal((3_000, 24)).astype(np.float32)
    queries = rng.standard_normal((9, 24)).astype(np.float32)
    for query in range(4):  # a crowd of equal tiles at their top; others have none
        copies = rng.choice(3_000, 400, replace=False)
        gallery[copies] = 3 * queries[query] / np.linalg.norm(queries[query])
    positives = random_positives(rng, 9, 3_000, most=600)
    np.save(tmp_path / "gallery.npy", gallery)
    # Rounded, since the plain sums of equal tiles need not be equal.
    scores = similarities(queries, gallery, metric).round(9)
    for rows in (gallery, np.load(tmp_path / "gallery.npy", mmap_mode="r")):
        found = rank(queries, rows, metric, 25, 5, positives, Run(1 << 16))
        assert_is(found, naive(scores, positives, 25, 5))


@dataclass
class Shuffled(Engine):
    """Does tasks out of order and twice, on pickled copies."""

    seed: int = 0
    distributed = True

    def map(self, work: Any, items: Any, *, shared: Any, stage: str, name: Any) -> Any:
        tasks = [pickle.dumps((shared, item)) for item in items]
        order = [*range(len(tasks))] * 2
        random.Random(self.seed).shuffle(order)
        done = {index: work(*pickle.loads(tasks[index])) for index in order}  # noqa: S301
        return iter([done[index] for index in range(len(tasks))])


GALLERIES = {  # tiles that tie near and far, of which many are crowds, or none is
    "plain": lambda rows, rng: rows,
    "lattice": lambda rows, rng: rng.integers(-2, 3, rows.shape),
    # Most tiles are one, as the sea is; some elsewhere answer better.
    "blank": lambda rows, rng: np.where(rng.random((len(rows), 1)) < 0.8, rows[0], rows),
    "close": lambda rows, rng: rows[:1] + 1e-8 * rows,  # below the resolution of float32
}


@given(
    seed=st.integers(0, 2**32 - 1),
    kind=st.sampled_from([*GALLERIES]),
    n_tiles=st.sampled_from([1, 2, 7, 60, 300, 900]),
    length=st.sampled_from([1, 3, 24]),
    k=st.sampled_from([1, 3, 10, 70]),
    scored=st.sampled_from([1, 5]),
    metric=st.sampled_from(METRICS),
    memory_bytes=st.sampled_from([1 << 9, 1 << 12, 1 << 16, 1 << 30]),
    dtype=st.sampled_from([np.float16, np.float32, np.float64]),
    most=st.sampled_from([1, 2, 5, 12]),
)
def test_any_cut_gives_the_same_bytes_and_of_many_ties_the_plain_sort(
    seed, kind, n_tiles, length, k, scored, metric, memory_bytes, dtype, most
) -> None:
    rng = np.random.default_rng(seed)
    gallery = GALLERIES[kind](rng.standard_normal((n_tiles, length)), rng).astype(dtype)
    if metric == "cosine":
        gallery[~gallery.any(axis=1)] = 1
    queries = rng.integers(-2, 3, (12, length)).astype(dtype) + (rng.random((12, length)) < 0.5)
    queries = np.where(queries.any(axis=1, keepdims=True), queries, 1).astype(dtype)
    queries[0] = gallery[-1]
    positives = random_positives(rng, 12, n_tiles)
    expected = rank(queries, gallery, metric, k, scored, positives)
    if kind == "lattice" and metric != "cosine":  # whole numbers: plain sums are exact
        assert_is(expected, naive(similarities(queries, gallery, metric), positives, k, scored))
    with mock.patch.object(ranking, "_SENT_QUERIES", most):
        cut = Run(memory_bytes, engine=Shuffled(seed))
        found = rank(queries, gallery, metric, k, scored, positives, cut)
    assert found.tiles.tobytes() == expected.tiles.tobytes()
    assert found.tie_dependent.tobytes() == expected.tie_dependent.tobytes()


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300, 0])
def test_descriptors_that_cannot_be_ranked_are_refused_by_name(value: float, metric: str) -> None:
    good, bad = np.ones((10, 4)), np.ones((10, 4))
    bad[[1, 4, 5, 9]] = value
    names = [f"city/{i}" for i in range(10)]
    for pair, field in (((bad, good), "query"), ((good, bad), "gallery")):
        if value == 0 and (metric != "cosine" or field == "query"):  # such a query ties with all
            rank(*pair, metric, names=names)
            continue
        with pytest.raises(PredictionError, match="city/1, city/4, city/5") as caught:
            rank(*pair, metric, names=names)
        assert caught.value.where == f"field '{field}_descriptors'"


def test_no_tiles_and_no_queries() -> None:
    assert rank(np.ones((2, 4)), np.ones((0, 4))).tiles.tolist() == [[-1] * 3] * 2
    assert rank(np.ones((0, 4)), np.arange(20.0).reshape(5, 4)).tiles.shape == (0, 3)


# --- ranked lists ---


@pytest.mark.parametrize(
    ("ranked", "scores", "positives", "depth", "expected", "tied"),
    [
        # Ties go against the submitter: a non-positive first, then by number.
        ([3, 1, 2, 0], [1, 1, 1, 0.5], [1, 3], 1, [2, 1, 3, 0], True),
        ([3, 1, 2, 0], [-1, -1, -1, -0.5], [1, 3], 1, [2, 1, 3, 0], True),  # distances
        # A tie counts where it begins before the depth.
        ([5, 4, 3, 2, 1, 0], [9, 8, 8, 8, 7, 6], [2], 1, [5, 3, 4, 2, 1, 0], False),
        ([5, 4, 3, 2, 1, 0], [9, 8, 8, 8, 7, 6], [2], 2, [5, 3, 4, 2, 1, 0], True),
        # It takes in what was left out at the end of a list, positives too.
        ([4, 1, 2], [2, 1, 1], [0], 5, [4, 1, 2, 3, 5, -1], True),
        ([4, 1, 2], [2, 1, 1], [1], 5, [4, 0, 2, 3, 5, 1], True),
        ([4, 1, 2], [2, 1, 1], [1], 1, [4, 0, 2, 3, 5, 1], False),
        ([4, 1, 2], [2, 1, 1], [4], 5, [4, 0, 1, 2, 3, 5], False),
        ([4, 1, 2], [2, 1, 1], [0, 1, 2, 3, 5], 5, [4, 1, 2, -1, -1, -1], False),
    ],
)
def test_ties_by_hand(ranked, scores, positives, depth, expected, tied) -> None:
    n, right = len(expected), positives_of(positives)
    lists = np.array([ranked]), np.array([scores])
    found = rank_by_ids(*lists, right, Depths(n, n, depth))
    assert_is(found, (np.array([expected]), np.array([tied])))


def completed(ranked: Any, scores: Any, positives: Positives, n_tiles: int) -> Any:
    """What the rule says of lists that end in a tie: the scores of all tiles, those left out too.

    Positives that were left out are as good as not there: worse than everything.
    """
    whole = np.full((len(ranked), n_tiles), -np.inf)
    for query, (tiles, row) in enumerate(zip(ranked, scores, strict=True)):
        if len(tiles) > 1 and row[-1] == row[-2]:
            whole[query] = row[-1]
            whole[query, positives.tiles_of(query)] = -np.inf
        whole[query, tiles] = row
    return whole


# Of three tiles that all answer two are listed, as equals: the third is not given.
@example(seed=1, n_tiles=3, listed=2, k=2, scored=1, falling=False)
@given(
    seed=st.integers(0, 2**32 - 1),
    n_tiles=st.integers(2, 14),
    listed=st.integers(1, 14),
    k=st.integers(1, 14),
    scored=st.integers(1, 14),
    falling=st.booleans(),
)
def test_lists_agree_with_a_plain_sort_and_a_tie_at_the_end_takes_in_what_was_left_out(
    seed: int, n_tiles: int, listed: int, k: int, scored: int, falling: bool
) -> None:
    rng = np.random.default_rng(seed)
    listed = min(listed, n_tiles)
    positives = random_positives(rng, 4, n_tiles)
    ranked = np.stack([rng.permutation(n_tiles)[:listed] for _ in range(4)])
    scores = -np.sort(rng.integers(0, 3, ranked.shape), axis=1).astype(float)
    given_scores = scores if falling else -scores
    found = rank_by_ids(ranked, given_scores, positives, Depths(n_tiles, k, scored))
    whole = completed(ranked, scores, positives, n_tiles)
    if listed == n_tiles:
        assert_is(found, naive(whole, positives, k, scored))
    for query, row in enumerate(whole):
        positive = np.isin(np.arange(n_tiles), positives.tiles_of(query))
        order = np.lexsort((np.arange(n_tiles), positive, -row))
        order = order[row[order] > -np.inf]
        expected = [*order[:k], *[-1] * k][:k]
        tied_throughout = (scores[query] == scores[query, 0]).all() and listed > 1
        if tied_throughout and not positive.all():
            expected = [-1] * k
        assert found.tiles[query].tolist() == expected


@pytest.mark.parametrize(
    ("ranked", "scores", "field"),
    [
        ([[0, 1, 2], [0, 1, 2]], [[3, 2, 1], [3, 1, 2]], "scores"),
        ([[0, 1, 2], [0, 1, 2]], [[3, 2, 1], [3, np.nan, 2]], "scores"),
        ([[0, 1, 2], [0, -1, 2]], None, "ranked_ids"),
        ([[0, 1, 2], [2, 1, 2]], None, "ranked_ids"),
    ],
)
def test_bad_lists_are_refused_by_name(ranked, scores, field) -> None:
    scores = None if scores is None else np.array(scores, float)
    texts = np.where(np.array(ranked) < 0, "", np.array(ranked).astype(str))
    for lists in (np.array(ranked), texts):
        with pytest.raises(PredictionError, match=rf"field '{field}': .*1 of 2 \(b\)"):
            check_lists(lists, scores, ["a", "b"])
    check_lists(texts[:1], None if scores is None else scores[:1], ["a"])
