"""Queries that are ranked some at a time give the bytes that they give all at once."""

from __future__ import annotations

import pickle
import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from airzoo_bench.engines.engine import Engine
from airzoo_bench.evaluation.track import Run
from airzoo_bench.retrieval import ranking
from airzoo_bench.retrieval.ranking import rank_by_descriptors
from tests.retrieval.ranking_support import METRICS, random_positives


@dataclass
class Shuffled(Engine):
    """Does tasks out of order and twice, on pickled copies."""

    seed: int = 0
    distributed = True

    def map(
        self,
        work: Callable[[Any, Any], Any],
        items: Sequence[Any],
        *,
        shared: Any,
        stage: str,
        name: Callable[[Any], str],
    ) -> Iterator[Any]:
        assert stage
        assert all(map(name, items))
        tasks = [pickle.dumps((shared, item)) for item in items]
        order = list(range(len(tasks)))
        random.Random(self.seed).shuffle(order)
        done = {}
        for index in order * 2:
            done[index] = pickle.dumps(work(*pickle.loads(tasks[index])))  # noqa: S301 - our own
        return iter([pickle.loads(done[index]) for index in range(len(tasks))])  # noqa: S301


DTYPES = [np.float16, np.float32, np.float64]


def gallery_of(kind, rng, n_tiles, length, dtype):
    """Tiles that tie near and far, of which many are crowds, or none is."""
    if kind == "lattice":
        return rng.integers(-2, 3, (n_tiles, length)).astype(dtype)
    rows = rng.standard_normal((n_tiles, length))
    if kind == "blank":  # most tiles are one, as the sea is; some elsewhere answer better
        rows[rng.random(n_tiles) < 0.8] = rows[0]
    if kind == "run":
        rows[n_tiles // 3 : n_tiles // 3 * 2] = rows[n_tiles // 3 : n_tiles // 3 + 1]
    if kind == "close":  # below the resolution of float32
        rows = rows[:1] + 1e-8 * rows
    if kind == "equal":
        rows[:] = rows[:1]
    return rows.astype(dtype)


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    kind=st.sampled_from(["lattice", "plain", "blank", "run", "close", "equal"]),
    n_tiles=st.sampled_from([1, 2, 7, 60, 300, 900]),
    length=st.sampled_from([1, 3, 24]),
    k=st.sampled_from([1, 3, 10, 70]),
    depth=st.sampled_from([1, 5]),
    metric=st.sampled_from(METRICS),
    memory_bytes=st.sampled_from([1 << 12, 1 << 16, 1 << 30]),
    dtype=st.sampled_from(DTYPES),
    most=st.sampled_from([1, 2, 5, 12]),
)
def test_any_cut_gives_the_same_bytes(
    seed, kind, n_tiles, length, k, depth, metric, memory_bytes, dtype, most
):
    rng = np.random.default_rng(seed)
    gallery = gallery_of(kind, rng, n_tiles, length, dtype)
    if metric == "cosine":
        gallery[~gallery.any(axis=1)] = 1
    queries = rng.integers(-2, 3, (12, length)).astype(dtype) + (rng.random((12, length)) < 0.5)
    queries = np.where(queries.any(axis=1, keepdims=True), queries, 1).astype(dtype)
    queries[0] = gallery[-1]
    options = {
        "k": k,
        "metric": metric,
        "positives": random_positives(rng, 12, n_tiles),
        "depth": depth,
    }
    expected = rank_by_descriptors(queries, gallery, **options)
    engine = Shuffled(seed)
    with mock.patch.object(ranking, "_SENT_QUERIES", most):
        found = rank_by_descriptors(
            queries, gallery, **options, run=Run(memory_bytes, engine=engine)
        )
    assert found.tiles.tobytes() == expected.tiles.tobytes()
    assert found.tie_dependent.tobytes() == expected.tie_dependent.tobytes()


@pytest.mark.parametrize("metric", METRICS)
def test_rows_of_a_file_are_read_where_they_lie(metric, tmp_path):
    rng = np.random.default_rng(3)
    gallery = rng.standard_normal((3_000, 64)).astype(np.float32)
    gallery[1_000:1_500] = gallery[7]
    queries = gallery[[5, 7, 1_200, 2_999]] + 0.1
    np.save(tmp_path / "gallery.npy", gallery)
    mapped = np.load(tmp_path / "gallery.npy", mmap_mode="r")
    options = {
        "k": 30,
        "metric": metric,
        "positives": random_positives(rng, 4, 3_000),
        "depth": 5,
    }
    expected = rank_by_descriptors(queries, gallery, **options)
    found = rank_by_descriptors(queries, mapped, **options, run=Run(1 << 20))
    assert found.tiles.tobytes() == expected.tiles.tobytes()
