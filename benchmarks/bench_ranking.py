"""Exact ranking by descriptors from a memory-mapped file, beside faiss with all in memory.

Usage: ``python benchmarks/bench_ranking.py [--small]``

Random descriptors are the hard case: the first 100 tiles lie so close together that float32
cannot order them, and nearly all are evaluated in float64. Each side runs in a process of its own.
faiss is timed without loading its arrays. Both are held against float64 for some queries.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

K = 100
CHECKED = 20
SIZES = {"full": (1_000, 100_000, 8_448), "small": (100, 10_000, 1_024)}


def generate(folder: Path, size: str) -> dict[str, Any]:
    """Write queries and gallery, block by block."""
    n_queries, n_tiles, length = SIZES[size]
    rng = np.random.default_rng(0)
    shape = (n_tiles, length)
    gallery = np.lib.format.open_memmap(folder / "gallery.npy", "w+", np.float32, shape)
    for start in range(0, n_tiles, 1_000):
        gallery[start : start + 1_000] = rng.standard_normal((1_000, length), np.float32)
    source = np.sort(rng.choice(n_tiles, n_queries, replace=False))
    noise = rng.standard_normal((n_queries, length), np.float32)
    np.save(folder / "queries.npy", gallery[source] + 4 * noise)
    np.save(folder / "source.npy", source)
    return {}


def ours(folder: Path, _: str) -> dict[str, Any]:
    """Rank from the map."""
    from airzoo_bench.retrieval.ranking import rank_by_descriptors
    from airzoo_bench.retrieval.truth import Positives

    queries = np.load(folder / "queries.npy")
    gallery = np.load(folder / "gallery.npy", mmap_mode="r")
    source = np.load(folder / "source.npy").astype(np.int32)
    positives = Positives(np.arange(len(queries) + 1), source)
    begin = time.perf_counter()
    ranking = rank_by_descriptors(
        queries, gallery, k=K, metric="l2", positives=positives, depth=5, memory_bytes=1 << 29
    )
    seconds = time.perf_counter() - begin
    np.save(folder / "ours.npy", ranking.tiles)
    return {"seconds": seconds}


def peer(folder: Path, _: str) -> dict[str, Any]:
    """Search with faiss, with everything in memory."""
    import faiss

    queries, gallery = np.load(folder / "queries.npy"), np.load(folder / "gallery.npy")
    begin = time.perf_counter()
    tiles = faiss.knn(queries, gallery, K)[1]
    seconds = time.perf_counter() - begin
    np.save(folder / "peer.npy", tiles)
    return {"seconds": seconds}


def check(folder: Path, _: str) -> dict[str, Any]:
    """Share of ranks at which each side has the tile that float64 has there."""
    found = {side: np.load(folder / f"{side}.npy") for side in ("ours", "peer")}
    queries = np.load(folder / "queries.npy")[:CHECKED].astype(np.float64)
    gallery = np.load(folder / "gallery.npy", mmap_mode="r")
    distances = np.concatenate(
        [_squared(queries, gallery[s : s + 500]) for s in range(0, len(gallery), 500)], axis=1
    )
    exact = np.argsort(distances, axis=1, kind="stable")[:, :K]
    shares = {side: float((tiles[:CHECKED] == exact).mean()) for side, tiles in found.items()}
    return shares | {"same": float((found["ours"] == found["peer"]).mean())}


def _squared(queries: NDArray[np.float64], rows: NDArray[np.float32]) -> NDArray[np.float64]:
    block = rows.astype(np.float64)
    return np.stack([((block - query) ** 2).sum(axis=1) for query in queries])


STEPS = {"generate": generate, "ours": ours, "peer": peer, "check": check}


def in_fresh_process(step: str, folder: Path, size: str) -> dict[str, Any]:
    """Run one step in its own process; a process's peak counts from its start."""
    command = [sys.executable, __file__, "--step", step, "--folder", str(folder), "--size", size]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def main() -> None:
    """Run all steps and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--small", action="store_true")
    parser.add_argument("--step", choices=STEPS, help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--size", default="full", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.step:
        result = STEPS[options.step](options.folder, options.size)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(json.dumps(result | {"peak_mb": peak}))
        return
    size = "small" if options.small else "full"
    with tempfile.TemporaryDirectory() as name:
        results = {step: in_fresh_process(step, Path(name), size) for step in STEPS}
    report(size, results)


def report(size: str, results: dict[str, dict[str, Any]]) -> None:
    """Print the table."""
    n_queries, n_tiles, length = SIZES[size]
    print(f"top {K} of {n_queries:,} queries, {n_tiles:,} tiles, {length:,} numbers each\n")
    print(f"{'':24}{'seconds':>9}{'peak MB':>9}{'ratio':>8}{'as float64':>12}")
    for side, label in (("ours", "airzoo-bench, mapped"), ("peer", "faiss.knn, in memory")):
        seconds = results[side]["seconds"]
        ratio = seconds / results["peer"]["seconds"]
        line = f"{label:24}{seconds:9.2f}{results[side]['peak_mb']:9.0f}{ratio:8.2f}"
        print(f"{line}{results['check'][side]:12.2%}")
    print(f"\nthe two have the same tile at {results['check']['same']:.2%} of ranks")


if __name__ == "__main__":
    main()
