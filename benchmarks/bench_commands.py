"""Whole processes of the command line, beside a bare interpreter and pandas; engines of `eval`."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from harness import ROOT, SUITE, Case, Work, main

from airzoo_bench.protocol.model import load_protocol, shipped_protocols

sys.path.insert(0, str(ROOT))

from tests.support import MadeScene, made_protocol, write_benchmark, write_predictions

EVAL = "eval retrieval FOLDER/preds.npz --data FOLDER --out FOLDER/out"


def command(folder: Path, words: str, **_: Any) -> Work:
    """Return a command of the suite; FOLDER is where the inputs are."""
    return [*SUITE, *words.replace("FOLDER", str(folder)).split()]


def bare(*_: Any, **__: Any) -> Work:
    """Return an interpreter that imports numpy and pandas."""
    return [sys.executable, "-c", "import numpy, pandas"]


def make_paper(folder: Path, tiles: int, ranks: int) -> None:
    """Write UAV-VisLoc's 6,442 queries, and random ranks for them."""
    protocol = load_protocol(shipped_protocols()["uav-visloc-retrieval"])
    random = np.random.default_rng(0)
    scenes, query_ids, ranked = [], [], []
    for entry in protocol.scenes:
        positives = random.integers(0, tiles, (entry.queries or 0, 10))
        scene = MadeScene(entry.id, [sorted({*row.tolist()}) for row in positives], tiles)
        names = np.array(scene.tile_ids)
        query_ids += scene.query_ids
        ranked += [names[random.choice(tiles, ranks, replace=False)] for _ in positives]
        scenes.append(scene)
    write_benchmark(folder / protocol.benchmark, protocol, scenes)
    arrays = {"query_ids": query_ids, "ranked_ids": ranked}
    write_predictions(folder / "preds.npz", protocol.name, **arrays)


RANKS = 5


def make_many(folder: Path, queries: int) -> None:
    """Write ten scenes of 10,000 tiles; most queries have a hit, at different ranks."""
    random, tiles = np.random.default_rng(0), 10_000
    scenes, query_ids, ranked = [], [], []
    for number in range(10):
        first, counts = random.integers(0, tiles - 40, queries), random.integers(1, 5, queries)
        near = [list(range(a, a + n)) for a, n in zip(first.tolist(), counts.tolist(), strict=True)]
        scene = MadeScene(f"s{number}", near, tiles)
        steps = np.stack([random.permutation(8)[:RANKS] for _ in range(1000)])
        rows = (first[:, None] + steps[random.integers(0, 1000, queries)] * 3) % tiles
        scenes.append(scene)
        query_ids += scene.query_ids
        ranked.append(np.array(scene.tile_ids)[rows])
    write_benchmark(folder / "made", made_protocol(scenes), scenes)
    arrays = {"query_ids": query_ids, "ranked_ids": np.concatenate(ranked)}
    write_predictions(folder / "preds.npz", "made-retrieval", **arrays)


def positive_pairs(folder: Path) -> pd.DataFrame:
    """Read the ids of each query and each of its positives as a table."""
    parts = []
    for home in sorted((folder / "made" / "scenes").iterdir()):
        queries = pd.read_csv(home / "queries.csv", usecols=["id"])["id"].to_numpy()
        tiles = pd.read_parquet(home / "retrieval" / "tiles.parquet", columns=["id"])["id"]
        with np.load(home / "retrieval" / "positives.npz") as pairs:
            query = np.repeat(queries, np.diff(pairs["offsets"]))
            parts.append(pd.DataFrame({"query": query, "tile": tiles.to_numpy()[pairs["tiles"]]}))
    return pd.concat(parts, ignore_index=True)


def score_by_pandas(folder: Path, **_: Any) -> Work:
    """Score as one does without a library, believing the file: a merge, then NumPy over hits."""

    def work() -> None:
        with np.load(folder / "preds.npz") as arrays:
            query, tiles = (arrays[name].astype(object) for name in ("query_ids", "ranked_ids"))
        ranked = pd.DataFrame({"query": np.repeat(query, RANKS), "tile": tiles.ravel()})
        found = ranked.merge(positive_pairs(folder).assign(hit=True), how="left")
        hits = found["hit"].notna().to_numpy().reshape(-1, RANKS)
        first = np.where(hits.any(axis=1), hits.argmax(axis=1) + 1, np.inf)
        scores = {"recall@1": hits[:, 0] * 1.0, "recall@5": hits.any(axis=1) * 1.0}
        scores |= {"ap@5": hits.mean(axis=1), "mrr": 1 / first}
        pd.DataFrame({"query": query, **scores}).to_csv(folder / "pandas.csv", index=False)

    return work


def make_descriptors(folder: Path, queries: int, tiles: int, length: int) -> None:
    """Write a benchmark of one scene, and descriptors for it."""
    random = np.random.default_rng(0)
    positives = [sorted(random.choice(tiles, 4, replace=False).tolist()) for _ in range(queries)]
    scene = MadeScene("made", positives, tiles)
    write_benchmark(folder / "made", made_protocol([scene]), [scene])
    gallery = np.empty((tiles, length), np.float32)
    for start in range(0, tiles, 4096):
        random.standard_normal(out=gallery[start : start + 4096], dtype=np.float32)
    arrays = {"query_ids": scene.query_ids, "gallery_ids": scene.tile_ids}
    arrays["query_descriptors"] = random.standard_normal((queries, length), np.float32)
    write_predictions(folder / "preds.npz", "made-retrieval", gallery_descriptors=gallery, **arrays)


def on_engine(options: str) -> Any:
    """Return `eval` with options and at most 1 GB of memory."""
    return partial(command, words=f"{EVAL} --max-memory 1G {options}")


CASES = {
    "paper": Case(
        "6,442 queries in 11 scenes of {tiles:,} tiles, {ranks} ranks",
        make_paper,
        {
            "python -c 'import numpy, pandas'": bare,
            "airzoo-bench --help": partial(command, words="--help"),
            "eval retrieval": partial(command, words=EVAL),
        },
        {"tiles": 5_000, "ranks": 100},
        {"tiles": 500, "ranks": 100},
        repeats=5,
    ),
    "million": Case(
        "10 x {queries:,} queries x 5 ids, to result.json and records.csv",
        make_many,
        {
            "pandas, 4 of 33 columns": score_by_pandas,
            "airzoo-bench": partial(command, words=EVAL),
            "airzoo-bench --jobs 2": partial(command, words=f"{EVAL} --jobs 2"),
        },
        {"queries": 100_000},
        {"queries": 2_000},
    ),
    "descriptors": Case(
        "{queries:,} queries x {tiles:,} tiles x {length:,} numbers, --max-memory 1G",
        make_descriptors,
        {
            "--jobs 2": on_engine("--jobs 2"),
            "--jobs 1": on_engine("--jobs 1"),
            "--engine dask, two workers": on_engine("--engine dask --jobs 2"),
        },
        {"queries": 1_000, "tiles": 100_000, "length": 8_448},
        {"queries": 100, "tiles": 5_000, "length": 256},
    ),
}

if __name__ == "__main__":
    main(CASES)
