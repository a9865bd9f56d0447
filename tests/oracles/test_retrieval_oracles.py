"""Retrieval scores against trec_eval (by way of ir_measures) and ranx.

What each of them calls ours:

======================================  ==================  ============
ours                                    ir_measures         ranx
======================================  ==================  ============
``recall_at``                           Success@k           hit_rate@k
``average_precision_at``, "precision"   P@k                 precision@k
``average_precision_at``, "trec"        AP@k (map_cut)      map@k
``average_precision``                   AP (map)            map
``reciprocal_rank``                     RR                  mrr
``ndcg_at``                             nDCG@k              ndcg@k
======================================  ==================  ============

Neither defines "min" or "hits"; they follow from "trec" by their divisors. Some runs are shallower
than the deepest cut. ranx gets arrays: its other inputs take half a minute to compile.
"""

from __future__ import annotations

import numpy as np
import pytest

from airzoo_bench.retrieval import metrics
from airzoo_bench.retrieval.metrics import hit_matrix

CUTS = (1, 3, 5, 10)
TOLERANCE = 1e-12


class Problem:
    """Seeded rankings with distinct scores, as arrays and as TREC's nested dictionaries."""

    def __init__(self, depth: int) -> None:
        rng = np.random.default_rng(depth)
        n_queries, n_tiles = 60, 50
        # Positives crowd at low indices, and so do good ranks: hits from none to many.
        noise = rng.random((n_queries, n_tiles)) * rng.choice([1, 30, 300], (n_queries, 1))
        ranked = np.argsort(np.arange(n_tiles) + noise, axis=1)[:, :depth].astype(np.int32)
        counts = rng.integers(1, 16, n_queries)
        pools = [rng.permutation(25)[:count] for count in counts]
        self.ranked, self.n_positives = ranked, counts
        self.positives = [np.sort(pool).astype(np.int32) for pool in pools]
        offsets = np.concatenate(([0], np.cumsum(counts)))
        self.hits = hit_matrix(ranked, offsets, np.concatenate(self.positives), n_tiles)
        self.qrels = {
            f"q{query:02}": {f"t{tile}": 1 for tile in tiles}
            for query, tiles in enumerate(self.positives)
        }
        self.run = {
            f"q{query:02}": {f"t{tile}": float(depth - rank) for rank, tile in enumerate(row)}
            for query, row in enumerate(ranked)
        }


@pytest.fixture(params=[4, 9, 12, 25, 40])
def problem(request: pytest.FixtureRequest) -> Problem:
    return Problem(request.param)


def ours(problem: Problem) -> dict[str, np.ndarray]:
    found, count = problem.hits, problem.n_positives
    scores = {"ap": metrics.average_precision(found, count), "rr": metrics.reciprocal_rank(found)}
    for k in CUTS:
        scores[f"recall@{k}"] = metrics.recall_at(found, k)
        scores[f"precision@{k}"] = metrics.average_precision_at(found, count, k, "precision")
        scores[f"ap@{k}"] = metrics.average_precision_at(found, count, k, "trec")
        scores[f"ndcg@{k}"] = metrics.ndcg_at(found, count, k)
    return scores


def assert_agree(scores: dict[str, np.ndarray], theirs: dict[str, np.ndarray]) -> None:
    assert scores.keys() == theirs.keys()
    for name, values in scores.items():
        np.testing.assert_allclose(values, theirs[name], rtol=0, atol=TOLERANCE, err_msg=name)
        assert len(np.unique(values)) > 1, f"{name} is the same for all queries and tests nothing"


def test_ir_measures(problem: Problem) -> None:
    ir_measures = pytest.importorskip("ir_measures")
    from ir_measures import AP, RR, P, Success, nDCG

    names = {AP: "ap", RR: "rr"}
    for k in CUTS:
        names |= {Success @ k: f"recall@{k}", P @ k: f"precision@{k}"}
        names |= {AP @ k: f"ap@{k}", nDCG @ k: f"ndcg@{k}"}
    theirs = {name: np.full(len(problem.run), np.nan) for name in names.values()}
    for row in ir_measures.pytrec_eval.iter_calc(list(names), problem.qrels, problem.run):
        theirs[names[row.measure]][int(row.query_id[1:])] = row.value
    assert_agree(ours(problem), theirs)


@pytest.mark.filterwarnings("ignore:unsafe cast from uint64 to int64")
def test_ranx(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")  # sixty queries are quicker than compiling
    ranx = pytest.importorskip("ranx")
    names = {"map": "ap", "mrr": "rr"}
    for k in CUTS:
        names |= {f"hit_rate@{k}": f"recall@{k}", f"precision@{k}": f"precision@{k}"}
        names |= {f"map@{k}": f"ap@{k}", f"ndcg@{k}": f"ndcg@{k}"}
    # Rows (tile, score) and (tile, relevance); rows (-1, 0) fill up: ranx's ideal would count
    # a filler that names a positive twice.
    n_queries, depth = problem.ranked.shape
    scores = np.broadcast_to(np.arange(depth, 0, -1.0), (n_queries, depth))
    run = np.stack([problem.ranked, scores], axis=-1)
    qrels = np.tile([-1.0, 0.0], (n_queries, problem.n_positives.max(), 1))
    for row, tiles in zip(qrels, problem.positives, strict=True):
        row[: len(tiles)] = np.stack([tiles, np.ones(len(tiles))], axis=-1)
    theirs = ranx.evaluate(qrels, run, list(names), return_mean=False)
    assert_agree(ours(problem), {names[name]: values for name, values in theirs.items()})


def test_a_query_without_hits_or_without_a_run_scores_zero() -> None:
    ir_measures = pytest.importorskip("ir_measures")
    from ir_measures import AP, RR, P, Success, nDCG

    # One query ranks no positive, the other is missing from the run: all -1 in our arrays.
    qrels = {"a": {"t0": 1}, "b": {"t0": 1}}
    ranked = np.array([[1, 2], [-1, -1]], dtype=np.int32)
    found = hit_matrix(ranked, np.array([0, 1, 2]), np.array([0, 0], dtype=np.int32), 3)
    measures = [AP, RR, P @ 1, Success @ 1, nDCG @ 1]
    rows = list(ir_measures.iter_calc(measures, qrels, {"a": {"t1": 2.0, "t2": 1.0}}))
    assert len(rows) == 10
    assert {row.value for row in rows} == {0.0}
    count = np.array([1, 1])
    assert not metrics.average_precision(found, count).any()
    assert not metrics.reciprocal_rank(found).any()
    assert not metrics.ndcg_at(found, count, 1).any()
    assert not metrics.recall_at(found, 1).any()


def test_min_and_hits_follow_from_trec(problem: Problem) -> None:
    found, count = problem.hits, problem.n_positives
    for k in CUTS:
        sums = metrics.average_precision_at(found, count, k, "trec") * count
        by_min = metrics.average_precision_at(found, count, k, "min") * np.minimum(count, k)
        by_hits = metrics.average_precision_at(found, count, k, "hits") * found[:, :k].sum(axis=1)
        np.testing.assert_allclose(by_min, sums, rtol=0, atol=TOLERANCE)
        np.testing.assert_allclose(by_hits, sums, rtol=0, atol=TOLERANCE)
