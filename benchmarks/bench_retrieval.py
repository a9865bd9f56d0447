"""Positives beside shapely, ranking beside faiss, metrics beside ranx and ir_measures.

What one side alone needs is imported within it, or it would count as memory of the others.
"""

from __future__ import annotations

import time
import warnings
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from harness import Case, Figures, Work, main, same
from numpy.typing import NDArray

from airzoo_bench.evaluation.track import Run
from airzoo_bench.retrieval import metrics
from airzoo_bench.retrieval.ranking import Depths, rank_by_descriptors
from airzoo_bench.retrieval.truth import Positives

Floats = NDArray[np.float64]


def make_points(folder: Path, gallery: str, queries: int, side: float) -> None:
    """Write boxes (G, 4) of tiles of two scales and points (Q, 4, 2), in degrees."""
    random = np.random.default_rng(0)
    boxes = np.concatenate([cut(side, px * 0.3) for px in (1024, 512)])
    if gallery == "shuffled":
        boxes = random.permutation(boxes)
    low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
    points = random.uniform(low, high, (queries, 2))[:, None]
    points = points + random.uniform(-0.0015, 0.0015, (queries, 4, 2))
    points[random.random((queries, 4)) < 0.01] = np.nan
    np.savez(folder / "arrays.npz", boxes=boxes, points=points)


def cut(side: float, tile: float) -> Floats:
    """Cut a square map in UTM into tiles with half a tile's stride, the last at the edge."""
    from pyproj import Transformer

    to_degrees = Transformer.from_crs(32649, 4326, always_xy=True).transform
    starts = np.append(np.arange(0, side - tile, tile / 2), side - tile)
    x, y = np.meshgrid(starts, -starts)
    corners = [
        to_degrees(760_000 + x + dx, 3_150_000 + y - dy) for dx in (0, tile) for dy in (0, tile)
    ]
    lon, lat = (np.stack(axis) for axis in zip(*corners, strict=True))
    sides = lon.min(axis=0), lat.min(axis=0), lon.max(axis=0), lat.max(axis=0)
    return np.stack(sides, axis=-1).reshape(-1, 4)


def find_positives(folder: Path, **_: Any) -> Work:
    """Find positives by this package."""
    from airzoo_bench.retrieval.positives import find_holding_tiles

    arrays = np.load(folder / "arrays.npz")
    points, boxes = arrays["points"], arrays["boxes"]

    def work() -> dict[str, Any]:
        found = find_holding_tiles(points, boxes)
        return {"offsets": found.offsets, "tiles": found.tiles}

    return work


