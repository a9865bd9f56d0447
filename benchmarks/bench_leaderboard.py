"""Rank ranges of many methods, and the board of as many submissions, from nothing and again.

Usage: ``python benchmarks/bench_leaderboard.py [--small]``

The queries are those of UAV-VisLoc: 6,742 in 11 scenes. The peer is the suite's own paired test,
timed on some pairs and counted up to all of them.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from airzoo_bench.statistics.pair_tests import (
    correct_pairs,
    pair_p_values,
    rank_ranges,
    resamples_for,
)
from airzoo_bench.statistics.samples import ResamplingConfig, Sample
from airzoo_bench.statistics.significance import paired_permutation
from tests.leaderboard.site.support import COLUMNS, method, write_version
from tests.statistics.support import HIT

SCENES = {f"{number:02}": 613 if number < 11 else 612 for number in range(1, 12)}
FEW = {"01": 40, "02": 30}


def made(count: int, sizes: dict[str, int]) -> Sample:
    """Return hits of methods of all skills."""
    random = np.random.default_rng(0)
    parts = []
    for size in sizes.values():
        ease = random.normal(size=size) + 0.7 * random.normal(size=(count, size))
        parts.append((ease + np.linspace(-1, 1, count)[:, None] > 0).astype(np.float64))
    return Sample("query", tuple(sizes), tuple(parts), np.zeros(count, bool), np.ones(count, bool))


def ranks(count: int, sizes: dict[str, int]) -> None:
    """Time the rank ranges of one score, and the same tests pair by pair."""
    sample, resampling = made(count, sizes), ResamplingConfig(resamples_for(count))
    start = time.perf_counter(), time.process_time()
    p_values = pair_p_values(sample, resampling)
    values = np.mean([part.mean(axis=1) for part in sample.values], axis=0)
    rank_ranges(values, correct_pairs(p_values), higher_is_better=True)
    wall, cpu = time.perf_counter() - start[0], time.process_time() - start[1]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    pairs = [(0, other) for other in range(1, min(count, 50))]
    start = time.perf_counter(), time.process_time()
    paired_permutation(sample, resampling, pairs)
    other = (time.process_time() - start[1]) / len(pairs) * count * (count - 1) / 2
    print(f"rank ranges of {count} methods: {wall:.2f} s, CPU {cpu:.2f} s, peak {peak:.0f} MB")
    print(f"paired tests of every two, pair by pair: CPU {other:.1f} s, {other / cpu:.0f} times\n")


def board(count: int, sizes: dict[str, int]) -> None:
    """Time the command that builds a board: from nothing, again, and with one changed."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        more = HIT.model_copy(update={"key": "recall@3", "title": "R@3"})
        columns = (*COLUMNS[:2], more, COLUMNS[2])
        for number in range(count):
            one = method(f"Method {number}", 0.2 + 0.6 * number / count, sizes, columns)
            write_version(root / "runs", f"m{number}", 1, one)
        for what in ("from nothing", "nothing changed", "one changed"):
            if what == "one changed":
                one = method("Method 0", 0.5, sizes, columns, seed=1)
                write_version(root / "runs", "m0", 2, one)
            print(f"board of {count} submissions, {what}: {built(root)}")


def built(root: Path) -> str:
    """Build in a process and return what it took."""
    command = [sys.executable, "-m", "airzoo_bench", "leaderboard", "build", "--runs", "runs"]
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run([*command, "--out", "site"], cwd=root, check=True, stdout=subprocess.DEVNULL)
    wall, used = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime
    return f"{wall:.1f} s, CPU {cpu:.1f} s, peak {used.ru_maxrss / 1024:.0f} MB"


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--small", action="store_true")
    small = parser.parse_args().small
    ranks(*((20, FEW) if small else (500, SCENES)))
    board(*((10, FEW) if small else (500, SCENES)))


if __name__ == "__main__":
    main()
