"""Retrieval metrics beside ir_measures and ranx: seconds, peak memory, agreement.

From the same arrays (ranked tile indices, positives by offsets) to the same scores of each query:
recall@1, @3, @5, precision@5, AP@5, AP, reciprocal rank and nDCG@5, over 100 ranks. Every contender
runs in a process of its own, which makes the same seeded data. "Building" is what a library needs
before it can evaluate: dictionaries, its own classes, padded arrays. ranx is warmed up, so that its
compilation is not counted, and has all cores; its rankings are handed over already sorted.

Usage: python benchmarks/bench_metrics.py [--small]
"""

from __future__ import annotations

import argparse
import gc
import json
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

DEPTH = 100
N_TILES = 20_011  # a prime, so that every stride below visits all tiles
BLOCK = 50_000

T = TypeVar("T")
Scores = dict[str, NDArray[np.float64]]


class Problem(NamedTuple):
    """The arrays that everything starts from."""

    ranked: NDArray[np.int32]
    offsets: NDArray[np.int64]
    tiles: NDArray[np.int32]


class Outcome(NamedTuple):
    """What one contender took, and its scores of each query."""

    building_s: float
    evaluation_s: float
    scores: Scores


def make_problem(n_queries: int) -> Problem:
    """Distinct tiles a query, 1 to 32 positives, about one rank in twenty a hit."""
    ranked = np.empty((n_queries, DEPTH), dtype=np.int32)
    counts, tiles = [], []
    for start in range(0, n_queries, BLOCK):
        rng = np.random.default_rng([7, start])
        rows = min(BLOCK, n_queries - start)
        first = rng.integers(0, N_TILES, (rows, 1))
        stride = rng.integers(1, N_TILES, (rows, 1))
        ranked[start : start + rows] = (first + stride * np.arange(DEPTH)) % N_TILES
        count = rng.integers(1, 33, rows)
        ranks = np.cumsum(rng.geometric(0.05, (rows, 32)), axis=1) - 1
        positive = np.where(np.arange(32) < count[:, None], (first + stride * ranks) % N_TILES, -1)
        positive = np.sort(positive, axis=1)
        counts.append(count)
        tiles.append(positive[positive >= 0].astype(np.int32))
    offsets = np.concatenate(([0], np.cumsum(np.concatenate(counts))))
    return Problem(ranked, offsets, np.concatenate(tiles))


def timed(call: Callable[[], T], at_least_s: float = 1.0) -> tuple[float, T]:
    """Shortest of as many runs as fit into `at_least_s`, one at the least."""
    best, spent = np.inf, 0.0
    while spent < at_least_s:
        start = time.perf_counter()
        result = call()
        seconds = time.perf_counter() - start
        best, spent = min(best, seconds), spent + seconds
    return best, result


def run_ours(problem: Problem) -> Outcome:
    """Evaluate with this package, which has nothing to build."""
    from airzoo_bench.retrieval import metrics

    def evaluate() -> Scores:
        hits = metrics.hit_matrix(*problem, N_TILES)
        n_positives = np.diff(problem.offsets)
        return {
            "recall@1": metrics.recall_at(hits, 1),
            "recall@3": metrics.recall_at(hits, 3),
            "recall@5": metrics.recall_at(hits, 5),
            "precision@5": metrics.average_precision_at(hits, n_positives, 5, "precision"),
            "ap@5": metrics.average_precision_at(hits, n_positives, 5, "trec"),
            "ap": metrics.average_precision(hits, n_positives),
            "rr": metrics.reciprocal_rank(hits),
            "ndcg@5": metrics.ndcg_at(hits, n_positives, 5),
        }

    return Outcome(0.0, *timed(evaluate))


def as_dictionaries(
    problem: Problem,
) -> tuple[dict[str, dict[str, int]], dict[str, dict[str, float]]]:
    """TREC's nested dictionaries, built the quick way: names and scores are made once.

    Query ids sort as numbers do: ranx answers in the order of its sorted ids.
    """
    names = [f"t{tile}" for tile in range(N_TILES)]
    scores = [float(score) for score in range(DEPTH, 0, -1)]
    tiles = problem.tiles.tolist()
    bounds = problem.offsets.tolist()
    qrels, run = {}, {}
    for query, row in enumerate(problem.ranked.tolist()):
        positives = tiles[bounds[query] : bounds[query + 1]]
        qrels[f"q{query:07}"] = dict.fromkeys([names[tile] for tile in positives], 1)
        run[f"q{query:07}"] = dict(zip([names[tile] for tile in row], scores, strict=True))
    return qrels, run


def run_ir_measures(problem: Problem) -> Outcome:
    """Evaluate with ir_measures by its trec_eval provider, the fastest that has all scores."""
    import ir_measures
    from ir_measures import AP, RR, P, Success, nDCG

    names = {
        Success @ 1: "recall@1",
        Success @ 3: "recall@3",
        Success @ 5: "recall@5",
        P @ 5: "precision@5",
        AP @ 5: "ap@5",
        AP: "ap",
        RR: "rr",
        nDCG @ 5: "ndcg@5",
    }

    def build():
        qrels, run = as_dictionaries(problem)
        return ir_measures.pytrec_eval.evaluator(list(names), qrels), run

    building_s, (evaluator, run) = timed(build, 0.0001)
    evaluation_s, rows = timed(lambda: list(evaluator.iter_calc(run)))
    scores = {name: np.full(len(problem.ranked), np.nan) for name in names.values()}
    for row in rows:
        scores[names[row.measure]][int(row.query_id[1:])] = row.value
    return Outcome(building_s, evaluation_s, scores)


