"""``airzoo-bench submission check`` on a retrieval submission of the paper's size.

6,742 queries in 11 scenes, 95,018 tiles, 100 ranked ids a query: checked, re-scored and compared
with the claimed result, beside ``eval`` of the same predictions and a bare interpreter that imports
numpy and pandas. Median of some runs after one that warms the disk cache.
"""

from __future__ import annotations

import argparse
import datetime
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from airzoo_bench.core.files import sha256_of
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.leaderboard.submission import Submission, submission_text
from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols
from airzoo_bench.results.result import write_result
from tests.support import MadeScene, write_benchmark

NAME, BENCHMARK = "uav-visloc-retrieval", "uav-visloc"
QUERIES, TILES, RANKS = 6_742, 95_018, 100
OTHERS = 300  # UAV-VisLoc has 6,742 photos, the scenes of the protocol 6,442 queries


def make_benchmark(data: Path) -> list[MadeScene]:
    """Write a benchmark folder of the paper's size."""
    protocol = load_protocol(shipped_protocols()[NAME])
    random = np.random.default_rng(0)
    scenes = []
    for place, entry in enumerate(protocol.scenes):
        queries = (entry.queries or 0) + (OTHERS if place == 0 else 0)
        tiles = TILES // len(protocol.scenes) + (place < TILES % len(protocol.scenes))
        positives = random.integers(0, tiles, (queries, 10))
        scenes.append(MadeScene(entry.id, [sorted({*row.tolist()}) for row in positives], tiles))
    write_benchmark(data / protocol.benchmark, protocol, scenes)
    return scenes


def make_submission(root: Path, data: Path, scenes: list[MadeScene]) -> Path:
    """Write a board and a submission with its claimed result, and return its folder."""
    root.mkdir()
    (root / "leaderboard.toml").write_text(
        f'schema = 1\ntitle = "Board"\n[[benchmarks]]\nname = "{BENCHMARK}"\ntitle = "UAV-VisLoc"\n'
        f'protocols = ["{NAME}"]\n'
    )
    folder = root / "submissions" / BENCHMARK / "retrieval" / "method"
    folder.mkdir(parents=True)
    random = np.random.default_rng(1)
    query_ids, ranked = [], []
    for scene in scenes:
        tiles = np.array(scene.tile_ids)
        query_ids += scene.query_ids
        ranked += [tiles[random.choice(len(tiles), RANKS, replace=False)] for _ in scene.positives]
    file = folder / "preds.npz"
    np.savez_compressed(file, protocol=NAME, query_ids=query_ids, ranked_ids=np.array(ranked))
    values: dict[str, Any] = {
        "schema": 1,
        "protocol": NAME,
        "method": "Random",
        "team": "Example Lab",
        "contact": "ada@example.org",
        "authors": ["Ada Example"],
        "date": datetime.date(2026, 11, 22),
        "licence": "CC0-1.0",
        "training_data": [],
        "pipeline": {"stages": "single-stage"},
        "predictions": {
            "file": file.name,
            "sha256": sha256_of(file),
            "bytes": file.stat().st_size,
        },
    }
    text = submission_text(Submission.model_validate(values))
    (folder / "submission.toml").write_text(text, encoding="utf-8")
    write_result(folder / "result.json", evaluate(file, data=data, method="Random").result)
    return folder


def seconds(command: list[str], runs: int) -> tuple[float, float]:
    """Return the median wall time and processor time of a whole process."""
    walls, used = [], []
    for _ in range(runs + 1):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        start = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True, env=os.environ | {"COLUMNS": "80"})
        walls.append(time.perf_counter() - start)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        used.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return median(walls[1:]), median(used[1:])


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    runs = parser.parse_args().runs
    suite = [sys.executable, "-m", "airzoo_bench"]
    with tempfile.TemporaryDirectory() as name:
        data = Path(name) / "data"
        folder = make_submission(Path(name) / "board", data, make_benchmark(data))
        file = folder / "preds.npz"
        given = ["--data", str(data)]
        print(f"{QUERIES:,} queries, {TILES:,} tiles, {RANKS} ranks: {file.stat().st_size:,} bytes")
        rows = {
            "python -c 'import numpy, pandas'": [sys.executable, "-c", "import numpy, pandas"],
            "eval retrieval": [*suite, "eval", "retrieval", str(file), *given],
            "submission check --no-score": [
                *(*suite, "submission", "check", str(folder), "--no-score", *given)
            ],
            "submission check": [*suite, "submission", "check", str(folder), *given],
        }
        print(f"{'whole process':36} {'seconds':>8} {'processor':>10}")
        for label, command in rows.items():
            wall, used = seconds(command, runs)
            print(f"{label:36} {wall:8.2f} {used:10.2f}")


if __name__ == "__main__":
    main()
