"""What a scene of the retrieval track asks, with its truth or, where that is sealed, without."""

from __future__ import annotations

import numpy as np

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import read_excluded, read_queries
from airzoo_bench.retrieval.pairs import Positives
from airzoo_bench.retrieval.truth import (
    FOOTPRINT_COLUMNS,
    RetrievalTruth,
    read_tile_table,
    read_tiles,
    read_truth,
)

__all__ = ["read_questions", "scene_truth"]


def scene_truth(benchmark: Benchmark, scene: str) -> RetrievalTruth:
    """Read a scene's truth by `read_truth`, or by `read_questions` where it is sealed."""
    if benchmark.is_sealed:
        return read_questions(benchmark, scene)
    rules = benchmark.file.tracks["retrieval"]["ground_truth"]
    answerable = rules["without_positive"] == "exclude"
    return read_truth(benchmark.scene_folder(scene), scene, answerable=answerable)


def read_questions(benchmark: Benchmark, scene: str) -> RetrievalTruth:
    """Read what a scene asks where the truth is sealed: queries and tiles, without any answer."""
    folder = benchmark.scene_folder(scene)
    excluded = read_excluded(benchmark, scene, "retrieval")
    queries, tiles = read_queries(folder, excluded), read_tiles(folder / "retrieval")
    dropped = read_tile_table(folder / "retrieval" / "dropped_tiles.csv")
    positives = Positives(np.zeros(len(queries) + 1, np.int64), np.zeros(0, np.int32))
    footprints = queries[["id"]].assign(**dict.fromkeys(FOOTPRINT_COLUMNS, np.nan))
    return RetrievalTruth(scene, queries, footprints, tiles, positives, excluded, dropped)
