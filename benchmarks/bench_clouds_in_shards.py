"""Clouds in shards by stage: read and prepared, spilled into cells, distances by cell.

Usage: ``python benchmarks/bench_clouds_in_shards.py --points 10000000 --folder /tmp/clouds``

Two clouds of one hilly surface, ten centimetres between points, of the first 5 % far outside, as
of `bench_distances`; each in strips of 4 million points, LAZ or parquet. They are prepared (bounds,
and what is not finite) and compared as `eval` does it, on worker processes of Dask. What is made in
the folder is removed. CPU seconds of workers are those of the tasks, measured in them; peaks are of
whole processes. `--beside` scores the same clouds in one process too, with as many threads.
"""

from __future__ import annotations

import argparse
import math
import resource
import shutil
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.engines.choose import EngineKind, open_engine
from airzoo_bench.engines.engine import HERE, Engine
from airzoo_bench.formats.clouds.shards import open_shards, shards_in
from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols
from airzoo_bench.reconstruction.distances.boxes import gather, morton_order
from airzoo_bench.reconstruction.distances.clouds import CloudDistances, cloud_distances
from airzoo_bench.reconstruction.prepared import prepared
from airzoo_bench.reconstruction.regions import box_of

SHARD, SPACING, OUTSIDE = 4_000_000, 0.1, 0.05
BYTES_A_POINT = 128
MEGABYTE = 1 << 20


def strips(count: int, seed: int) -> Iterator[NDArray[np.float64]]:
    """Make a cloud, a strip of the surface at a time; of seed 0, with points far outside."""
    side = math.sqrt(count) * SPACING
    for start in range(0, count, SHARD):
        rows = min(SHARD, count - start)
        random = np.random.default_rng([seed, start])
        points = random.uniform(0.0, side, (rows, 3))
        points[:, 0] = (start + random.uniform(0.0, rows, rows)) / count * side
        x, y = points[:, 0], points[:, 1]
        points[:, 2] = 10.0 * np.sin(x / 20.0) * np.cos(y / 30.0) + random.normal(0.0, 0.05, rows)
        far = random.random(rows) < (OUTSIDE if seed == 0 else 0.0)
        points[far] = random.uniform(-10.0 * side, 10.0 * side, (np.count_nonzero(far), 3))
        yield gather(points, morton_order(points))


def write_laz(path: Path, points: NDArray[np.float64]) -> None:
    """Write points, rounded to millimetres."""
    import laspy

    header = laspy.LasHeader(point_format=0, version="1.2")
    header.scales, header.offsets = np.full(3, 1e-3), np.zeros(3)
    cloud = laspy.LasData(header)
    cloud.xyz = points
    cloud.write(path)


def write_parquet(path: Path, points: NDArray[np.float64]) -> None:
    """Write points as they are."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table(dict(zip("xyz", points.T, strict=True))), path)


WRITERS = {".laz": write_laz, ".parquet": write_parquet}


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


@dataclass(frozen=True)
class _Timed:
    """A task, and what it took."""

    work: Callable[[Any, Any], Any]

    def __call__(self, shared: Any, item: Any) -> tuple[Any, float, float]:
        begun = time.thread_time()
        result = self.work(shared, item)
        return result, time.thread_time() - begun, _peak_mb()


class Watched(Engine):
    """Another engine, its tasks timed by stage."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self.cpu_s: dict[str, float] = defaultdict(float)
        self.tasks: dict[str, int] = defaultdict(int)
        self.peak_mb = 0.0

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
        label = f"{stage}: {work.__name__.strip('_')}"
        done = self._engine.map(_Timed(work), items, shared=shared, stage=stage, name=name)
        for result, cpu_s, peak_mb in done:
            self.cpu_s[label] += cpu_s
            self.tasks[label] += 1
            self.peak_mb = max(self.peak_mb, peak_mb)
            yield result


@contextmanager
def stage(label: str) -> Iterator[None]:
    """Print what a stage took here, besides its tasks."""
    wall, cpu = time.perf_counter(), time.process_time()
    yield
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    print(f"  {label:44} {wall:9.1f} wall {cpu:9.1f} CPU of the client", flush=True)


def compared(folders: list[Path], engine: Engine, options: argparse.Namespace) -> CloudDistances:
    """Prepare and compare two clouds, as `scenes.score_geometry` does."""
    settings = load_protocol(shipped_protocols()["photos-reconstruction"]).preparation
    settings = settings.model_copy(update={"crop": "none", "voxel_m": "none", "region": "all"})
    memory = options.memory_mb * MEGABYTE
    block = memory // BYTES_A_POINT
    with stage("opened"):
        clouds = [open_shards(folder, shards_in(folder), memory) for folder in folders]
    with stage("box of the truth"):
        box_of(clouds[1], engine)
    with stage("prepared"):
        kept = [prepared(cloud, settings, None, block, engine).source for cloud in clouds]
    with stage("spilled, and distances"):
        return cloud_distances(
            *kept,
            block_points=block,
            jobs=1 if engine is not HERE else options.workers,
            engine=engine,
        )


def measured(points: int, options: argparse.Namespace) -> None:
    """Make two clouds, compare them, and print what that took."""
    counts = points, options.truth or points
    folders = [options.folder / name for name in ("prediction", "truth")]
    try:
        for seed, (folder, count) in enumerate(zip(folders, counts, strict=True)):
            folder.mkdir(parents=True)
            for number, strip in enumerate(strips(count, seed)):
                WRITERS[options.kind](folder / f"strip-{number:04}{options.kind}", strip)
        size = sum(path.stat().st_size for folder in folders for path in shards_in(folder))
        print(f"{counts[0]:,} against {counts[1]:,} points, {size / MEGABYTE:,.0f} MB", flush=True)
        sums = [_on_dask(folders, options)]
        if options.beside:
            with stage("all, in one process"):
                sums.append(_sums(compared(folders, HERE, options)))
            assert sums[0] == sums[1]
        print(f"  sums of distances {sums[0]}; peak of the client {_peak_mb():,.0f} MB")
    finally:
        for folder in folders:
            shutil.rmtree(folder, ignore_errors=True)


def _on_dask(folders: list[Path], options: argparse.Namespace) -> tuple[float, float]:
    memory = options.memory_mb * MEGABYTE
    with open_engine(
        EngineKind.DASK, options.scheduler, jobs=options.workers, memory_bytes=memory
    ) as engine:
        watched = Watched(engine)
        with stage(f"all, on {options.workers} workers"):
            found = _sums(compared(folders, watched, options))
    for label, cpu_s in watched.cpu_s.items():
        print(f"  {label:44} {watched.tasks[label]:9,} tasks {cpu_s:8.1f} CPU of workers")
    print(f"  peak of a worker {watched.peak_mb:,.0f} MB")
    return found


def _sums(distances: CloudDistances) -> tuple[float, float]:
    return math.fsum(distances.to_truth), math.fsum(distances.to_prediction)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, nargs="+", default=[10_000_000], help="of each cloud")
    parser.add_argument("--truth", type=int, default=0, help="points of the truth, if others")
    parser.add_argument("--kind", choices=sorted(WRITERS), default=".laz")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--memory-mb", type=int, default=2048, help="of each worker")
    parser.add_argument("--scheduler", help="an address, else one of its own")
    parser.add_argument("--folder", type=Path, required=True, help="for the shards")
    parser.add_argument("--beside", action="store_true", help="in one process, too")
    options = parser.parse_args()
    for points in options.points:
        measured(points, options)


if __name__ == "__main__":
    main()
