"""``prepare uav-visloc`` at the benchmark's size: 6,742 photos, 11 maps, some 97,000 tiles.

The tree is made as it is downloaded: photos of 3976 x 2652 px (one file, linked) whose places and
headings are made up, and maps of the real sizes that take no room on disk. Wall time, processor
time and peak memory of the first run, and of a second one that finds all done.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.datasets.published.uav_visloc_tree import PIXEL_DEG, Flight, make_tree

# Left, top, width and height in pixels, photos, height of flight; flight 07's map is higher here.
FLIGHTS = {
    "01": (115.970635, 29.774065, 9774, 26762, 817, 405.0),
    "02": (116.033769, 29.817376, 11482, 34291, 1071, 405.0),
    "03": (119.805926, 32.355491, 35092, 24308, 768, 466.0),
    "04": (119.90598, 32.254036, 18093, 38408, 738, 542.0),
    "05": (102.340055, 24.666899, 9394, 6144, 473, 500.0),
    "06": (109.63516, 32.373177, 8082, 9780, 344, 840.0),
    "07": (115.791182, 40.340058, 3000, 1170, 30, 300.0),
    "08": (120.136489, 30.947227, 43421, 16294, 1033, 551.0),
    "09": (120.030076, 30.999512, 44800, 33280, 734, 546.0),
    "10": (115.776356, 40.355093, 6593, 5077, 144, 772.0),
    "11": (101.013109, 38.852301, 29592, 16582, 590, 500.0),
}


def made_flights(seed: int = 0) -> dict[str, Flight]:
    """Spread each flight's photos over its map."""
    random = np.random.default_rng(seed)
    flights = {}
    for name, (left, top, width, height, photos, above) in FLIGHTS.items():
        places = random.uniform(0.1, 0.9, (photos, 2)) * (width, height) * PIXEL_DEG
        headings = random.uniform(-180.0, 180.0, photos)
        flights[name] = Flight(
            name,
            "made up",
            (left, top),
            (width, height),
            tuple(
                (left + x, top - y, above, heading)
                for (x, y), heading in zip(places.tolist(), headings.tolist(), strict=True)
            ),
            cuts=((22400,), (16640,)) if name == "09" else ((), ()),
            columns=6 if name == "07" else 10,
        )
    return flights


def make(root: Path) -> Path:
    """Make the tree, with one photo of the real size that all names lead to."""
    make_tree(root, made_flights(), photos=False)
    photo = root / "photo.jpg"
    pixels = np.random.default_rng(0).integers(0, 255, (2652 // 12, 3976 // 14, 3), np.uint8)
    Image.fromarray(pixels).resize((3976, 2652)).save(photo)
    for name, values in FLIGHTS.items():
        for index in range(values[4]):
            os.link(photo, root / name / "drone" / f"{name}_{index + 1:04d}.JPG")
    photo.unlink()
    return root


def run(source: Path, out: Path) -> tuple[float, float, float]:
    """Return wall seconds, processor seconds and peak MB of one process."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    command = ["prepare", "uav-visloc", "--source", str(source), "--out", str(out)]
    subprocess.run([sys.executable, "-m", "airzoo_bench", *command], check=True)
    wall = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = (after.ru_utime - before.ru_utime) + (after.ru_stime - before.ru_stime)
    return wall, spent, after.ru_maxrss / 1024


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tree", type=Path, help="Keep the tree here, or use the one that is.")
    parser.add_argument("--again", action="store_true", help="Run a second time.")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        tree = arguments.tree or Path(folder) / "tree"
        if not tree.exists():
            make(tree)
        out = Path(folder) / "uav-visloc"
        rows = [("first", *run(tree, out))]
        if arguments.again:
            rows.append(("second", *run(tree, out)))
    print(f"\n{'run':<8}{'wall s':>8}{'CPU s':>8}{'peak MB':>9}")
    for name, wall, spent, peak in rows:
        print(f"{name:<8}{wall:>8.1f}{spent:>8.1f}{peak:>9.0f}")


if __name__ == "__main__":
    main()
