"""Positives from ground points, beside shapely's STRtree from the same arrays.

Usage: ``python benchmarks/bench_positives.py [--small]``

Three galleries of two scales: a geographic map (tiles are products of lon and lat intervals), a
projected map (UTM, 2.6 degrees off its central meridian, so that rows and columns are tilted),
and the projected one shuffled, which is no grid. The tree is asked in its fastest way, for
extents without a predicate. Each side runs in a process of its own; medians of three runs.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Pairs = tuple[NDArray[np.int64], NDArray[np.int32]]

CASES = ("geographic", "projected", "shuffled")
SIZES = {"full": (100_000, 69_000.0), "small": (5_000, 9_000.0)}  # queries, side of the map in m
REPEATS = 3
GSD = 0.3


def generate(folder: Path, case: str, size: str) -> dict[str, Any]:
    """Write boxes (G, 4) and points (Q, 4, 2)."""
    n_queries, side = SIZES[size]
    rng = np.random.default_rng(0)
    boxes = np.concatenate([cut(side, px * GSD, case) for px in (1024, 512)])
    if case == "shuffled":
        boxes = rng.permutation(boxes)
    low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
    centres = rng.uniform(low, high, (n_queries, 2))
    points = centres[:, None] + rng.uniform(-0.0015, 0.0015, (n_queries, 4, 2))
    points[rng.random((n_queries, 4)) < 0.01] = np.nan
    np.savez(folder / "arrays.npz", boxes=boxes, points=points)
    return {"tiles": len(boxes)}


def cut(side: float, tile: float, case: str) -> Floats:
    """Cut a square map into tiles with half a tile's stride, the last anchored to the edge."""
    starts = np.arange(0, side - tile, tile / 2)
    x, y = np.meshgrid(np.append(starts, side - tile), -np.append(starts, side - tile))
    place = geographic if case == "geographic" else projected()
    corners = [place(x + dx, y - dy) for dx in (0, tile) for dy in (0, tile)]
    lon, lat = np.stack([c[0] for c in corners]), np.stack([c[1] for c in corners])
    sides = lon.min(axis=0), lat.min(axis=0), lon.max(axis=0), lat.max(axis=0)
    return np.stack(sides, axis=-1).reshape(-1, 4)


def geographic(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Degrees of a map in degrees."""
    return 113 + x / 98_000, 28.5 + y / 111_000


def projected() -> Callable[[Floats, Floats], tuple[Floats, Floats]]:
    """Degrees of a map in UTM zone 49."""
    from pyproj import Transformer

    transform = Transformer.from_crs(32649, 4326, always_xy=True).transform
    return lambda x, y: transform(760_000 + x, 3_150_000 + y)


def ours(points: Floats, boxes: Floats) -> Pairs:
    """Positives by this package."""
    from airzoo_bench.retrieval.positives import positives_from_points

    found = positives_from_points(points, boxes)
    return found.offsets, found.tiles


def peer(points: Floats, boxes: Floats) -> Pairs:
    """Positives by shapely's search tree."""
    import shapely

    tree = shapely.STRtree(shapely.box(*boxes.T))
    point, tile = tree.query(shapely.points(points.reshape(-1, 2)))
    query, tile = np.divmod(np.unique(point // points.shape[1] * len(boxes) + tile), len(boxes))
    counts = np.bincount(query, minlength=len(points))
    return np.concatenate([[0], np.cumsum(counts)]), tile.astype(np.int32)


def measure(folder: Path, side: str) -> dict[str, Any]:
    """Time one side; its result is kept for the comparison."""
    method = {"ours": ours, "peer": peer}[side]
    with np.load(folder / "arrays.npz") as arrays:
        points, boxes = arrays["points"], arrays["boxes"]
    method(points[:1], boxes[:1])  # imports
    seconds = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        offsets, tiles = method(points, boxes)
        seconds.append(time.perf_counter() - begin)
    np.savez(folder / f"{side}.npz", offsets=offsets, tiles=tiles)
    return {"seconds": float(np.median(seconds)), "pairs": len(tiles)}


def compare(folder: Path) -> dict[str, Any]:
    """Tell whether both sides found the same."""
    with np.load(folder / "ours.npz") as one, np.load(folder / "peer.npz") as other:
        return {"same": all(np.array_equal(one[name], other[name]) for name in other.files)}


def step(name: str, folder: Path, case: str, size: str) -> dict[str, Any]:
    """Run one step, and add the peak memory of the process."""
    if name == "generate":
        result = generate(folder, case, size)
    else:
        result = compare(folder) if name == "compare" else measure(folder, name)
    return result | {"peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024}


def in_fresh_process(name: str, folder: Path, case: str, size: str) -> dict[str, Any]:
    """Run one step in its own process."""
    options = ["--step", name, "--folder", str(folder), "--case", case, "--size", size]
    done = subprocess.run(
        [sys.executable, __file__, *options], check=True, capture_output=True, text=True
    )
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def main() -> None:
    """Run every case and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--small", action="store_true")
    for hidden in ("--step", "--folder", "--case", "--size"):
        parser.add_argument(hidden, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.step:
        print(json.dumps(step(options.step, Path(options.folder), options.case, options.size)))
        return
    size = "small" if options.small else "full"
    print(f"{SIZES[size][0]:,} queries of 4 points\n")
    print(f"{'':40}{'seconds':>9}{'peak MB':>9}{'faster':>8}{'same':>6}")
    for case in CASES:
        with tempfile.TemporaryDirectory() as name:
            steps = ("generate", "ours", "peer", "compare")
            done = {one: in_fresh_process(one, Path(name), case, size) for one in steps}
        report(case, done)


def report(case: str, done: dict[str, dict[str, Any]]) -> None:
    """Print the lines of one gallery."""
    title = f"{case}, {done['generate']['tiles']:,} tiles"
    for side, label in (("ours", "airzoo-bench"), ("peer", "STRtree")):
        ratio = done["peer"]["seconds"] / done[side]["seconds"]
        line = f"{title + ', ' + label:40}{done[side]['seconds']:9.3f}{done[side]['peak_mb']:9.0f}"
        print(f"{line}{ratio:8.1f}{'yes' if done['compare']['same'] else 'NO':>6}")


if __name__ == "__main__":
    main()