def ask_tree(folder: Path, **_: Any) -> Work:
    """Find positives by shapely's tree, in bulk and without a predicate, its fastest way."""
    import shapely

    arrays = np.load(folder / "arrays.npz")
    points, boxes = arrays["points"], arrays["boxes"]

    def work() -> dict[str, Any]:
        tree = shapely.STRtree(shapely.box(*boxes.T))
        point, tile = tree.query(shapely.points(points.reshape(-1, 2)))
        pairs = np.unique(point // points.shape[1] * len(boxes) + tile)
        query, tile = np.divmod(pairs, len(boxes))
        counts = np.bincount(query, minlength=len(points))
        return {"offsets": np.append(0, np.cumsum(counts)), "tiles": tile.astype(np.int32)}

    return work


def positives_case(gallery: str) -> Case:
    """Return the case of a gallery: ``grid``, or ``shuffled``, which is none."""
    return Case(
        f"positives of {{queries:,}} queries of 4 points, {gallery} gallery",
        partial(make_points, gallery=gallery),
        {"airzoo-bench": find_positives, "shapely.STRtree": ask_tree},
        {"queries": 100_000, "side": 69_000.0},
        {"queries": 5_000, "side": 9_000.0},
        same,
        repeats=3,
    )


K = 100


def make_descriptors(folder: Path, queries: int, tiles: int, length: int) -> None:
    """Write random descriptors, the hard case: float32 cannot order their first 100 tiles."""
    random = np.random.default_rng(0)
    shape = (tiles, length)
    gallery = np.lib.format.open_memmap(folder / "gallery.npy", "w+", np.float32, shape)
    for start in range(0, tiles, 1_000):
        gallery[start : start + 1_000] = random.standard_normal((1_000, length), np.float32)
    source = np.sort(random.choice(tiles, queries, replace=False))
    noise = random.standard_normal((queries, length), np.float32)
    np.save(folder / "queries.npy", gallery[source] + 4 * noise)
    np.save(folder / "source.npy", source)


def rank_mapped(folder: Path, **_: Any) -> Work:
    """Rank by this package, from a file that is mapped."""
    queries = np.load(folder / "queries.npy")
    gallery = np.load(folder / "gallery.npy", mmap_mode="r")
    source = np.load(folder / "source.npy").astype(np.int32)
    positives = Positives(np.arange(len(queries) + 1), source)

    def work() -> dict[str, Any]:
        depths, names = Depths(len(gallery), K, 5), (range(len(queries)), range(len(gallery)))
        run = Run(1 << 29, jobs=2)
        blocks = rank_by_descriptors(queries, gallery, "l2", positives, depths, run, names)
        return {"tiles": np.concatenate([ranking.tiles for _, ranking in blocks])}

    return work


def search_faiss(folder: Path, **_: Any) -> Work:
    """Search by faiss, with all in memory; loading is not timed."""
    import faiss

    queries, gallery = np.load(folder / "queries.npy"), np.load(folder / "gallery.npy")
    return lambda: {"tiles": faiss.knn(queries, gallery, K)[1]}


def compare_ranks(figures: dict[str, Figures]) -> str:
    """Say at what share of ranks both have the same tile."""
    one, other = (side.arrays["tiles"] for side in figures.values())
    return f"the same tile at {(one == other).mean():.2%} of ranks"


DEPTH, TILES, BLOCK = 100, 20_011, 50_000  # TILES is a prime: every stride visits all tiles
MEASURES = {"recall@1": "hit_rate@1", "recall@3": "hit_rate@3", "recall@5": "hit_rate@5"}
MEASURES |= {"precision@5": "precision@5", "ap@5": "map@5", "ap": "map", "rr": "mrr"}
MEASURES |= {"ndcg@5": "ndcg@5"}


def make_ranks(folder: Path, queries: int) -> None:
    """Write distinct tiles a query, 1 to 32 positives, about one rank in twenty a hit."""
    ranked = np.empty((queries, DEPTH), dtype=np.int32)
    counts, tiles = [], []
    for start in range(0, queries, BLOCK):
        random = np.random.default_rng([7, start])
        rows = min(BLOCK, queries - start)
        first, stride = random.integers(0, TILES, (rows, 1)), random.integers(1, TILES, (rows, 1))
        ranked[start : start + rows] = (first + stride * np.arange(DEPTH)) % TILES
        count = random.integers(1, 33, rows)
        ranks = np.cumsum(random.geometric(0.05, (rows, 32)), axis=1) - 1
        found = np.where(np.arange(32) < count[:, None], (first + stride * ranks) % TILES, -1)
        found = np.sort(found, axis=1)
        counts.append(count)
        tiles.append(found[found >= 0].astype(np.int32))
    offsets = np.append(0, np.cumsum(np.concatenate(counts)))
    np.savez(folder / "arrays.npz", ranked=ranked, offsets=offsets, tiles=np.concatenate(tiles))


def score(folder: Path, **_: Any) -> Work:
    """Score by this package, which has nothing to build."""
    arrays = np.load(folder / "arrays.npz")
    ranked, offsets, tiles = (arrays[name] for name in ("ranked", "offsets", "tiles"))

    def work() -> dict[str, Floats]:
        hits = metrics.hit_matrix(ranked, offsets, tiles, TILES)
        n_positives = np.diff(offsets)
        scores = {f"recall@{k}": metrics.recall_at(hits, k) for k in (1, 3, 5)}
        return scores | {
            "precision@5": metrics.average_precision_at(hits, n_positives, 5, "precision"),
            "ap@5": metrics.average_precision_at(hits, n_positives, 5, "trec"),
            "ap": metrics.average_precision(hits, n_positives),
            "rr": metrics.reciprocal_rank(hits),
            "ndcg@5": metrics.ndcg_at(hits, n_positives, 5),
        }

    return work


def score_ranx(folder: Path, **_: Any) -> Work:
    """Score by ranx from arrays, after its compilation; building them is timed too."""
    import ranx

    def work(rows: slice = slice(None)) -> dict[str, Any]:
        start = time.perf_counter()
        arrays = np.load(folder / "arrays.npz")
        ranked, counts = arrays["ranked"][rows], np.diff(arrays["offsets"])[rows]
        scores = np.broadcast_to(np.arange(DEPTH, 0, -1.0), ranked.shape)
        run = np.stack([ranked, scores], axis=-1)
        filled = np.arange(counts.max()) < counts[:, None]
        qrels = np.tile([-1.0, 0.0], (*filled.shape, 1))
        qrels[filled, 0], qrels[filled, 1] = arrays["tiles"][: counts.sum()], 1.0
        built = time.perf_counter() - start
        wanted = list(MEASURES.values())
        found = ranx.evaluate(qrels, run, wanted, return_mean=False, save_results_in_run=False)
        return {ours: found[theirs] for ours, theirs in MEASURES.items()} | {"built_s": built}

    warnings.simplefilter("ignore")
    work(slice(0, 64))
    return work


def score_ir_measures(folder: Path, **_: Any) -> Work:
    """Score by ir_measures, from tables, which are built before."""
    from ir_measures import AP, RR, P, Success, iter_calc, nDCG

    arrays = np.load(folder / "arrays.npz")
    ids = np.array([f"{number:06d}" for number in range(len(arrays["ranked"]))], object)
    tiles = np.array([f"t{number:05d}" for number in range(TILES)], object)
    run = pd.DataFrame(
        {"query_id": np.repeat(ids, DEPTH), "doc_id": tiles[arrays["ranked"].ravel()]}
    )
    run["score"] = np.tile(np.arange(DEPTH, 0, -1.0), len(ids))
    asked = np.repeat(ids, np.diff(arrays["offsets"]))
    qrels = pd.DataFrame({"query_id": asked, "doc_id": tiles[arrays["tiles"]], "relevance": 1})
    theirs = [Success @ 1, Success @ 3, Success @ 5, P @ 5, AP @ 5, AP, RR, nDCG @ 5]

    def work() -> dict[str, Floats]:
        found: dict[Any, list[float]] = {measure: [] for measure in theirs}
        for one in iter_calc(theirs, qrels, run):
            found[one.measure].append(one.value)
        return {name: np.array(found[one]) for name, one in zip(MEASURES, theirs, strict=True)}

    return work


def compare_scores(figures: dict[str, Figures]) -> str:
    """Say how long ranx takes without its building, and how far the scores of others are off."""
    ours, *others = figures.values()
    pairs = [(np.sort(ours.arrays[n]), np.sort(one.arrays[n])) for one in others for n in MEASURES]
    off = max(float(np.abs(a - b).max()) for a, b in pairs)
    ratio = (others[0].seconds - float(others[0].arrays["built_s"])) / ours.seconds
    return f"ranx without building: {ratio:.1f} times; scores within {off:.1e}"


CASES = {
    **{gallery: positives_case(gallery) for gallery in ("grid", "shuffled")},
    "ranking": Case(
        "first 100 of {queries:,} queries, {tiles:,} tiles, {length:,} numbers each",
        make_descriptors,
        {"faiss.knn, in memory": search_faiss, "airzoo-bench, mapped": rank_mapped},
        {"queries": 1_000, "tiles": 100_000, "length": 8_448},
        {"queries": 100, "tiles": 10_000, "length": 1_024},
        compare_ranks,
        repeats=3,
    ),
    "metrics": Case(
        "eight scores of {queries:,} queries x 100 ranks",
        make_ranks,
        {"airzoo-bench": score, "ranx, arrays": score_ranx, "ir_measures": score_ir_measures},
        {"queries": 100_000},
        {"queries": 1_000},
        compare_scores,
        repeats=2,
    ),
}

if __name__ == "__main__":
    main(CASES)
