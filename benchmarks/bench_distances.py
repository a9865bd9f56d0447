"""Nearest distances between two clouds both ways, beside Open3D and Depth Anything 3's evaluator.

Usage: ``python benchmarks/bench_distances.py [--points N ...] [--threads N ...]``

The clouds are unsorted samples of one hilly surface, ten centimetres apart; of the first, as of a
prediction, 5 % of the points lie far outside, up to ten times the surface's side. Every line is a
process of its own that makes the same seeded clouds. Only the search is timed; the peak is that of
the whole process, and stands beside the memory of the two clouds (48 bytes a pair of points).
`--growth` repeats ours with other sizes and prints the exponent between the first and the last;
`--blocks` works clouds that are mapped from disk, made piece by piece, under a limit of its data.
Open3D takes all threads there are. Depth Anything 3's evaluator asks SciPy's KDTree as it comes, in
one thread; it is asked for one in `--share` of the points, and the time of asking is multiplied.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.reconstruction.distances import cloud_distances, mutual_distances

Floats = NDArray[np.float64]
Both = tuple[Floats, Floats]
Search = Callable[[], Both]

PIECE = 1 << 20
SPACING, OUTSIDE = 0.1, 0.05
MEGABYTE = 1 << 20
LABELS = {
    "ours": "mutual_distances",
    "open3d": "Open3D compute_point_cloud_distance",
    "scipy": "Depth Anything 3: SciPy KDTree, default",
}


def pieces(count: int, seed: int) -> Iterator[Floats]:
    """Make a cloud, a piece at a time; the first, of seed 0, has points far outside."""
    side = math.sqrt(count) * SPACING
    for start in range(0, count, PIECE):
        random = np.random.default_rng([seed, start])
        rows = min(PIECE, count - start)
        points = random.uniform(0.0, side, (rows, 3))
        x, y = points[:, 0], points[:, 1]
        points[:, 2] = 10.0 * np.sin(x / 20.0) * np.cos(y / 30.0) + random.normal(0.0, 0.05, rows)
        far = random.random(rows) < (OUTSIDE if seed == 0 else 0.0)
        points[far] = random.uniform(-10.0 * side, 10.0 * side, (np.count_nonzero(far), 3))
        yield points


@dataclass(frozen=True)
class Made:
    """A cloud that is made again whenever it is read."""

    count: int
    seed: int

    def pieces(self, points: int) -> Iterator[Cloud]:
        """Yield all points, at most so many at a time."""
        for piece in pieces(self.count, self.seed):
            for start in range(0, len(piece), points):
                yield Cloud(piece[start : start + points])


def made(count: int, seed: int) -> Floats:
    """Make a cloud whole."""
    points = np.empty((count, 3))
    start = 0
    for piece in pieces(count, seed):
        points[start : start + len(piece)] = piece
        start += len(piece)
    return points


def ours(first: Floats, second: Floats, threads: int) -> Search:
    """Both ways by the library of this repository."""
    return partial(mutual_distances, first, second, jobs=threads)


def open3d(first: Floats, second: Floats, threads: int) -> Search:
    """Both ways by Open3D, which takes all threads, from its own point clouds, ready made."""
    del threads
    from airzoo_bench.core.optional_imports import load_open3d

    o3d = load_open3d()
    one, other = (
        o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points)) for points in (first, second)
    )

    def search() -> Both:
        ways = one.compute_point_cloud_distance(other), other.compute_point_cloud_distance(one)
        return np.asarray(ways[0]), np.asarray(ways[1])

    return search


def scipy(first: Floats, second: Floats, share: int) -> dict[str, float]:
    """Time both ways as Depth Anything 3's benchmark does it, asking for one point in so many."""
    from scipy.spatial import KDTree

    clocks = time.perf_counter, time.process_time
    begun = [clock() for clock in clocks]
    trees = KDTree(second), KDTree(first)
    built = [clock() for clock in clocks]
    for tree, points in zip(trees, (first, second), strict=True):
        tree.query(points[::share])
    wall, cpu = (
        (then - start) + share * (clock() - then)
        for clock, start, then in zip(clocks, begun, built, strict=True)
    )
    return {"wall_s": wall, "cpu_s": cpu, "peak_mb": _peak_mb(), "sum": math.nan}


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def in_blocks(count: int, block_points: int, threads: int) -> Both:
    """Both ways without the clouds in memory."""
    found = cloud_distances(Made(count, 0), Made(count, 1), block_points=block_points, jobs=threads)
    return found.to_truth, found.to_prediction


