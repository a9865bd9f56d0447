"""Lifting matches through a large surface model, beside SciPy's bilinear interpolation.

Usage: ``python benchmarks/bench_lifting.py [--small] [--folder DIR]``

The surface model is a float32 GeoTIFF in tiles of 256 with holes of nodata, the matches are spread
evenly over it. Lifting reads the file by windows; SciPy's ``map_coordinates(order=1)`` is given the
whole array in memory (its reading is not timed, holes are heights to it) and pixel coordinates that
are ready made. Then a typical query: 5,000 matches within 2,000 x 2,000 pixels. Each line is a
process of its own; medians of three runs, after one that brings the file into the system's cache.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio import Affine
from rasterio.windows import Window

Floats = NDArray[np.float64]

SIZES = {"full": (20_000, 10_000_000), "small": (4_000, 400_000)}  # side in pixels, matches
QUERY = (2_000, 5_000)
TILE = 256
NODATA = -9999.0
REPEATS = 3
LABELS = {
    "lift-2": "lift, two workers",
    "lift-1": "lift, one worker",
    "scipy": "map_coordinates, array in memory",
    "scipy-read": "map_coordinates, reading included",
    "query": "lift, one query of 5,000 matches",
}


def generate(path: Path, side: int) -> None:
    """Write hills with holes, a strip of tiles at a time."""
    rng = np.random.default_rng(0)
    profile = {
        "driver": "GTiff",
        "width": side,
        "height": side,
        "count": 1,
        "dtype": "float32",
        "crs": "EPSG:32649",
        "transform": Affine(0.1, 0.0, 700_000.0, 0.0, -0.1, 3_130_000.0),
        "nodata": NODATA,
        "tiled": True,
        "blockxsize": TILE,
        "blockysize": TILE,
    }
    x = np.arange(side, dtype=np.float32)
    with rasterio.open(path, "w", **profile) as dataset:
        for top in range(0, side, TILE):
            y = np.arange(top, min(top + TILE, side), dtype=np.float32)[:, None]
            heights = 50 + 20 * np.sin(x / 700) + 15 * np.cos(y / 900)
            heights += rng.normal(0, 0.3, heights.shape).astype(np.float32)
            heights[(np.floor(x / 300) + 7 * np.floor(y / 300)) % 20 == 3] = NODATA
            dataset.write(heights, 1, window=Window(0, top, side, len(y)))


def matches(side: int, count: int) -> Floats:
    """Return map pixels spread evenly."""
    return np.random.default_rng(1).uniform(0, side, (count, 2))


def ours(path: Path, xy: Floats, workers: int) -> Callable[[], Any]:
    """Lifting, on a map of the same grid."""
    from airzoo_bench.geometry.rasters import open_info
    from airzoo_bench.matching.lifting import lift

    info = open_info(path)
    return lambda: lift(xy, info, info, jobs=workers)


def peer(path: Path, xy: Floats, *, reading: bool) -> Callable[[], Floats]:
    """SciPy's interpolation, of heights in memory or read each time."""
    from scipy.ndimage import map_coordinates

    def read() -> NDArray[np.float32]:
        with rasterio.Env(GDAL_CACHEMAX=64 << 20), rasterio.open(path) as dataset:
            return dataset.read(1)

    rowcol = np.ascontiguousarray(xy.T[::-1]) - 0.5
    kept = None if reading else read()

    def interpolate() -> Floats:
        heights = read() if kept is None else kept
        return map_coordinates(heights, rowcol, np.float64, order=1, mode="nearest")

    return interpolate


def measure(name: str, path: Path, side: int, count: int) -> dict[str, Any]:
    """Time one line of the table."""
    if name == "query":
        xy = side / 3 + matches(min(QUERY[0], side // 2), QUERY[1])
    else:
        xy = matches(side, count)
    workers = 2 if name == "lift-2" else 1
    scipy = name.startswith("scipy")
    run: Callable[[], Any] = (
        peer(path, xy, reading=name == "scipy-read") if scipy else ours(path, xy, workers)
    )
    result = run()
    seconds = []
    for _ in range(REPEATS):
        del result
        begin = time.perf_counter()
        result = run()
        seconds.append(time.perf_counter() - begin)
    points = result if scipy else result.points
    return {
        "seconds": float(np.median(seconds)),
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "sha256": hashlib.sha256(points.data).hexdigest(),
        "matches": len(xy),
    }


def in_fresh_process(name: str, path: Path, size: str) -> dict[str, Any]:
    """Measure one line in a process of its own."""
    options = ["--line", name, "--file", str(path), "--size", size]
    done = subprocess.run(
        [sys.executable, __file__, *options], check=True, capture_output=True, text=True
    )
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--small", action="store_true")
    parser.add_argument("--folder", type=Path, help="where the surface model is made")
    for hidden in ("--line", "--file", "--size"):
        parser.add_argument(hidden, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.line:
        line = measure(options.line, Path(options.file), *SIZES[options.size])
        print(json.dumps(line))
        return
    size = "small" if options.small else "full"
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        path = Path(folder) / "dsm.tif"
        generate(path, SIZES[size][0])
        report(path, size)


def report(path: Path, size: str) -> None:
    """Print a line for each way."""
    side = SIZES[size][0]
    print(f"surface model of {side:,} x {side:,} px, load {os.getloadavg()[0]:.1f}\n")
    print(f"{'':36}{'matches':>12}{'seconds':>9}{'peak MB':>9}")
    done = {name: in_fresh_process(name, path, size) for name in LABELS}
    for name, label in LABELS.items():
        line = done[name]
        print(f"{label:36}{line['matches']:12,}{line['seconds']:9.3f}{line['peak_mb']:9.0f}")
    same = done["lift-1"]["sha256"] == done["lift-2"]["sha256"]
    print(f"\nsame bytes with one and two workers: {'yes' if same else 'NO'}")
    for name in ("scipy", "scipy-read"):
        ratio = done[name]["seconds"] / done["lift-2"]["seconds"]
        print(f"{LABELS[name]} / lift: {ratio:.2f}")


if __name__ == "__main__":
    main()
