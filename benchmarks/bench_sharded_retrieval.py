"""Exact search over a gallery in shards, and its positives, as the gallery grows.

Usage: ``python benchmarks/bench_sharded_retrieval.py [--tiles N ...] [--queries N] [--workers N]``

Random descriptors are written as ``.npy`` shards of a million rows below ``--folder``, and taken
away again. Each size is searched in a process of its own, on worker processes of Dask with
``--max-memory`` each, and again in one process without Dask; both must find the same. `client`
is what the process does that hands out the shards: putting together what they kept, pruning it,
breaking ties. Positives are those of a grid of as many tiles.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.engines.engine import HERE, Engine
from airzoo_bench.retrieval.descriptor_rows import RowParts
from airzoo_bench.retrieval.pairs import Positives
from airzoo_bench.retrieval.positives import positives_from_points
from airzoo_bench.retrieval.ranking import rank_by_descriptors

K = 100
SHARD = 1_000_000
SIDE = 0.001  # of a tile, degrees


class Timed(Engine):
    """An engine that adds up how long its client waits for it, by stage."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self.seconds: dict[str, float] = {}
        self.tasks: dict[str, int] = {}
        self.result_bytes = 0

    def cut(self, count: int, size: int) -> list[slice]:
        """See `Engine.cut`."""
        return self._engine.cut(count, size)

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
        results = self._engine.map(work, items, shared=shared, stage=stage, name=name)
        self.tasks[stage] = self.tasks.get(stage, 0) + len(items)
        begin = time.perf_counter()
        for result in results:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - begin
            self.result_bytes += sum(array.nbytes for array in result.values())
            yield result
            begin = time.perf_counter()


