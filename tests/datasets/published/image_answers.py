"""Benchmarks of images as folders, and answers to them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from airzoo_bench import evaluate
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.dataset import Prepared, PrepareSettings
from airzoo_bench.datasets.native import NativeOptions
from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols
from airzoo_bench.results.result import Result
from airzoo_bench.retrieval.truth import RetrievalTruth, read_truth


def prepared(
    name: str, source: Path, tmp_path: Path, *, scene: list[str] | None = None, **how: bool
) -> tuple[Prepared, list[str]]:
    notes: list[str] = []
    options = NativeOptions(source, scene, how.pop("keep_going", False))
    root = tmp_path / "data"
    settings = PrepareSettings(root / name, root, note=notes.append, **how)  # type: ignore[arg-type]
    return DATASETS.get(name).prepare(options, settings), notes


def truth_of(made: Prepared, scene: str) -> RetrievalTruth:
    return read_truth(made.folder / "scenes" / scene, scene)


def scored(made: Prepared, protocol: str, arrays: dict[str, np.ndarray], path: Path) -> Result:
    np.savez(path, protocol=np.array(protocol), **arrays)
    return evaluate(path, data=made.folder).result


def exact(made: Prepared, protocol: str) -> dict[str, np.ndarray]:
    """Rank all positives first, the nearest before others, then the rest."""
    queries, ranked = [], []
    scenes = load_protocol(shipped_protocols()[protocol]).scenes
    for scene in (one.id for one in scenes):
        truth = truth_of(made, scene)
        ids = truth.tiles["id"].to_numpy(str)
        for row, query in enumerate(truth.queries["id"]):
            right = truth.positives.of(row)
            ranked.append([*ids[right], *np.delete(ids, right)])
            queries.append(query)
    longest = max(10, *map(len, ranked))
    filled = [[*one, *[""] * (longest - len(one))] for one in ranked]
    return {"query_ids": np.array(queries), "ranked_ids": np.array(filled)}
