"""Retrieval from Python: the records of the track, trec_eval, edges, refusals."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import airzoo_bench as ab
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.retrieval.ranking import rank_by_descriptors
from airzoo_bench.retrieval.scoring import AP_VARIANTS, ap_name, score_scene
from tests.api.support import refused
from tests.support import MadeScene, made_protocol, made_truth, write_predictions

KS = (1, 3, 5)
SHARED = ("map", "mrr", "answered", "positives", "tie_dependent", "first_hit_rank")


def records_of_track(folder: Path, data: Path, arrays: dict[str, Any], scene: str) -> pd.DataFrame:
    path = write_predictions(folder / "method.npz", "made-retrieval", **arrays)
    run = evaluate(path, data=data)
    records = run.records
    return records[records["scene"] == scene].reset_index(drop=True)


def positives_of(scene: MadeScene) -> dict[str, list[str]]:
    return {
        scene.query(query): [scene.tile(tile) for tile in found]
        for query, found in enumerate(scene.positives)
    }


def assert_alike(found: ab.QueryScores, records: pd.DataFrame) -> None:
    """Hold all that both have to the last bit; of the track AP@5 has all its readings."""
    names = [*SHARED, *(f"recall@{k}" for k in KS), "ndcg@5"]
    for name in names:
        assert found.records[name].tolist() == records[name].tolist(), name
    assert len(records) == len(found.records) > 2


@pytest.mark.parametrize("ap", AP_VARIANTS)
def test_ranked_ids_score_as_in_the_track(
    data: Path, scenes: list[MadeScene], tmp_path: Path, ap: Any
) -> None:
    scene = scenes[0]
    random = np.random.default_rng(3)
    lists = [random.permutation(scene.tile_ids)[:8].tolist() for _ in scene.positives]
    arrays = {"query_ids": scene.query_ids[:-1], "ranked_ids": lists[:-1]}
    records = records_of_track(tmp_path, data, arrays, scene.id)
    ranked = dict(zip(scene.query_ids[:-1], lists, strict=False))
    found = ab.retrieval_scores(ranked, positives_of(scene), KS, ap=ap)
    assert_alike(found, records)
    assert found.records["query"].tolist() == records["query"].tolist()
    assert found.records[ap_name(5, ap)].tolist() == records[ap_name(5, ap)].tolist()
    assert found.counts["without_answer"] == 1
    assert found["recall@5"] == records["recall@5"].mean()
    assert 0 < found["map"] < 1


def test_ties_are_broken_as_in_the_track(
    data: Path, scenes: list[MadeScene], tmp_path: Path
) -> None:
    scene = scenes[0]
    random = np.random.default_rng(4)
    similar = np.sort(random.integers(0, 4, (len(scene.positives), 7)), axis=1)[:, ::-1] / 4
    lists = [random.permutation(scene.tile_ids)[:7].tolist() for _ in scene.positives]
    arrays = {"query_ids": scene.query_ids, "ranked_ids": lists, "scores": similar}
    records = records_of_track(tmp_path, data, arrays, scene.id)
    right = list(positives_of(scene).values())
    tiles = np.array(scene.tile_ids)
    found = ab.retrieval_scores(lists, right, KS, scores=similar, gallery_ids=tiles[::-1])
    # The track fills up what a list ties with to 100 ranks, this to its own length.
    names = [f"recall@{k}" for k in KS]
    assert found.records[names].equals(records[names])
    assert found.records["tie_dependent"].tolist() == records["tie_dependent"].tolist()
    assert found.counts["tie_dependent"] > 1


def test_trec_eval_agrees() -> None:
    pytrec_eval = pytest.importorskip("pytrec_eval")
    random = np.random.default_rng(6)
    ranked = [random.permutation(40)[:12].tolist() for _ in range(50)]
    positives = [set(random.permutation(40)[: 1 + q % 7].tolist()) for q in range(50)]
    found = ab.retrieval_scores(ranked, positives, (1, 5, 10), ap="trec")
    qrels = {f"{q}": {f"{t}": 1 for t in right} for q, right in enumerate(positives)}
    run = {f"{q}": {f"{t}": 99.0 - r for r, t in enumerate(row)} for q, row in enumerate(ranked)}
    names = {"map": "map", "recip_rank": "mrr"}
    for k in (1, 5, 10):
        names |= {f"success_{k}": f"recall@{k}", f"map_cut_{k}": f"ap@{k}/trec"}
        names |= {f"ndcg_cut_{k}": f"ndcg@{k}"}
    measures = {"map", "recip_rank", "success.1,5,10", "map_cut.1,5,10", "ndcg_cut.1,5,10"}
    theirs = pd.DataFrame(pytrec_eval.RelevanceEvaluator(qrels, measures).evaluate(run)).T
    for name, ours in names.items():
        values = theirs[name].to_numpy()
        np.testing.assert_allclose(found.records[ours], values, atol=1e-12, err_msg=ours)
        assert len(np.unique(values)) > 1
    hits = [[t in right for t in row] for row, right in zip(ranked, positives, strict=True)]
    counts = [len(right) for right in positives]
    assert ab.recall_at_k(hits, 5) == found["recall@5"]
    assert ab.average_precision(hits, counts) == found["map"]
    assert ab.average_precision(hits, counts, 5) == found["ap@5/trec"]


def test_every_kind_of_ids_and_lists_gives_the_same() -> None:
    torch = type("Tensor", (), {"__array__": lambda self, *_, **__: np.array([[3, 1], [5, 2]])})()
    positives = [{1, 2}, [5]]
    expected = ab.retrieval_scores([[3, 1], [5, 2]], positives, (1, 2)).scores
    assert expected["recall@1"] == 0.5
    texts = [["c", "a"], ["e", "b"]]
    forms: list[tuple[Any, Any]] = [
        (np.array([[3, 1], [5, 2]], np.int16), positives),
        (torch, tuple(positives)),
        (pd.DataFrame([[3, 1], [5, 2]]), pd.Series([[1, 2], [5]])),
        ([(3, 1), pd.Series([5, 2])], [np.array([1, 2]), frozenset({5})]),
        ({"x": [3, 1], "y": [5, 2]}, {"x": {1, 2}, "y": [5]}),
        ([[3, 1, -1], [5, 2, -1]], positives),
        (texts, [{"a", "b"}, ["e"]]),
        (np.array(texts, object), [{"a", "b"}, pd.Series(["e"])]),
        ([["c", "a", ""], ["e", "b"]], [{"a", "b"}, ["e"]]),
    ]
    for ranked, right in forms:
        assert ab.retrieval_scores(ranked, right, (1, 2)).scores == expected
    # Of negative numbers -1 alone ends a list.
    assert ab.retrieval_scores([[-5, 3, -1], [7, -1]], [{3}, {-5}], (1, 2))["recall@2"] == 0.5
    # Lists that end: beyond them nothing is found.
    short = ab.retrieval_scores([[3], []], [{1}, {5}], (1, 5))
    assert (short["recall@5"], short.counts["without_answer"]) == (0.0, 1)


def test_queries_without_a_positive_are_left_out_or_misses_and_counted_either_way() -> None:
    ranked, positives = [[1], [2], [3]], [{1}, set(), {9}]
    left_out = ab.retrieval_scores(ranked, positives, (1,))
    assert (left_out["recall@1"], left_out.counts["queries"]) == (0.5, 2)
    assert left_out.counts["without_positive"] == 1
    assert left_out.records["query"].tolist() == [0, 2]
    missed = ab.retrieval_scores(ranked, positives, (1,), without_positive="miss")
    assert (missed["recall@1"], missed.counts["queries"]) == (1 / 3, 3)
    refused(ab.retrieval_scores, ranked, [[], [], []], where="positives")
    refused(ab.retrieval_scores, [], [], where="positives")


def test_one_query_and_lists_shorter_than_k() -> None:
    assert ab.recall_at_k([False, True], 1) == 0.0
    assert ab.recall_at_k([False, True], 50) == 1.0
    assert ab.recall_at_k([[1], [0, 0, 1], []], 3) == 2 / 3
    assert ab.recall_at_k(np.array([[1.0, 0.0]]), 1) == 1.0
    assert ab.average_precision([True, False], 1) == 1.0
    assert ab.average_precision([[1, 0], [0, 0]], [2, 1], 2, variant="min") == 0.25


def test_mistakes_in_hits_are_refused() -> None:
    recall, ap = ab.recall_at_k, ab.average_precision
    for hits in ([[2, 0]], [[0.5]], [[np.nan]], [], np.zeros((0, 3)), [["a"]], np.zeros((1, 1, 1))):
        refused(recall, hits, 1, where="hits")
    for k in (0, -1, 1.5, True, None, "1"):
        assert "from 1 to" in refused(recall, [1, 0], k, where="k")
    # Fewer positives than hits would lift AP above 1.
    for count in (1, 0, [2, 2], 1.0, [[2]]):
        refused(ap, [1, 1], count, where="n_positives")
    refused(ap, [0, 0], 0, where="n_positives")
    assert "'trec'" in refused(ap, [1], 1, variant="coco", where="variant")


@pytest.mark.parametrize(
    ("ranked", "positives", "options", "where"),
    [
        ([[1]], [{1}, {2}], {}, "ranked_ids"),
        ([["1"]], [{1}], {}, "ids"),
        ([[1, "1"]], [{1}], {}, "ranked_ids[0]"),
        ([[1.0]], [{1}], {}, "ranked_ids[0]"),
        ([[True]], [{1}], {}, "ranked_ids[0]"),
        ([1], [{1}], {}, "ranked_ids[0]"),
        (["t1"], [{"t1"}], {}, "ranked_ids[0]"),
        ([[None]], [{1}], {}, "ranked_ids[0]"),
        ([[1, 1]], [{1}], {}, "ranked_ids"),
        ([[-1, 1]], [{1}], {}, "ranked_ids"),
        ([[1]], [{-1}], {}, "positives"),
        ([[1]], 5, {}, "positives"),
        ("ab", ["a", "b"], {}, "ranked_ids"),
        ({"q": [1]}, [{1}], {}, "ranked_ids, positives"),
        ({"q": [1], "r": [1]}, {"q": [1]}, {}, "ranked_ids"),
        ([[1]], [{1}], {"ks": ()}, "ks"),
        ([[1]], [{1}], {"ks": (0,)}, "ks"),
        ([[1]], [{1}], {"ks": 5}, "ks"),
        ([[1]], [{1}], {"scores": 0.5, "gallery_ids": [1, 2]}, "scores"),
        ([[1]], [{1}], {"ap": "kitti"}, "ap"),
        ([[1]], [{1}], {"without_positive": "drop"}, "without_positive"),
        ([[1]], [{1}], {"scores": [[0.5]]}, "scores"),
        ([[1]], [{1}], {"scores": [[0.5, 0.1]], "gallery_ids": [1, 2]}, "scores"),
        ([[1]], [{1}], {"scores": [[np.nan]], "gallery_ids": [1, 2]}, "ranked_ids"),
        ([[1]], [{1}], {"gallery_ids": [1, 1]}, "gallery_ids"),
        ([[1]], [{2}], {"gallery_ids": [1]}, "positives"),
        ([[3]], [{1}], {"gallery_ids": [1]}, "ranked_ids"),
    ],
)
def test_mistakes_in_lists_are_refused(
    ranked: Any, positives: Any, options: dict[str, Any], where: str
) -> None:
    refused(ab.retrieval_scores, ranked, positives, where=where, **options)


@pytest.mark.parametrize("metric", ["cosine", "inner_product"])
def test_matrices_of_similarities_score_as_descriptors_in_the_track(
    scenes: list[MadeScene], metric: Any
) -> None:
    scene = scenes[0]
    truth, settings = made_truth(scene), made_protocol(scenes).scores
    random = np.random.default_rng(5)
    queries = random.integers(0, 3, (len(scene.positives), 3)) + 0.5
    gallery = random.integers(0, 3, (scene.n_tiles, 3)) + 0.5
    if metric == "cosine":  # lengths that are exact, so that products tie as cosines do
        queries, gallery = (np.sign(rows - 1) * 0.5 for rows in (queries, gallery))
    ranking = rank_by_descriptors(
        queries, gallery, k=100, metric=metric, positives=truth.positives, depth=5
    )
    records = score_scene(truth, ranking, np.ones(len(queries), bool), settings)
    similar = queries @ gallery.T
    found = ab.retrieval_scores(None, scene.positives, KS, scores=similar)
    assert_alike(found, records)
    order = random.permutation(scene.n_tiles)
    named = np.array(scene.tile_ids)[order]
    right = list(positives_of(scene).values())
    again = ab.retrieval_scores(None, right, KS, scores=similar[:, order], gallery_ids=named)
    assert again.scores == found.scores


def test_mistakes_in_similarities_are_refused() -> None:
    score = ab.retrieval_scores
    refused(score, None, [[0]], where="scores")
    refused(score, None, [[0]], scores=[[0.1, np.nan]], where="scores")
    refused(score, None, [[0]], scores=[0.1, 0.2], where="scores")
    refused(score, None, [[2]], scores=[[0.1, 0.2]], where="positives")
    refused(score, None, [[0]], scores=[[0.1, 0.2]], gallery_ids=["a"], where="scores")


def test_a_scorer_that_finds_all_tiles_alike_finds_nothing() -> None:
    found = ab.retrieval_scores(None, [[0], [1], [2]], (1, 10), scores=np.ones((3, 10)))
    assert (found["recall@10"], found.counts["tie_dependent"]) == (0.0, 3)


def test_the_chance_level_is_the_average_over_all_orders() -> None:
    lists = [list(order) for order in permutations(range(5))]
    for count in (1, 2, 5):
        every = ab.retrieval_scores(lists, [range(count)] * len(lists), (1, 2, 4))
        chance = ab.chance_level([count] * 3, 5, (1, 2, 4))
        assert chance.scores == pytest.approx({name: every[name] for name in chance.scores})
        assert set(chance.scores) == set(every.scores)
    refused(ab.chance_level, [], 5, where="n_positives")
    refused(ab.chance_level, [6], 5, where="n_positives")
    refused(ab.chance_level, [1], 5, (0,), where="ks")
