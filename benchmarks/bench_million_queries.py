"""A million queries with five ranked ids each, from npz to result and records, beside two peers.

Usage: ``python benchmarks/bench_million_queries.py [--small] [--folder DIR]``

Ten scenes of 100,000 queries and 10,000 tiles. Ours is ``airzoo-bench eval retrieval``: it checks
every id, scores 18 columns, averages them, and writes result.json and the records. The peers read
the same npz, believe it, and write four of these columns as a CSV of each query: pandas by a merge
of ranked and positive pairs, ranx by its Run and Qrels. All are processes of their own; the largest
difference between their columns and ours is printed too.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

SCENES, QUERIES, TILES, RANKS = 10, 100_000, 10_000, 5
COLUMNS = {"recall@1": "hit_rate@1", "recall@5": "hit_rate@5", "ap@5": "precision@5", "mrr": "mrr"}
PEERS = ("pandas", "ranx")


class Used(NamedTuple):
    """What a process took."""

    wall_s: float
    cpu_s: float
    peak_mb: float


def make_input(folder: Path, queries: int) -> None:
    """Write the benchmark folder and the prediction file."""
    from tests.support import MadeScene, made_protocol, write_benchmark

    random = np.random.default_rng(0)
    scenes, firsts, query_ids, ranked = [], [], [], []
    for number in range(SCENES):
        first = random.integers(0, TILES - 40, queries)
        counts = random.integers(1, 5, queries)
        near = [list(range(a, a + n)) for a, n in zip(first.tolist(), counts.tolist(), strict=True)]
        scene = MadeScene(f"s{number}", near, TILES)
        # Five tiles out of eight near the truth: most queries have a hit, at different ranks.
        steps = np.stack([random.permutation(8)[:RANKS] for _ in range(1000)])
        rows = (first[:, None] + steps[random.integers(0, 1000, queries)] * 3) % TILES
        scenes.append(scene)
        firsts.append(first)
        query_ids += scene.query_ids
        ranked.append(np.array(scene.tile_ids)[rows])
    protocol = made_protocol(scenes)
    write_benchmark(folder / "made", protocol, scenes)
    write_footprints(folder / "made", [scene.id for scene in scenes], firsts, random)
    np.savez(
        folder / "predictions.npz",
        protocol=protocol.name,
        query_ids=np.array(query_ids),
        ranked_ids=np.concatenate(ranked),
    )


def write_footprints(
    folder: Path, scenes: list[str], firsts: list[np.ndarray], random: np.random.Generator
) -> None:
    """Give each footprint a place of its own in its first tile, and state the checksums anew."""
    import pandas as pd

    from airzoo_bench.benchmark.folder import Benchmark
    from airzoo_bench.benchmark.manifest import write_benchmark_file

    file = Benchmark.open(folder).file
    for scene, first in zip(scenes, firsts, strict=True):
        path = folder / "scenes" / scene / "retrieval" / "footprints.csv"
        east, north = random.uniform(0, 1, (2, len(first)))
        places = {"lon": 113 + 0.001 * (first + east), "lat": 28 + 0.001 * north}
        named = {f"footprint_{axis}": np.round(degrees, 9) for axis, degrees in places.items()}
        pd.read_csv(path).assign(**named).to_csv(path, index=False)
    write_benchmark_file(folder, file)


def positive_pairs(folder: Path) -> object:
    """Read the ids of each query and each of its positives as a table."""
    import pandas as pd

    parts = []
    for home in sorted((folder / "made" / "scenes").iterdir()):
        queries = pd.read_csv(home / "queries.csv", usecols=["id"])["id"]
        tiles = pd.read_parquet(home / "retrieval" / "tiles.parquet", columns=["id"])["id"]
        with np.load(home / "retrieval" / "positives.npz") as pairs:
            query = np.repeat(queries.to_numpy(), np.diff(pairs["offsets"]))
            parts.append(pd.DataFrame({"query": query, "tile": tiles.to_numpy()[pairs["tiles"]]}))
    return pd.concat(parts, ignore_index=True)


def read_ranked(folder: Path) -> object:
    """Read ranked ids as a table of query, tile and score."""
    import pandas as pd

    with np.load(folder / "predictions.npz") as arrays:
        query, tiles = arrays["query_ids"].astype(object), arrays["ranked_ids"].astype(object)
    score = np.tile(np.arange(RANKS, 0.0, -1.0), len(query))
    return pd.DataFrame({"query": np.repeat(query, RANKS), "tile": tiles.ravel(), "score": score})


def by_pandas(folder: Path) -> None:
    """Score as one does without a library: a left merge, then NumPy over the hits."""
    import pandas as pd

    ranked = read_ranked(folder)
    found = ranked.merge(positive_pairs(folder).assign(hit=True), how="left")
    hits = found["hit"].notna().to_numpy().reshape(-1, RANKS)
    first = np.where(hits.any(axis=1), hits.argmax(axis=1) + 1, np.inf)
    scores = (hits[:, 0] * 1.0, hits.any(axis=1) * 1.0, hits.mean(axis=1), 1 / first)
    named = dict(zip(COLUMNS, scores, strict=True))
    table = pd.DataFrame({"query": ranked["query"].to_numpy()[::RANKS], **named})
    table.to_csv(folder / "pandas.csv", index=False)


def by_ranx(folder: Path) -> None:
    """Score with ranx, whose warm-up is its users' too."""
    import pandas as pd
    from ranx import Qrels, Run, evaluate

    named = {"q_id_col": "query", "doc_id_col": "tile", "score_col": "score"}
    texts = {"query": object, "tile": object}
    qrels = Qrels.from_df(positive_pairs(folder).assign(score=1).astype(texts), **named)
    run = Run.from_df(read_ranked(folder).astype(texts), **named)
    evaluate(qrels, run, list(COLUMNS.values()))
    table = pd.DataFrame({ours: run.scores[theirs] for ours, theirs in COLUMNS.items()})
    table.rename_axis("query").to_csv(folder / "ranx.csv")


