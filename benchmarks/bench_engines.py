"""Engines side by side: the overhead of a task, and of Dask over threads for the work of a track.

Usage: ``python benchmarks/bench_engines.py [--large] [--folder DIR]``

First 10,000 tasks of next to no work, on two processes and on two workers of Dask. Then the same
work by ``--jobs 2`` in this process and by two workers of Dask: an evaluation of descriptors, the
poses of queries from their matches, opened and prepared as `eval` does it. ``--large`` takes 1,000
x 100,000 x 8,448 (3.4 GB of descriptors), and 351 queries x 5,000 matches of which half are wrong.
Answers must be the same bytes.

Both do it twice, since the first time imports libraries and reads files that are on the disk. Each
track has a cluster of its own; what starting it takes stands apart. Printed are wall seconds, the
processor seconds of this process, and Dask's seconds over those of the threads: the second time,
the first time, and the first time with the start of the cluster.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Hashable
from operator import add
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from airzoo_bench.engines.dask import local_cluster
from airzoo_bench.engines.engine import Processes
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.evaluation.track import Run
from airzoo_bench.matching.solving import solve_queries
from tests.matching.pose_support import SOLVER, fingerprint, joined, make_scene
from tests.support import MadeScene, made_protocol, write_benchmark

TASKS = 10_000
WORKERS = 2
MEMORY = 4 << 30
NAME = "engines"


class Sizes(NamedTuple):
    """Of the inputs of two tracks."""

    descriptors: tuple[int, int, int]
    matches: tuple[int, int]


LARGE = Sizes((1_000, 100_000, 8_448), (351, 5_000))
SMALL = Sizes((200, 20_000, 512), (40, 500))

Work = Callable[[Run], Hashable]
"""Does the work of a track, and returns what must be the same on any engine."""


def timed(work: Callable[[], object]) -> tuple[float, float, object]:
    """Return wall seconds, processor seconds of this process and its dead children, the result."""
    wall, cpu = time.perf_counter(), _cpu_s()
    found = work()
    return time.perf_counter() - wall, _cpu_s() - cpu, found


def _cpu_s() -> float:
    both = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(one.ru_utime + one.ru_stime for one in both)


def bench_tasks() -> None:
    """Time tasks that do next to nothing."""
    print(f"{TASKS:,} tasks of next to no work")
    with local_cluster(WORKERS, MEMORY) as dask:
        for name, engine in (("two processes", Processes(WORKERS)), ("two workers of Dask", dask)):
            ask = {"shared": 1, "stage": "tasks", "name": str}
            wall, cpu, found = timed(
                lambda engine=engine, ask=ask: list(engine.map(add, range(TASKS), **ask))
            )
            assert found == list(range(1, TASKS + 1))
            print(f"  {name:28} {wall:7.2f} s, here {cpu:6.2f} s of processors")


def bench_track(label: str, work: Work) -> None:
    """Time the work of a track in two threads and on two workers, and print the ratios."""
    print(label, flush=True)
    here = [_shown("--jobs 2", work, Run(MEMORY, WORKERS)) for _ in range(2)]
    start = time.perf_counter()
    with local_cluster(WORKERS, MEMORY) as dask:
        start = time.perf_counter() - start
        print(f"  {'start of the cluster':28} {start:7.2f} s")
        there = []
        for _ in range(2):
            there.append(_shown("--engine dask", work, Run(MEMORY, 1, engine=dask)))
    assert len({found for _, found in (*here, *there)}) == 1, "the answers differ"
    (first, again), (dask_first, dask_again) = ([wall for wall, _ in of] for of in (here, there))
    print(
        f"  Dask over threads: {dask_again / again:.3f}; the first time {dask_first / first:.3f}, "
        f"with the start of the cluster {(start + dask_first) / first:.3f}",
        flush=True,
    )


def _shown(name: str, work: Work, run: Run) -> tuple[float, Hashable]:
    wall, cpu, found = timed(lambda: work(run))
    print(f"  {name:28} {wall:7.2f} s, here {cpu:6.2f} s of processors", flush=True)
    return wall, found


def made_descriptors(home: Path, queries: int, tiles: int, dimensions: int) -> tuple[Path, Path]:
    """Make a benchmark of one scene, and descriptors for it."""
    random = np.random.default_rng(0)
    positives = [sorted(random.choice(tiles, 4, replace=False).tolist()) for _ in range(queries)]
    scene = MadeScene("made", positives, tiles)
    data = write_benchmark(home / NAME, made_protocol([scene], NAME), [scene])
    gallery = np.empty((tiles, dimensions), np.float32)
    for row in range(0, tiles, 4096):
        random.standard_normal(out=(block := gallery[row : row + 4096]), dtype=np.float32)
        block /= np.linalg.norm(block, axis=1, keepdims=True)
    asked = random.standard_normal((queries, dimensions), dtype=np.float32)
    np.savez(
        home / "descriptors.npz",
        protocol=np.array(f"{NAME}-retrieval"),
        query_ids=np.array(scene.query_ids),
        gallery_ids=np.array(scene.tile_ids),
        query_descriptors=asked / np.linalg.norm(asked, axis=1, keepdims=True),
        gallery_descriptors=gallery,
    )
    return home / "descriptors.npz", data


def retrieval(home: Path, sizes: Sizes) -> Work:
    """Return the evaluation of descriptors."""
    predictions, data = made_descriptors(home, *sizes.descriptors)

    def work(run: Run) -> bytes:
        run = evaluate(predictions, track="retrieval", data=data, run=run)
        return run.records.to_csv(index=False).encode()

    return work


def matching(home: Path, sizes: Sizes) -> Work:
    """Return the solving of queries, half of whose matches are wrong."""
    del home
    count, matches = sizes.matches
    queries = joined(
        [
            make_scene(seed, count=matches, noise_px=1.0, outliers=0.5).problem
            for seed in range(count)
        ]
    )

    def work(run: Run) -> Hashable:
        return (*map(fingerprint, solve_queries(queries, SOLVER, run)),)

    return work


TRACKS = {"retrieval": retrieval, "matching": matching}


def main() -> None:
    """Print all ratios."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--large", action="store_true", help="the sizes of the issue")
    parser.add_argument("--folder", type=Path, help="where inputs are made, and removed")
    parser.add_argument("--tracks", nargs="+", choices=TRACKS, default=list(TRACKS))
    asked = parser.parse_args()
    sizes = LARGE if asked.large else SMALL
    bench_tasks()
    for name in asked.tracks:
        with tempfile.TemporaryDirectory(dir=asked.folder) as folder:
            size = dict(zip(TRACKS, sizes, strict=True))[name]
            shape = " x ".join(f"{n:,}" for n in (size if isinstance(size, tuple) else (size,)))
            bench_track(f"{name}, {shape}", TRACKS[name](Path(folder), sizes))


if __name__ == "__main__":
    main()
