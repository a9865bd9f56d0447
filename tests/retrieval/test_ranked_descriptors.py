from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from airzoo_bench.evaluation.track import Run
from airzoo_bench.retrieval import search
from airzoo_bench.retrieval.ranking import rank_by_descriptors
from tests.retrieval.ranking_support import (
    METRICS,
    assert_is,
    naive,
    positives_of,
    random_positives,
    similarities,
)


@settings(max_examples=80, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n_tiles=st.sampled_from([1, 2, 7, 60, 300]),
    length=st.integers(1, 4),
    k=st.sampled_from([1, 3, 10, 70]),
    depth=st.sampled_from([1, 5]),
    metric=st.sampled_from(["l2", "inner_product"]),
    memory_bytes=st.sampled_from([1 << 9, 1 << 12, 1 << 30]),
    dtype=st.sampled_from([np.float16, np.float32, np.float64]),
)
def test_descriptors_with_many_ties(seed, n_tiles, length, k, depth, metric, memory_bytes, dtype):
    rng = np.random.default_rng(seed)
    queries = rng.integers(-2, 3, (4, length)).astype(dtype)
    gallery = rng.integers(-2, 3, (n_tiles, length)).astype(dtype)
    positives = random_positives(rng, 4, n_tiles)
    ranking = rank_by_descriptors(
        queries,
        gallery,
        k=k,
        metric=metric,
        positives=positives,
        depth=depth,
        run=Run(memory_bytes),
    )
    expected = naive(similarities(queries, gallery, metric), positives, k, depth)
    assert_is(ranking, expected)


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize("length", [3, 64, 5_000])
def test_descriptors_without_ties(metric, length):
    rng = np.random.default_rng(2)
    queries, gallery = rng.standard_normal((6, length)), rng.standard_normal((400, length))
    positives = random_positives(rng, 6, 400)
    ranking = rank_by_descriptors(
        queries, gallery, k=30, metric=metric, positives=positives, depth=5
    )
    assert_is(ranking, naive(similarities(queries, gallery, metric), positives, 30, 5))


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize("n_tiles", [2, 900])
def test_equal_tiles_have_no_ranking(metric, n_tiles):
    rng = np.random.default_rng(3)
    found = rank_by_descriptors(
        rng.standard_normal((5, 64)),
        np.tile(rng.standard_normal(64), (n_tiles, 1)),
        k=min(100, n_tiles),
        metric=metric,
        positives=positives_of(*[[int(tile)] for tile in rng.integers(0, n_tiles, 5)]),
        depth=5,
    )
    assert (found.tiles == -1).all()
    assert found.tie_dependent.all()


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize(
    ("n_tiles", "memory_bytes"),
    [
        (40, 1 << 14),
        (40, 1 << 30),
        (900, 1 << 30),
        pytest.param(900, 1 << 14, marks=pytest.mark.slow),
    ],
)
def test_what_rounding_alone_tells_apart_is_a_tie(metric, n_tiles, memory_bytes):
    """Mathematically alike for every query, in floating point not: half of the gallery."""
    rng = np.random.default_rng(4)
    base = rng.standard_normal(96)
    queries = np.full((3, 96), 0.1)
    gallery = np.stack([rng.permutation(base) for _ in range(n_tiles)])  # one sum, many orders
    if metric == "cosine":
        gallery *= rng.uniform(0.5, 2, (n_tiles, 1))
    gallery[::2] = -5  # farther, by any metric
    plain = similarities(queries, gallery, metric)[0, 1::2]
    assert len(np.unique(plain)) > 1
    last = n_tiles - 1
    positives = positives_of([1], [last], [1, 3, last])
    found = rank_by_descriptors(
        queries,
        gallery,
        k=10,
        metric=metric,
        positives=positives,
        depth=5,
        run=Run(memory_bytes),
    )
    others = [
        [tile for tile in range(1, n_tiles, 2) if tile not in positives.of_query(query)][:10]
        for query in range(3)
    ]
    assert found.tiles.tolist() == others
    assert found.tie_dependent.all()


@pytest.mark.parametrize("metric", METRICS)
@pytest.mark.parametrize("n_tiles", [80, 500])  # few enough to be kept; a crowd
@pytest.mark.parametrize("memory_bytes", [1 << 13, 1 << 30])
@pytest.mark.parametrize("apart", [1e-8, pytest.param(3e-8, marks=pytest.mark.slow)])
def test_order_below_the_resolution_of_float32(metric, n_tiles, memory_bytes, apart):
    rng = np.random.default_rng(4)
    base = rng.standard_normal(40)
    gallery = base + apart * rng.standard_normal((n_tiles, 40))
    queries = rng.standard_normal((5, 40))
    ranking = rank_by_descriptors(
        queries,
        gallery,
        k=20,
        metric=metric,
        positives=positives_of(*[[]] * 5),
        depth=5,
        run=Run(memory_bytes),
    )
    scores = similarities(queries.astype(np.longdouble), gallery, metric)
    assert ranking.tiles.tolist() == np.argsort(-scores, axis=1)[:, :20].tolist()


def crowded_case(metric):
    """Some queries have a crowd of equal tiles at the top, others not; positives among them."""
    rng = np.random.default_rng(7)
    gallery = rng.standard_normal((3_000, 24)).astype(np.float32)
    queries = rng.standard_normal((9, 24)).astype(np.float32)
    for query in range(4):
        copies = rng.choice(3_000, 400, replace=False)
        gallery[copies] = 3 * queries[query] / np.linalg.norm(queries[query])
    positives = random_positives(rng, 9, 3_000, most=600)
    return queries, gallery, {"metric": metric, "k": 25, "positives": positives, "depth": 5}


@pytest.mark.parametrize("metric", METRICS)
def test_crowds_agree_with_a_plain_sort(metric):
    queries, gallery, options = crowded_case(metric)
    found = rank_by_descriptors(queries, gallery, **options, run=Run(1 << 16))
    # Rounded, since the plain sums of equal tiles need not be equal.
    scores = similarities(queries, gallery, metric).round(9)
    assert_is(found, naive(scores, options["positives"], 25, 5))


@pytest.mark.parametrize("metric", METRICS)
def test_result_does_not_depend_on_the_order_of_the_gallery(metric):
    queries, gallery, options = crowded_case(metric)
    gallery += np.random.default_rng(1).normal(0, 1e-4, gallery.shape).astype(np.float32)
    expected = rank_by_descriptors(queries, gallery, **options)
    order = np.random.default_rng(2).permutation(len(gallery))
    options["positives"] = positives_of(*[[]] * 9)
    found = rank_by_descriptors(queries, gallery[order], **options)
    assert np.array_equal(order[found.tiles], expected.tiles)


@pytest.mark.parametrize("metric", METRICS)
def test_result_does_not_rest_on_the_bound(metric, monkeypatch):
    # With a bound that is far too small the errors seen exceed it, and it is widened.
    queries, gallery, options = crowded_case(metric)
    gallery += np.random.default_rng(1).normal(0, 1e-7, gallery.shape).astype(np.float32)
    expected = rank_by_descriptors(queries, gallery, **options)
    bounds = search.error_bounds
    monkeypatch.setattr(search, "error_bounds", lambda *how: bounds(*how) / 1e5)
    found = rank_by_descriptors(queries, gallery, **options)
    assert np.array_equal(found.tiles, expected.tiles)