RANX_NAMES = {
    "hit_rate@1": "recall@1",
    "hit_rate@3": "recall@3",
    "hit_rate@5": "recall@5",
    "precision@5": "precision@5",
    "map@5": "ap@5",
    "map": "ap",
    "mrr": "rr",
    "ndcg@5": "ndcg@5",
}


def run_ranx(problem: Problem, build: Callable[[Problem], tuple[object, object]]) -> Outcome:
    """Evaluate with ranx what `build` makes of the arrays."""
    import ranx

    def evaluate(qrels: object, run: object) -> Scores:
        return ranx.evaluate(
            qrels, run, list(RANX_NAMES), return_mean=False, save_results_in_run=False
        )

    evaluate(*build(make_problem(64)))
    building_s, built = timed(lambda: build(problem), 0.0001)
    evaluation_s, scores = timed(lambda: evaluate(*built))
    return Outcome(building_s, evaluation_s, {RANX_NAMES[m]: s for m, s in scores.items()})


def ranx_objects(problem: Problem) -> tuple[object, object]:
    """Make Qrels and Run, by way of dictionaries."""
    import ranx

    qrels, run = as_dictionaries(problem)
    return ranx.Qrels(qrels), ranx.Run(run)


def ranx_arrays(problem: Problem) -> tuple[object, object]:
    """Rows (tile, score) and (tile, relevance), positives padded with rows (-1, 0)."""
    scores = np.broadcast_to(np.arange(DEPTH, 0, -1.0), problem.ranked.shape)
    run = np.stack([problem.ranked, scores], axis=-1)
    counts = np.diff(problem.offsets)
    filled = np.arange(counts.max()) < counts[:, None]
    qrels = np.tile([-1.0, 0.0], (*filled.shape, 1))
    qrels[filled, 0], qrels[filled, 1] = problem.tiles, 1.0
    return qrels, run


CONTENDERS: dict[str, Callable[[Problem], Outcome]] = {
    "airzoo-bench": run_ours,
    "ranx, arrays": lambda problem: run_ranx(problem, ranx_arrays),
    "ranx, Run and Qrels": lambda problem: run_ranx(problem, ranx_objects),
    "ir_measures": run_ir_measures,
}


def child(name: str, n_queries: int, scores_path: str) -> None:
    """Run one contender and print what it took; its scores go to a file."""
    warnings.simplefilter("ignore")
    problem = make_problem(n_queries)
    gc.disable()  # collecting among millions of live dictionaries would only burden the others
    outcome = CONTENDERS[name](problem)
    # kilobytes on Linux, bytes on macOS
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (
        1e6 if sys.platform == "darwin" else 1e3
    )
    np.savez(scores_path, **outcome.scores)
    print(json.dumps([outcome.building_s, outcome.evaluation_s, peak]))


def measure(name: str, n_queries: int, folder: Path) -> tuple[float, float, float, Scores]:
    """Run one contender in a process of its own."""
    path = folder / "scores.npz"
    command = [sys.executable, __file__, "--child", name, str(n_queries), str(path)]
    output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    building_s, evaluation_s, peak_mb = json.loads(output.splitlines()[-1])
    with np.load(path) as stored:
        return building_s, evaluation_s, peak_mb, dict(stored)


def report(n_queries: int, names: list[str], folder: Path) -> None:
    """Print a row for each contender."""
    print(f"\n{n_queries:,} queries x {DEPTH} ranks; ratios to airzoo-bench from the arrays")
    head = ("building s", "evaluation s", "peak MB", "arrays x", "evaluation x", "max |diff|")
    print(f"{'':20}" + "".join(f"{title:>14}" for title in head))
    reference: tuple[float, Scores] | None = None
    for name in names:
        building_s, evaluation_s, peak_mb, scores = measure(name, n_queries, folder)
        ours_s, ours = reference = reference or (evaluation_s, scores)
        difference = max(float(np.abs(ours[metric] - scores[metric]).max()) for metric in ours)
        print(
            f"{name:20}{building_s:14.3f}{evaluation_s:14.3f}{peak_mb:14,.0f}"
            f"{(building_s + evaluation_s) / ours_s:14.1f}{evaluation_s / ours_s:14.1f}"
            f"{'-' if scores is ours else f'{difference:.1e}':>14}",
            flush=True,
        )


def main() -> None:
    """Parse, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--small", action="store_true", help="a hundredth of the queries")
    parser.add_argument("--child", nargs=3, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child:
        name, n_queries, path = arguments.child
        child(name, int(n_queries), path)
        return
    shrink = 100 if arguments.small else 1
    with tempfile.TemporaryDirectory() as folder:
        report(100_000 // shrink, list(CONTENDERS), Path(folder))
        report(1_000_000 // shrink, ["airzoo-bench"], Path(folder))


if __name__ == "__main__":
    main()
