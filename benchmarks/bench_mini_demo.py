"""Time of the demo from nothing and again, and of rendering, as a user would run them.

Usage: ``python benchmarks/bench_mini_demo.py [--frames N]``

Everything is made in a temporary folder. The budgets are 120 s for the demo from nothing, 45 s for
the demo again, and 10 frames of 640 x 480 a second, on two cores.
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


def run(home: Path, *arguments: str) -> float:
    """Run a command with its data root in a folder, and return its seconds."""
    start = time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", "airzoo_bench", *arguments],
        check=True,
        cwd=home,
        env=os.environ | {"AIRZOO_BENCH_DATA": str(home / "data")},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    return time.perf_counter() - start


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=120)
    frames = parser.parse_args().frames
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        world = run(home, "mini", "world")
        print(f"both worlds, from nothing          {world:7.1f} s")
        run(home, "mini", "trajectory", "--out", "whole.csv")
        lines = (home / "whole.csv").read_text().splitlines()
        step = (len(lines) - 1) // (frames + 1)
        # The start of a process, its imports and the world count once for both.
        for name, count in (("few.csv", 2), ("many.csv", frames + 2)):
            chosen = [lines[0], *lines[1 : 1 + step * count : step]]
            (home / name).write_text("\n".join(chosen) + "\n")
        few = run(home, "mini", "render", "--trajectory", "few.csv", "--out", "few")
        many = run(home, "mini", "render", "--trajectory", "many.csv", "--out", "many")
        print(f"rendering 640 x 480, two processes {frames / (many - few):7.1f} frames/s")
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        print(f"demo, from nothing                 {run(home, 'demo'):7.1f} s")
        print(f"demo, again                        {run(home, 'demo'):7.1f} s")
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    print(f"largest process                    {peak:7.0f} MB")


if __name__ == "__main__":
    main()
