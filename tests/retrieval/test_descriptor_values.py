"""Descriptors of any size and kind: rows of a file, huge numbers, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.track import Run
from airzoo_bench.retrieval.ranking import rank_by_descriptors
from tests.retrieval.ranking_support import (
    METRICS,
    positives_of,
    similarities,
)


def test_huge_and_tiny_numbers_are_ranked():
    rng = np.random.default_rng(5)
    queries, gallery = rng.standard_normal((3, 8)), rng.standard_normal((300, 8))
    for scale in (1e-12, 1e15):
        scaled = (queries * scale, gallery * scale)
        for metric in METRICS:
            found = rank_by_descriptors(
                *scaled, k=9, metric=metric, positives=positives_of([], [], []), depth=5
            )
            order = np.argsort(-similarities(*scaled, metric), axis=1)[:, :9]
            assert found.tiles.tolist() == order.tolist()


def run(queries, gallery, metric="l2", **options):
    positives = positives_of(*[[]] * len(queries))
    return rank_by_descriptors(
        queries, gallery, k=3, metric=metric, positives=positives, depth=3, **options
    )


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("metric", METRICS)
def test_descriptors_that_are_not_finite_are_refused_by_name(value, metric, tmp_path):
    good, bad = np.ones((10, 4), np.float32), np.ones((10, 4), np.float32)
    bad[[1, 4, 5, 9], 2] = value
    names = [f"city/{i}" for i in range(10)]
    with pytest.raises(PredictionError, match="city/1, city/4, city/5") as caught:
        run(bad, good, metric, names=names)
    assert caught.value.where == "field 'query_descriptors'"
    np.save(tmp_path / "bad.npy", bad)
    for gallery in (bad, np.load(tmp_path / "bad.npy", mmap_mode="r")):
        for memory_bytes in (1 << 7, 1 << 30):
            with pytest.raises(PredictionError, match=r": .*1") as caught:
                run(good, gallery, metric, names=names, run=Run(memory_bytes))
            assert caught.value.where == "field 'gallery_descriptors'"


def test_zero_has_no_cosine():
    good, bad = np.ones((3, 4)), np.ones((3, 4))
    bad[1] = 0
    with pytest.raises(PredictionError, match=r"zero: .*1"):
        run(good, bad, "cosine")
    run(good, bad, "l2")


@pytest.mark.parametrize("metric", METRICS)
def test_a_query_of_zeros_ties_with_every_tile(metric):
    """Or by L2 it would find the shortest descriptor, which is its only positive here."""
    gallery = np.random.default_rng(0).standard_normal((5, 4))
    gallery[2] *= 0.1
    queries = np.stack([gallery[2], np.zeros(4)])
    found = rank_by_descriptors(
        queries, gallery, k=5, metric=metric, positives=positives_of([2], [2]), depth=5
    )
    assert (found.tiles[0] >= 0).all()
    assert (found.tiles[1] == -1).all()
    assert found.tie_dependent.tolist() == [False, True]


def test_descriptors_beyond_float32_are_refused():
    with pytest.raises(PredictionError, match="too large"):
        run(np.ones((1, 4)), np.array([[1.0, 1, 1, 1], [1e300, 1, 1, 1]]))
    with pytest.raises(PredictionError, match="too large"):
        run(np.array([[1e300, 1]]), np.ones((1, 2)))


def test_no_tiles_and_no_queries():
    assert run(np.ones((2, 4)), np.ones((0, 4))).tiles.tolist() == [[-1] * 3] * 2
    assert run(np.ones((0, 4)), np.ones((5, 4))).tiles.shape == (0, 3)
    assert run(np.ones((0, 4)), np.arange(20.0).reshape(5, 4)).tiles.shape == (0, 3)
