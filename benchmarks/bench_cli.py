"""Whole processes of the command line: how long a person waits.

``airzoo-bench --help``, and ``eval retrieval`` on all 6,442 queries of UAV-VisLoc (11 scenes with
5,000 tiles each, 100 ranks a query), beside a bare interpreter that imports numpy and pandas.
Median of some runs after one that warms the disk cache.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols
from tests.support import MadeScene, write_benchmark, write_predictions

NAME = "uav-visloc-retrieval"
TILES, RANKS = 5_000, 100


def make_input(root: Path) -> Path:
    """Write the benchmark folder and a prediction file, and return the file."""
    protocol = load_protocol(shipped_protocols()[NAME])
    random = np.random.default_rng(0)
    scenes, query_ids, ranked = [], [], []
    for entry in protocol.scenes:
        n = entry.queries or 0
        positives = random.integers(0, TILES, (n, 10))
        scene = MadeScene(entry.id, [sorted(set(row.tolist())) for row in positives], TILES)
        tiles = np.array(scene.tile_ids)
        query_ids += scene.query_ids
        ranked += [tiles[random.choice(TILES, RANKS, replace=False)] for _ in range(n)]
        scenes.append(scene)
    write_benchmark(root / protocol.benchmark, protocol, scenes)
    return write_predictions(root / "preds.npz", NAME, query_ids=query_ids, ranked_ids=ranked)


def seconds(command: list[str], runs: int) -> float:
    """Return the median wall time of a whole process."""
    times = []
    for _ in range(runs + 1):
        start = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True, env=os.environ | {"COLUMNS": "80"})
        times.append(time.perf_counter() - start)
    return statistics.median(times[1:])


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=7)
    runs = parser.parse_args().runs
    suite = [sys.executable, "-m", "airzoo_bench"]
    with tempfile.TemporaryDirectory() as folder:
        preds = str(make_input(Path(folder)))
        rows = {
            "python -c 'import numpy, pandas'": [sys.executable, "-c", "import numpy, pandas"],
            "airzoo-bench --help": [*suite, "--help"],
            "eval retrieval, 6,442 queries": [*suite, "eval", "retrieval", preds, "--data", folder],
        }
        print(f"{'whole process':36} {'seconds':>8}")
        for label, command in rows.items():
            print(f"{label:36} {seconds(command, runs):8.2f}")


if __name__ == "__main__":
    main()