CONTENDERS: dict[str, Callable[[Floats, Floats, int], Search]] = {
    "ours": ours,
    "open3d": open3d,
}


def run(name: str, options: argparse.Namespace) -> dict[str, float]:
    """Time one contender, in this process."""
    (points,), (threads,) = options.points, options.threads
    if options.limit_mb:
        limit = options.limit_mb * MEGABYTE
        resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
    if name == "blocks":
        search: Search = partial(in_blocks, points, options.block_points, threads)
    else:
        clouds = made(points, 0), made(points, 1)
        if name == "scipy":
            return scipy(*clouds, options.share)
        search = CONTENDERS[name](*clouds, threads)
    wall, used = time.perf_counter(), time.process_time()
    ways = search()
    wall, used = time.perf_counter() - wall, time.process_time() - used
    return {
        "wall_s": wall,
        "cpu_s": used,
        "peak_mb": _peak_mb(),
        "sum": math.fsum(ways[0]) + math.fsum(ways[1]),
    }


def measured(
    name: str, points: int, threads: int, options: argparse.Namespace, limit_mb: int = 0
) -> dict[str, float]:
    """Time one contender, in a process of its own."""
    command = [sys.executable, str(Path(__file__)), "--only", name, "--points", str(points)]
    command += ["--threads", str(threads), "--block-points", str(options.block_points)]
    command += ["--limit-mb", str(limit_mb), "--share", str(options.share)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    figures: dict[str, float] = json.loads(done.stdout)
    return figures


def row(label: str, points: int, figures: dict[str, float]) -> None:
    """Print one line."""
    clouds = points * 48 / MEGABYTE
    print(
        f"{label:52} {points:>11,} {figures['wall_s']:9.1f} {figures['cpu_s']:9.1f}"
        f" {figures['peak_mb']:8,.0f} {figures['peak_mb'] / clouds:7.2f}  {figures['sum']!r}",
        flush=True,
    )


def beside(points: int, options: argparse.Namespace) -> None:
    """Print ours by threads and the others, at one size, with ratios."""
    names = [name for name in LABELS if name not in (*options.without, "ours")]
    lines = [("ours", threads) for threads in options.threads]
    lines += [(name, 1 if name == "scipy" else max(options.threads)) for name in names]
    figures = [measured(name, points, threads, options) for name, threads in lines]
    for (name, threads), found in zip(lines, figures, strict=True):
        row(f"{LABELS[name]} ({threads})", points, found)
    mine = dict(zip(options.threads, figures, strict=False))
    for (name, threads), found in zip(lines, figures, strict=True):
        if name != "ours" and threads in mine:
            wall, cpu = (found[clock] / mine[threads][clock] for clock in ("wall_s", "cpu_s"))
            print(f"  {LABELS[name]}: {wall:.1f} times ours by the clock, {cpu:.1f} by CPU")


def grow(options: argparse.Namespace) -> None:
    """Print ours by size, and the exponent of its growth."""
    threads = max(options.threads)
    grown = [(points, measured("ours", points, threads, options)) for points in options.growth]
    for points, result in grown:
        row(LABELS["ours"], points, result)
    if len(grown) > 1:
        (few, little), (many, much) = grown[0], grown[-1]
        for clock in ("wall_s", "cpu_s"):
            power = math.log(much[clock] / little[clock]) / math.log(many / few)
            print(f"  grows as n^{power:.2f} ({clock})")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, nargs="+", default=[4_000_000], help="of each cloud")
    parser.add_argument("--growth", type=int, nargs="*", default=[1_000_000, 16_000_000])
    parser.add_argument("--blocks", type=int, default=10_000_000, help="of each cloud; 0 for none")
    parser.add_argument("--block-points", type=int, default=1_000_000)
    parser.add_argument("--limit-mb", type=int, default=0, help="of memory, for --blocks")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, os.cpu_count() or 1])
    parser.add_argument("--share", type=int, default=50, help="SciPy is asked for one in so many")
    parser.add_argument("--without", nargs="*", default=[], choices=sorted(LABELS))
    parser.add_argument("--only", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.only:
        print(json.dumps(run(options.only, options)))
        return
    print(
        f"{'both ways (threads)':52} {'points':>11} {'wall s':>9} {'CPU s':>9}"
        f" {'peak MB':>8} {'clouds':>7}"
    )
    for points in options.points:
        beside(points, options)
    grow(options)
    threads = max(options.threads)
    if options.blocks:
        result = measured("blocks", options.blocks, threads, options, limit_mb=options.limit_mb)
        row(f"cloud_distances, {options.block_points:,} a block", options.blocks, result)


if __name__ == "__main__":
    main()
