"""Time and memory of making the world of AirZoo-Mini.

Usage: ``python benchmarks/bench_mini_world.py [--seed N] [--repeats N] [--write-checksums]``

Each region is made in a process of its own; seconds are those of the processor, medians of the
repeats. The budget is 25 s for both regions on two cores, and 700 MB each. ``--write-checksums``
writes the digests of seed 0 to the tests, after a change that is meant.
"""

from __future__ import annotations

import argparse
import json
import resource
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from airzoo_bench.datasets.mini.build import build_world, digest
from airzoo_bench.datasets.mini.world import REGIONS

CHECKSUMS = Path(__file__).resolve().parents[1] / "tests/datasets/mini/checksums.json"


def measure(region: str, seed: int) -> dict[str, Any]:
    """Make a region in this process, and say what that took."""
    start, start_cpu = time.perf_counter(), time.process_time()
    world = build_world(region, seed)
    seconds, cpu = time.perf_counter() - start, time.process_time() - start_cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {
        "seconds": seconds,
        "cpu": cpu,
        "peak_mb": peak,
        "triangles": len(world.mesh.triangles),
        "digest": digest(world),
    }


def in_child(region: str, seed: int) -> dict[str, Any]:
    """Measure in a new process."""
    command = [sys.executable, __file__, "--child", region, "--seed", str(seed)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def main() -> None:
    """Measure both regions and print a line each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--write-checksums", action="store_true")
    parser.add_argument("--child", choices=sorted(REGIONS))
    options = parser.parse_args()
    if options.child:
        print(json.dumps(measure(options.child, options.seed)))
        return
    digests = {}
    for region in REGIONS:
        runs = [in_child(region, options.seed) for _ in range(options.repeats)]
        digests[region] = runs[0]["digest"]
        cpu, seconds = (statistics.median(run[key] for run in runs) for key in ("cpu", "seconds"))
        print(
            f"{region:6} {cpu:5.1f} s of CPU  {seconds:5.1f} s  {runs[0]['peak_mb']:4.0f} MB  "
            f"{runs[0]['triangles']:,} triangles  same bytes: "
            f"{all(run['digest'] == runs[0]['digest'] for run in runs)}"
        )
    if options.write_checksums:
        CHECKSUMS.write_text(json.dumps(digests, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
