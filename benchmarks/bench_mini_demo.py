"""Time of the demo from nothing and again, and of its worlds, as a user would run them.

Usage: ``python benchmarks/bench_mini_demo.py``

Everything is made in a temporary folder. The budgets are 120 s for the demo from nothing and 45 s
for the demo again, on two cores.
"""

from __future__ import annotations

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
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        world = run(home, "mini", "world")
        print(f"both worlds, from nothing          {world:7.1f} s")
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        print(f"demo, from nothing                 {run(home, 'demo'):7.1f} s")
        print(f"demo, again                        {run(home, 'demo'):7.1f} s")
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    print(f"largest process                    {peak:7.0f} MB")


if __name__ == "__main__":
    main()
