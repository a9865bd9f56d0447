"""Reading clouds: this package beside the library that is usual for the format.

LAZ and LAS beside laspy, PLY and PCD beside Open3D; each gives coordinates as float64 (N, 3).
Here the file is read in pieces and put together, since whole clouds are what
the others give. The best of some runs, in turn; wall and CPU seconds (all threads), so that the
first run warms the disk cache.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import laspy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from airzoo_bench.core.optional_imports import load_open3d
from airzoo_bench.formats.clouds.formats import open_cloud
from tests.formats.cloud_support import write_las, write_pcd, write_ply

PIECE = 1 << 18
LIMIT = 4 << 30


def town(count: int) -> dict[str, Any]:
    """Columns of a cloud of streets and roofs, in the order of a scan line by line."""
    random = np.random.default_rng(0)
    x, y = np.sort(random.random(count)) * 500, random.random(count) * 500
    z = 30.0 * ((np.sin(x / 9) > 0.2) & (np.sin(y / 7) > 0.1)) + random.normal(0, 0.02, count)
    columns: dict[str, Any] = {"x": x + 576_661.0, "y": y + 5_188_114.0, "z": z + 156.0}
    grey = (128 + 4 * z).clip(0, 255).astype("u1")
    return columns | {"red": grey, "green": grey, "blue": grey}


def read_ours(path: Path) -> int:
    """Read into one array."""
    source = open_cloud(path, limit_bytes=LIMIT, sampling=None)
    points, done = np.empty((source.count, 3)), 0
    for piece in source.pieces(PIECE):
        points[done : done + len(piece)] = piece.points
        done += len(piece)
    return done


def read_laspy(path: Path) -> int:
    """Read by laspy, coordinates."""
    las = laspy.read(path)
    return len(np.asarray(las.xyz))


def read_open3d(path: Path) -> int:
    """Read by Open3D."""
    cloud = load_open3d().io.read_point_cloud(str(path))
    return len(np.asarray(cloud.points))


def seconds(read: Callable[[Path], int], path: Path, count: int) -> tuple[float, float]:
    """Return wall and CPU seconds of one run."""
    wall, cpu = time.perf_counter(), time.process_time()
    if read(path) != count:
        raise SystemExit(f"{path.name}: not all points were read")
    return time.perf_counter() - wall, time.process_time() - cpu


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=2_000_000)
    parser.add_argument("--runs", type=int, default=3)
    settings = parser.parse_args()
    columns = town(settings.points)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = {
            write_las(folder / "a.laz", columns): read_laspy,
            write_las(folder / "a7.laz", columns, 7): read_laspy,
            write_las(folder / "a.las", columns): read_laspy,
            write_ply(folder / "a.ply", columns): read_open3d,
            write_pcd(folder / "a.pcd", columns, "binary"): read_open3d,
        }
        print(f"{settings.points:,} points; wall (CPU) seconds, best of {settings.runs}")
        print(f"{'file':8} {'here':>15} {'library':>15} {'ratio':>7}  library")
        for path, other in files.items():
            ours, theirs = [], []
            for _ in range(settings.runs):
                ours.append(seconds(read_ours, path, settings.points))
                theirs.append(seconds(other, path, settings.points))
            a, b = min(ours), min(theirs)
            label = other.__name__.removeprefix("read_")
            print(
                f"{path.name:8} {a[0]:7.2f} ({a[1]:5.2f}) {b[0]:7.2f} ({b[1]:5.2f}) "
                f"{a[0] / b[0]:7.2f}  {label}"
            )


if __name__ == "__main__":
    main()
