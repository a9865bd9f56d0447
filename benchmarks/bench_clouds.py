"""Distances between clouds beside Open3D and SciPy, reading beside laspy and Open3D."""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import laspy
import numpy as np
from harness import ROOT, Case, Figures, Work, main, no_input
from numpy.typing import NDArray
from scipy.spatial import KDTree

from airzoo_bench.core.optional_imports import load_open3d
from airzoo_bench.formats.clouds.cloud import open_cloud
from airzoo_bench.reconstruction.distances import mutual_distances

sys.path.insert(0, str(ROOT))

from tests.formats.cloud_support import write_las, write_pcd, write_ply

Floats = NDArray[np.float64]
THREADS = os.cpu_count() or 1
SHARE = 50
"""SciPy answers for one point in so many; its time to answer is multiplied."""


def hills(count: int, seed: int) -> Floats:
    """Return a cloud, unsorted and ten centimetres apart.

    Of the first, as of a prediction, 5 % of the points lie up to ten times its side outside.
    """
    side, parts = math.sqrt(count) * 0.1, []
    for start in range(0, count, 1 << 20):
        random = np.random.default_rng([seed, start])
        rows = min(1 << 20, count - start)
        points = random.uniform(0.0, side, (rows, 3))
        points[:, 2] = 10 * np.sin(points[:, 0] / 20) * np.cos(points[:, 1] / 30)
        points[:, 2] += random.normal(0.0, 0.05, rows)
        far = random.random(rows) < (0.0 if seed else 0.05)
        points[far] = random.uniform(-10 * side, 10 * side, (np.count_nonzero(far), 3))
        parts.append(points)
    return np.concatenate(parts)


def summed(ways: tuple[Floats, Floats]) -> dict[str, float]:
    """Return the sum of distances, which shows whether sides agree."""
    return {"sum": math.fsum(ways[0]) + math.fsum(ways[1])}


def measure_distances(_: Path, jobs: int, points: int) -> Work:
    """Measure both ways by this package."""
    first, second = (hills(points, 0), hills(points, 1))
    return lambda: summed(mutual_distances(first, second, jobs=jobs))


def ask_open3d(_: Path, points: int) -> Work:
    """Measure both ways by Open3D, which takes all threads, from its own point clouds."""
    o3d = load_open3d()
    one, other = (
        o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud))
        for cloud in (hills(points, 0), hills(points, 1))
    )

    def work() -> dict[str, float]:
        ways = one.compute_point_cloud_distance(other), other.compute_point_cloud_distance(one)
        return summed((np.asarray(ways[0]), np.asarray(ways[1])))

    return work


def ask_scipy(_: Path, points: int) -> Work:
    """Measure a share of both ways as Depth Anything 3's evaluator does it, in one thread."""
    first, second = (hills(points, 0), hills(points, 1))

    def work() -> dict[str, float]:
        start = time.perf_counter()
        trees = KDTree(second), KDTree(first)
        built = time.perf_counter()
        for tree, asked in zip(trees, (first, second), strict=True):
            tree.query(asked[::SHARE])
        return {"whole_s": built - start + SHARE * (time.perf_counter() - built)}

    return work


def compare_scipy(figures: dict[str, Figures]) -> str:
    """Say the ratio of SciPy's time for all points to ours."""
    ours, scipy = figures.values()
    seconds = float(scipy.arrays["whole_s"])
    return f"SciPy for all points: {seconds:.1f} s, {seconds / ours.seconds:.1f} times"


def compare_sums(figures: dict[str, Figures]) -> str:
    """Say whether sums agree."""
    sums = [float(one.arrays["sum"]) for one in figures.values() if "sum" in one.arrays]
    return f"sums of distances within {max(sums) - min(sums):.1e} of {sums[0]:.6e}"


def make_file(folder: Path, write: Callable[..., Path], suffix: str, points: int) -> None:
    """Write streets and roofs, in the order of a scan line by line."""
    random = np.random.default_rng(0)
    x, y = np.sort(random.random(points)) * 500, random.random(points) * 500
    z = 30.0 * ((np.sin(x / 9) > 0.2) & (np.sin(y / 7) > 0.1)) + random.normal(0, 0.02, points)
    columns: dict[str, Any] = {"x": x + 576_661.0, "y": y + 5_188_114.0, "z": z + 156.0}
    grey = (128 + 4 * z).clip(0, 255).astype("u1")
    write(folder / f"a{suffix}", columns | {"red": grey, "green": grey, "blue": grey})


def read_cloud(folder: Path, points: int) -> Work:
    """Read by this package, in pieces that are put together."""
    (path,) = folder.glob("a.*")

    def work() -> None:
        source, done = open_cloud(path, limit_bytes=4 << 30, sampling=None), 0
        found = np.empty((source.count, 3))
        for piece in source.pieces(1 << 18):
            found[done : done + len(piece)] = piece.points
            done += len(piece)

    return work


def read_laspy(folder: Path, points: int) -> Work:
    """Read by laspy."""
    (path,) = folder.glob("a.*")
    return lambda: {"count": len(np.asarray(laspy.read(path).xyz))}


def read_open3d(folder: Path, points: int) -> Work:
    """Read by Open3D."""
    (path,), o3d = folder.glob("a.*"), load_open3d()
    return lambda: {"count": len(np.asarray(o3d.io.read_point_cloud(str(path)).points))}


def reading_case(title: str, write: Callable[..., Path], suffix: str, peer: str) -> Case:
    """Return the case of a format."""
    other = {"laspy": read_laspy, "Open3D": read_open3d}[peer]
    return Case(
        f"{{points:,}} points of {title}",
        partial(make_file, write=write, suffix=suffix),
        {peer: other, "airzoo-bench": read_cloud},
        {"points": 2_000_000},
        {"points": 100_000},
        repeats=3,
    )


CASES = {
    "distances": Case(
        "both ways between clouds of {points:,} points",
        no_input,
        {
            f"airzoo-bench, {THREADS} threads": partial(measure_distances, jobs=THREADS),
            "airzoo-bench, one thread": partial(measure_distances, jobs=1),
            "Open3D, all threads": ask_open3d,
        },
        {"points": 4_000_000},
        {"points": 200_000},
        compare_sums,
    ),
    "scipy": Case(
        f"trees of {{points:,}} points, one in {SHARE} asked (Depth Anything 3's evaluator)",
        no_input,
        {
            "airzoo-bench, all asked": partial(measure_distances, jobs=1),
            "SciPy's KDTree": ask_scipy,
        },
        {"points": 4_000_000},
        {"points": 200_000},
        compare_scipy,
    ),
    "laz": reading_case("LAZ (format 3)", write_las, ".laz", "laspy"),
    "las": reading_case("LAS", write_las, ".las", "laspy"),
    "ply": reading_case("PLY", write_ply, ".ply", "Open3D"),
    "pcd": reading_case("PCD", partial(write_pcd, data="binary"), ".pcd", "Open3D"),
}

if __name__ == "__main__":
    main(CASES)