def measured(command: list[str]) -> Used:
    """Run a process to its end."""
    start = time.perf_counter()
    environment = os.environ | {"PYTHONPATH": str(ROOT), "COLUMNS": "80"}
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, env=environment)
    _, status, used = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{' '.join(command)} ended with status {status}")
    wall, cpu = time.perf_counter() - start, used.ru_utime + used.ru_stime
    return Used(wall, cpu, used.ru_maxrss / 1024)


def evaluation(folder: Path, out: Path, *options: str) -> list[str]:
    """Return the command that is measured."""
    suite = [sys.executable, "-m", "airzoo_bench", "eval", "retrieval"]
    given = [str(folder / "predictions.npz"), "--data", str(folder), "--out", str(out)]
    return [*suite, *given, *options]


def differences(folder: Path) -> dict[str, float]:
    """Return the largest difference of each peer's columns to ours."""
    import pandas as pd

    ours = pd.read_csv(
        folder / "csv" / "records.csv", index_col="query", usecols=["query", *COLUMNS]
    )
    found = {}
    for peer in PEERS:
        theirs = pd.read_csv(folder / f"{peer}.csv", index_col="query").loc[ours.index]
        found[peer] = float(np.abs(theirs[list(COLUMNS)] - ours).to_numpy().max())
    return found


def run(folder: Path, queries: int) -> None:
    """Measure all and print."""
    script = [sys.executable, __file__, "--folder", str(folder), "--queries", str(queries)]
    if not (folder / "predictions.npz").exists():
        measured([*script, "--step", "input"])
    commands = {
        "ours": evaluation(folder, folder / "csv"),
        "ours, --jobs 2": evaluation(folder, folder / "jobs", "--jobs", "2"),
        **{peer: [*script, "--step", peer] for peer in PEERS},
    }
    used = {name: measured(command) for name, command in commands.items()}
    base, apart = used["ours"], differences(folder)
    print(f"{SCENES * queries:,} queries x {RANKS} ids\n")
    print(f"{'':38}{'wall s':>8}{'CPU s':>8}{'peak MB':>9}{'CPU x':>7}{'max |diff|':>12}")
    for name, one in used.items():
        sizes = f"{one.wall_s:8.1f}{one.cpu_s:8.1f}{one.peak_mb:9.0f}{one.cpu_s / base.cpu_s:7.2f}"
        print(f"{name:38}{sizes}{apart.get(name, '-'):>12}")
    size = (folder / "csv" / "records.csv").stat().st_size
    print(f"{'records.csv':38}{size / 1e6:8.0f} MB")


def main() -> None:
    """Measure and print, or do one step in a process of its own."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--small", action="store_true", help="20,000 queries")
    parser.add_argument("--folder", type=Path, help="where to keep input and output")
    parser.add_argument("--queries", type=int, default=QUERIES, help="of each scene")
    parser.add_argument("--step", choices=("input", *PEERS), help=argparse.SUPPRESS)
    given = parser.parse_args()
    steps = {"pandas": by_pandas, "ranx": by_ranx}
    if given.step == "input":
        make_input(given.folder, given.queries)
    elif given.step:
        steps[given.step](given.folder)
    else:
        with tempfile.TemporaryDirectory() as scratch:
            folder = given.folder or Path(scratch)
            run(folder, 2_000 if given.small else given.queries)


if __name__ == "__main__":
    main()