def generate(options: argparse.Namespace) -> dict[str, Any]:
    """Write shards and queries: noisy copies of tiles of the first shard."""
    rng, most = np.random.default_rng(0), max(options.tiles)
    shape, dtype = (SHARD, options.dimensions), np.dtype(options.dtype)
    for number in range(-(-most // SHARD)):
        path = options.folder / f"{number:04d}.npy"
        rows = np.lib.format.open_memmap(path, "w+", dtype, shape)
        for start in range(0, SHARD, 10_000):
            rows[start : start + 10_000] = rng.standard_normal((10_000, shape[1]), np.float32)
    first = np.load(options.folder / "0000.npy", mmap_mode="r")
    source = np.sort(rng.choice(min(SHARD, *options.tiles), options.queries, replace=False))
    noise = rng.standard_normal((options.queries, shape[1]), np.float32)
    np.save(options.folder / "queries.npy", (first[source] + noise).astype(dtype))
    return {}


def search(options: argparse.Namespace) -> dict[str, Any]:
    """Rank one gallery, on workers or here."""
    queries, tiles = np.load(options.folder / "queries.npy"), options.tiles[0]
    maps = [
        np.load(options.folder / f"{number:04d}.npy", mmap_mode="r")[: tiles - number * SHARD]
        for number in range(-(-tiles // SHARD))
    ]
    positives = Positives(np.arange(len(queries) + 1), np.zeros(len(queries), np.int32))
    with opened(options) as (engine, peaks):
        timed, begin = Timed(engine), time.perf_counter()
        ranking = rank_by_descriptors(
            queries,
            RowParts.of(maps),
            k=K,
            metric="l2",
            positives=positives,
            depth=5,
            memory_bytes=options.max_memory,
            jobs=1,
            engine=timed,
        )
        seconds = time.perf_counter() - begin
        workers = peaks()
    return {
        "seconds": seconds,
        "client": seconds - sum(timed.seconds.values()),
        "stages": {stage: round(one, 2) for stage, one in timed.seconds.items()},
        "tasks": timed.tasks,
        "result_mb": timed.result_bytes / 1e6,
        "worker_mb": max((peak for peak, _ in workers), default=0.0),
        "cpu": sum(cpu for _, cpu in workers) + sum(resource.getrusage(resource.RUSAGE_SELF)[:2]),
        "sha256": hashlib.sha256(ranking.tiles.tobytes()).hexdigest()[:12],
    }


@contextmanager
def opened(
    options: argparse.Namespace,
) -> Iterator[tuple[Engine, Callable[[], list[tuple[float, float]]]]]:
    """Open an engine, and what tells the peak MB and the processor seconds of its workers."""
    if not options.workers:
        yield HERE, list
        return
    from distributed import Client, LocalCluster

    from airzoo_bench.engines.dask_tasks import DaskEngine

    with (
        LocalCluster(
            n_workers=options.workers,
            threads_per_worker=1,
            memory_limit=options.max_memory,
            dashboard_address=None,
        ) as cluster,
        Client(cluster) as client,
    ):
        engine = DaskEngine(client, "benchmark", "raise --max-memory")
        yield engine, lambda: list(client.run(spent).values())


def spent() -> tuple[float, float]:
    """Peak MB and processor seconds of this process."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_maxrss / 1024, used.ru_utime + used.ru_stime


def positives(options: argparse.Namespace) -> dict[str, Any]:
    """Find the positives of four points a query in a grid of tiles."""
    columns = int(np.sqrt(options.tiles[0]))
    row, column = np.divmod(np.arange(columns * (options.tiles[0] // columns)), columns)
    boxes = np.stack([column, -row - 1, column + 1, -row], axis=1) * SIDE
    rng = np.random.default_rng(0)
    points = rng.uniform((0, -columns * SIDE), (columns * SIDE, 0), (options.queries, 2))
    anchors = points[:, None] + rng.uniform(-SIDE, SIDE, (options.queries, 4, 2))
    before, begin = spent(), time.perf_counter()
    found = positives_from_points(anchors, boxes)
    after = spent()
    return {
        "seconds": time.perf_counter() - begin,
        "cpu": after[1] - before[1],
        "boxes_mb": boxes.nbytes / 1e6,
        "more_mb": after[0] - before[0],
        "pairs": len(found.tiles),
    }


STEPS = {"generate": generate, "search": search, "positives": positives}


def in_fresh_process(step: str, options: argparse.Namespace, **changes: Any) -> dict[str, Any]:
    """Run a step in its own process; a process's peak counts from its start."""
    stated = vars(options) | changes | {"step": step}
    stated["tiles"] = " ".join(map(str, stated["tiles"]))
    command = [sys.executable, __file__]
    for name, value in stated.items():
        command += [f"--{name.replace('_', '-')}", *str(value).split()]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def main() -> None:
    """Run all sizes and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tiles", type=int, nargs="+", default=[100_000, 1_000_000])
    parser.add_argument("--queries", type=int, default=1_000)
    parser.add_argument("--dimensions", type=int, default=64)
    parser.add_argument("--dtype", choices=("float16", "float32"), default="float16")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--max-memory", type=int, default=1 << 30)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--step", choices=STEPS, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.step:
        result = STEPS[options.step](options)
        print(json.dumps(result | {"peak_mb": spent()[0]}))
        return
    options.folder = Path(tempfile.mkdtemp(dir=options.folder))
    try:
        in_fresh_process("generate", options)
        report(options)
    finally:
        shutil.rmtree(options.folder)


def report(options: argparse.Namespace) -> None:
    """Measure and print."""
    print(
        f"{options.queries:,} queries, top {K}, {options.dimensions} numbers of {options.dtype}; "
        f"{options.workers} workers of {options.max_memory >> 20:,} MB\n"
    )
    print(
        f"{'tiles':>12}{'where':>9}{'wall s':>9}{'CPU s':>9}{'CPU us/tile':>13}{'client s':>10}"
        f"{'results MB':>12}{'worker MB':>11}{'client MB':>11}  ranking"
    )
    for tiles in options.tiles:
        for workers in dict.fromkeys((0, options.workers)):
            one = in_fresh_process("search", options, tiles=[tiles], workers=workers)
            print(
                f"{tiles:12,}{f'{workers} workers' if workers else 'here':>9}"
                f"{one['seconds']:9.1f}{one['cpu']:9.1f}{one['cpu'] / tiles * 1e6:13.2f}"
                f"{one['client']:10.2f}{one['result_mb']:12.1f}{one['worker_mb']:11.0f}"
                f"{one['peak_mb']:11.0f}  {one['sha256']} {one['stages']} {one['tasks']}",
                flush=True,
            )
    print(f"\n{'tiles':>12}{'CPU s':>9}{'boxes MB':>10}{'more MB':>9}{'positives':>11}")
    for tiles in options.tiles:
        one = in_fresh_process("positives", options, tiles=[tiles])
        print(
            f"{tiles:12,}{one['cpu']:9.2f}{one['boxes_mb']:10.0f}{one['more_mb']:9.0f}"
            f"{one['pairs']:11,}"
        )


if __name__ == "__main__":
    main()
