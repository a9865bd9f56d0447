"""Retrieval from Python: the records of the track, which oracles hold, and edges."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pandas as pd
import pytest

import airzoo_bench as ab
from airzoo_bench.retrieval.metrics import ap_name
from tests.retrieval.ranking_support import rank, records_of
from tests.support import made_protocol, made_truth, write_predictions

KS = (1, 3, 5)
SHARED = ("map", "mrr", "answered", "positives", "tie_dependent", "first_hit_rank", "ndcg@5")
SHARED += tuple(f"recall@{k}" for k in KS)


def assert_alike(found: ab.Scores, records: pd.DataFrame, *more: str) -> None:
    """Hold all that both have to the last bit."""
    for name in (*SHARED, *more):
        assert found.records[name].tolist() == records[name].tolist(), name
    assert len(records) == len(found.records) > 2


@pytest.mark.parametrize("ap", ["precision", "min", "trec", "hits"])
def test_ranked_ids_score_as_in_the_track(data, scenes, tmp_path, ap) -> None:
    scene, random = scenes[0], np.random.default_rng(3)
    lists = [random.permutation(scene.tile_ids)[:8].tolist() for _ in scene.positives]
    arrays = {"query_ids": scene.query_ids[:-1], "ranked_ids": lists[:-1]}
    path = write_predictions(tmp_path / "method.npz", "made-retrieval", **arrays)
    records = ab.evaluate(path, data=data).records
    records = records[records["scene"] == scene.id].reset_index(drop=True)
    positives = [[scene.tile(tile) for tile in found] for found in scene.positives]
    found = ab.retrieval_scores([*lists[:-1], []], positives, KS, ap=ap)
    assert_alike(found, records, ap_name(5, ap))
    assert found["without_answer"] == 1
    assert found["recall@5"] == records["recall@5"].mean()
    assert 0 < found["map"] < 1
    both = zip([*lists[:-1], []], positives, strict=True)
    hits, counts = [[tile in right for tile in row] for row, right in both], [2] * len(lists)
    assert ab.recall_at_k(hits, 5) == found["recall@5"]
    assert ab.average_precision(hits, counts) == found["map"]
    assert ab.average_precision(hits, counts, 5, variant=ap) == found[ap_name(5, ap)]


@pytest.mark.parametrize("metric", ["cosine", "inner_product"])
def test_matrices_of_similarities_score_as_descriptors_in_the_track(scenes, metric) -> None:
    scene, random = scenes[0], np.random.default_rng(5)
    truth, settings = made_truth(scene), made_protocol(scenes).scores
    queries = random.integers(0, 3, (len(scene.positives), 3)) + 0.5
    gallery = random.integers(0, 3, (scene.n_tiles, 3)) + 0.5
    if metric == "cosine":  # lengths that are exact, so that products tie as cosines do
        queries, gallery = (np.sign(rows - 1) * 0.5 for rows in (queries, gallery))
    records = records_of(truth, rank(queries, gallery, metric, 100, 5, truth.positives), settings)
    assert records["tie_dependent"].any()
    assert_alike(
        ab.retrieval_scores(None, scene.positives, KS, scores=queries @ gallery.T), records
    )


TORCH = type("Tensor", (), {"__array__": lambda self, *_, **__: np.array([[3, 1], [5, 2]])})()
POSITIVES, TEXTS = [{1, 2}, [5]], [["c", "a"], ["e", "b"]]


@pytest.mark.parametrize(
    ("ranked", "right"),
    [
        (np.array([[3, 1], [5, 2]], np.int16), POSITIVES),
        (TORCH, tuple(POSITIVES)),
        (pd.DataFrame([[3, 1], [5, 2]]), pd.Series([[1, 2], [5]])),
        ([(3, 1), pd.Series([5, 2])], [np.array([1, 2]), frozenset({5})]),
        ([[3, 1, -1], [5, 2, -1]], POSITIVES),
        (np.array(TEXTS, object), [{"a", "b"}, pd.Series(["e"])]),
        ([["c", "a", ""], ["e", "b"]], [{"a", "b"}, ["e"]]),
    ],
)
def test_every_kind_of_ids_and_lists_gives_the_same(ranked, right) -> None:
    found = ab.retrieval_scores(ranked, right, (1, 2))
    assert [found[name] for name in ("recall@1", "recall@2", "ap@2", "mrr")] == [0.5, 1, 0.5, 0.75]


@pytest.mark.parametrize(
    ("ranked", "positives", "expected"),
    [
        # Of negative numbers -1 alone ends a list.
        ([[-5, -1], [7, -1]], [{-5}, {-4}], 0.5),
        # Ids of 64 bits are not rounded.
        ([np.array([2**63 + 1], np.uint64), np.array([-1])], [[2**63 + 1], [5]], 0.5),
        ([[2**62 + 1], [2**62 + 9], [2**63]], [[2**62 + 2], [2**62 + 10], [2**63]], 1 / 3),
        # Beyond the end of a list nothing is found.
        ([[3], []], [{1}, {5}], 0.0),
        # A query without a positive is left out.
        ([[1], [2], [3]], [{1}, set(), {9}], 0.5),
    ],
)
def test_edges_of_lists(ranked, positives, expected) -> None:
    found = ab.retrieval_scores(ranked, positives, ks=(1,))
    assert found["recall@1"] == pytest.approx(expected)
    assert found["queries"] + found["without_positive"] == len(positives)


def test_one_query_short_lists_and_a_scorer_that_finds_all_tiles_alike() -> None:
    assert ab.recall_at_k([[False, True]], 50) == 1.0
    assert ab.recall_at_k([[1], [0, 0, 1], []], 3) == 2 / 3
    assert ab.recall_at_k(np.array([[1.0, 0.0]]), 1) == 1.0
    assert ab.average_precision([[True, False]], 1) == 1.0
    assert ab.average_precision([[1, 0], [0, 0]], [2, 1], 2, variant="min") == 0.25
    found = ab.retrieval_scores(None, [[0], [1], [2]], (1, 10), scores=np.ones((3, 10)))
    assert (found["recall@10"], found["tie_dependent"]) == (0.0, 3)


def test_the_chance_level_is_the_average_over_all_orders() -> None:
    lists = [list(order) for order in permutations(range(5))]
    every = ab.retrieval_scores(lists, [range(2)] * len(lists), (1, 2, 4))
    chance = ab.chance_level([2] * 3, 5, (1, 2, 4))
    assert len(chance.scores) == 11
    assert chance.scores == pytest.approx({name: every[name] for name in chance.scores})
