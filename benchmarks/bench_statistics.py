"""Intervals of many methods and scores, beside SciPy's bootstrap; and `compare` as a process.

Usage: ``python benchmarks/bench_statistics.py [--small]``

The queries are those of UAV-VisLoc: 6,442 in 11 scenes. SciPy is timed on one score of one method
in one scene with the same number of resamples, and counted up to all of them: it takes each
statistic by itself. CPU seconds, of all threads, stand beside wall seconds: they hardly depend
on what else the machine does.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn, score_columns
from airzoo_bench.results.sampling import make_sample
from airzoo_bench.retrieval.scoring import retrieval_scores
from airzoo_bench.retrieval.settings import RetrievalProtocol
from airzoo_bench.statistics.intervals import bootstrap
from airzoo_bench.statistics.samples import ResamplingConfig
from tests.statistics.support import random_methods, write_method


def uav_visloc() -> tuple[dict[str, int], tuple[ScoreColumn, ...]]:
    """Return the queries of each scene, and all scores."""
    protocol = load_protocol(shipped_protocols()["uav-visloc-retrieval"])
    if not isinstance(protocol, RetrievalProtocol):
        raise TypeError(protocol)
    sizes = {scene.id: scene.queries or 0 for scene in protocol.scenes}
    return sizes, score_columns(retrieval_scores(protocol.scores))


Seconds = tuple[float, float]


def cpu_seconds() -> float:
    """Return what this process and the ended ones that it started have used."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(part.ru_utime + part.ru_stime for part in used)


def timed(work: Callable[[], object]) -> Seconds:
    """Return wall and CPU seconds."""
    start, used = time.perf_counter(), cpu_seconds()
    work()
    return time.perf_counter() - start, cpu_seconds() - used


def ours(
    methods: list[Scored], columns: tuple[ScoreColumn, ...], plan: ResamplingConfig
) -> Seconds:
    """Time intervals of all methods, scores and scenes."""
    sample = make_sample(methods, columns)
    return timed(lambda: bootstrap(sample, plan))


def scipys(
    methods: list[Scored], columns: tuple[ScoreColumn, ...], plan: ResamplingConfig
) -> Seconds:
    """Time SciPy on one scene and mean, and count up to all."""
    from scipy.stats import bootstrap as peer

    sample = make_sample(methods[:1], columns[:1])
    first = sample.values[0][0]
    random = np.random.default_rng(0)
    wall, cpu = timed(
        lambda: peer((first,), np.mean, n_resamples=plan.resamples, batch=1_000, rng=random)
    )
    queries = sum(values.shape[1] for values in sample.values)
    times = queries / len(first) * len(methods) * len(columns)
    return wall * times, cpu * times


def command(methods: list[Scored], options: list[str]) -> Seconds:
    """Time the whole command."""
    with tempfile.TemporaryDirectory() as name:
        files = [str(write_method(Path(name) / m.name, m)) for m in methods]
        call = [sys.executable, "-m", "airzoo_bench", "compare", *files, *options]
        return timed(lambda: subprocess.run(call, check=True, capture_output=True))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--small", action="store_true")
    few = parser.parse_args().small
    sizes, columns = uav_visloc()
    plan = ResamplingConfig(resamples=1_000 if few else 10_000)
    methods = random_methods(4 if few else 20, sizes, columns)
    ten = methods[:10]
    every = [text for column in columns for text in ("--score", column.key)]
    rows = {
        f"intervals of {len(ten)} methods, airzoo-bench": ours(ten, columns, plan),
        f"intervals of {len(ten)} methods, SciPy, counted up": scipys(ten, columns, plan),
        f"compare {len(methods)} methods, 4 scores": command(methods, []),
        f"compare {len(methods)} methods, all scores": command(methods, every),
    }
    print(f"{sum(sizes.values()):,} queries, {len(sizes)} scenes, {len(columns)} scores, ", end="")
    print(f"{plan.resamples:,} resamples\n\n{'':44}{'seconds':>8}{'CPU s':>8}")
    for label, (wall, cpu) in rows.items():
        print(f"{label:44}{wall:8.2f}{cpu:8.2f}")


if __name__ == "__main__":
    main()
