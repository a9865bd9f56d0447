"""Matching as tasks where a few queries are a hundred times as hard as the others.

Usage: ``python benchmarks/bench_hard_queries.py [--small] [--workers 2 4]``

Hard queries are made of outliers, so that RANSAC draws until `max_trials`. They stand among the
others, or after all of them, which is the worst order: nothing is left to fill the time beside the
last. Every way solves the same queries: threads of this process, workers of Dask with tasks as the
suite cuts them, and with one block a worker, as a plain split would do. "Busy" is the share of
the wall time that each worker spent in tasks, the least busy first; "outside" is what is left of
the time of all workers, an idle end included. The answers must be the same to the last bit.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from airzoo_bench.engines.dask import local_cluster
from airzoo_bench.engines.engine import Engine
from airzoo_bench.evaluation.track import Run
from airzoo_bench.matching.solving import PoseEstimate, PoseQueries, solve_queries
from tests.matching.pose_support import SOLVER, fingerprint, joined, make_scene

MATCHES, EASY, HARD = 200, 2_000, 12


class Watched(Engine):
    """Notes when which process did a task, and may cut into as many blocks as there are workers."""

    def __init__(self, engine: Engine, blocks: int | None) -> None:
        self._engine, self._blocks = engine, blocks
        self.spans: dict[int, list[tuple[float, float]]] = {}

    def cut(self, count: int, size: int) -> list[slice]:
        """See `Engine.cut`."""
        return self._engine.cut(count, -(-count // self._blocks) if self._blocks else size)

    def map(
        self,
        work: Callable[[Any, Any], Any],
        items: Sequence[Any],
        *,
        shared: Any,
        stage: str,
        name: Callable[[Any], str],
    ) -> Iterator[Any]:
        """See `Engine.map`."""
        timed = partial(_timed, work)
        for result, pid, span in self._engine.map(
            timed, items, shared=shared, stage=stage, name=name
        ):
            self.spans.setdefault(pid, []).append(span)
            yield result


def _timed(work: Callable[[Any, Any], Any], shared: Any, item: Any) -> tuple[Any, int, Any]:
    begin = time.time()
    return work(shared, item), os.getpid(), (begin, time.time())


def make_queries(is_hard: np.ndarray) -> PoseQueries:
    """Make queries of which some are made of outliers."""
    scenes = [
        make_scene(seed, count=MATCHES, noise_px=1.0, outliers=1.0 if one else 0.2).problem
        for seed, one in enumerate(is_hard.tolist())
    ]
    return joined(scenes)


def timed(queries: PoseQueries, run: Run) -> tuple[float, list[PoseEstimate]]:
    """Return wall seconds and answers."""
    begin = time.perf_counter()
    found = solve_queries(queries, SOLVER, run)
    return time.perf_counter() - begin, found


def report(label: str, wall: float, watched: Watched, workers: int) -> None:
    """Print how busy workers were."""
    spent = sorted(sum(end - begin for begin, end in spans) for spans in watched.spans.values())
    spent = [0.0] * (workers - len(spent)) + spent
    busy = ", ".join(f"{one / wall:.0%}" for one in spent)
    tasks = sum(map(len, watched.spans.values()))
    outside = 1 - sum(spent) / (workers * wall)
    print(f"  {label:40}{tasks:7}{wall:9.2f}   {busy:24}{outside:8.0%}")


def run(queries: PoseQueries, workers: Sequence[int]) -> None:
    """Solve in every way and print."""
    print(f"  {'':40}{'tasks':>7}{'wall s':>9}   {'busy':24}{'outside':>8}")
    for count in workers:
        wall, reference = timed(queries, Run(jobs=count))
        print(f"  {f'this process, {count} threads':40}{1:7}{wall:9.2f}")
        with local_cluster(count, 2 << 30) as engine:
            first = [make_scene(seed).problem for seed in range(4 * count)]
            timed(joined(first), Run(engine=Watched(engine, 4 * count)))  # imports
            for label, blocks in (("tasks as cut", None), ("one block a worker", count)):
                watched = Watched(engine, blocks)
                wall, found = timed(queries, Run(engine=watched))
                report(f"Dask, {count} workers, {label}", wall, watched, count)
                if [*map(fingerprint, found)] != [*map(fingerprint, reference)]:
                    raise SystemExit("other answers")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--small", action="store_true", help="a tenth of the queries")
    parser.add_argument("--workers", type=int, nargs="+", default=[2, 4])
    given = parser.parse_args()
    easy, hard = (EASY // 10, HARD // 3) if given.small else (EASY, HARD)
    for last in (False, True):
        is_hard = np.arange(easy + hard) >= easy
        if not last:
            is_hard = np.random.default_rng(0).permutation(is_hard)
        queries = make_queries(is_hard)
        _, found = timed(queries, Run())
        spent = np.array([one.seconds for one in found])
        usual, slow = (np.median(spent[some]) for some in (~is_hard, is_hard))
        place = "after all others" if last else "among the others"
        print(
            f"{easy:,} queries of {MATCHES:,} matches, {1000 * usual:.1f} ms each, and {hard} that "
            f"take {slow / usual:.0f} times as long, {place}"
        )
        run(queries, given.workers)


if __name__ == "__main__":
    main()
