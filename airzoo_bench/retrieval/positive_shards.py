"""Pairs of query and tile in shards of a gallery, each a task on whatever engine there is."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.engines.engine import Engine
from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.retrieval.footprints import (
    box_areas,
    intersection_areas,
    polygon_areas,
    untangled,
)
from airzoo_bench.retrieval.pairs import Positives, offsets_of
from airzoo_bench.retrieval.tile_grid import TileRun, find_runs

if TYPE_CHECKING:
    import shapely

__all__ = ["by_shards", "merged", "overlapping", "ratios", "tiles_of_points"]

Arrays = dict[str, NDArray[Any]]

_BLOCK = 4096  # queries at a time; bounds memory and stays in the cache
_TILES = 1 << 18  # of a shard, and of a search tree
_PAIRS = 1 << 17  # query-tile pairs at a time
_NONE = np.iinfo(np.int32).max
_TOUCH = 1e-12  # of the tile's area; what rounding leaves of two that only touch is below


@dataclass(frozen=True)
class _Shard:
    """Some tiles of the gallery by their boxes, of which the first is tile `start`."""

    start: int
    boxes: Floats

    @property
    def name(self) -> str:
        return f"tiles {self.start:,} to {self.start + len(self.boxes) - 1:,}"

    def pieces(self) -> Iterator[_Shard]:
        """Cut into as many tiles as a search tree may hold."""
        for first in range(0, len(self.boxes), _TILES):
            yield _Shard(self.start + first, self.boxes[first : first + _TILES])


def by_shards(
    work: Callable[[Floats, _Shard], Arrays], asked: Floats, boxes: Floats, engine: Engine
) -> Positives:
    """Find the pairs of each shard of the gallery, and put them together."""
    cuts = engine.cut(len(boxes), _TILES)
    shards = [_Shard(cut.start, boxes[cut]) for cut in cuts]
    found = engine.map(work, shards, shared=asked, stage="tiles searched", name=_name)
    return merged(list(found), len(asked))


def _name(shard: _Shard) -> str:
    return shard.name


def tiles_of_points(anchors: Floats, shard: _Shard) -> Arrays:
    """Find ``query`` and ``tile`` of the pairs of which the tile holds a point of the query."""
    runs = find_runs(shard.boxes)
    if runs is None:
        pieces = [_in_piece(anchors, piece) for piece in shard.pieces()]
        return {name: np.concatenate([one[name] for one in pieces]) for name in pieces[0]}

    return _by_blocks(lambda some: _in_runs(some, runs), anchors, shard)


def _in_piece(anchors: Floats, piece: _Shard) -> Arrays:
    tree = _tree(piece.boxes)
    return _by_blocks(lambda some: _in_boxes(some, piece.boxes, tree), anchors, piece)


def _by_blocks(
    work: Callable[[Floats], tuple[Ints, NDArray[np.int32]]], anchors: Floats, shard: _Shard
) -> Arrays:
    starts = range(0, len(anchors), _BLOCK)
    blocks = (anchors[start : start + _BLOCK] for start in starts)
    with ThreadPoolExecutor(min(os.cpu_count() or 1, len(starts))) as pool:
        return _pairs(list(pool.map(work, blocks)), shard)


def _pairs(blocks: list[tuple[Ints, NDArray[np.int32]]], shard: _Shard) -> Arrays:
    counts = np.concatenate([block[0] for block in blocks])
    tiles = np.concatenate([block[1] for block in blocks]) + np.int32(shard.start)
    return {"query": np.repeat(np.arange(len(counts)), counts), "tile": tiles}


def merged(parts: list[Arrays], n_queries: int) -> Positives:
    """Put the pairs of shards together, in the order of the gallery within each query."""
    empty: Arrays = {"query": np.zeros(0, np.int64), "tile": np.zeros(0, np.int32)}
    names = parts[0] if parts else empty
    pairs = {name: np.concatenate([one[name] for one in parts or [empty]]) for name in names}
    if (np.diff(pairs["query"]) < 0).any():
        order = np.argsort(pairs["query"], kind="stable")
        pairs = {name: values[order] for name, values in pairs.items()}
    counts = np.bincount(pairs["query"], minlength=n_queries)
    return Positives(offsets_of(counts), pairs["tile"], pairs.get("overlap"))


def overlapping(polygons: Floats, shard: _Shard) -> Arrays:
    """Find ``query``, ``tile`` and ``overlap`` of the pairs that overlap."""
    whole = np.flatnonzero(np.isfinite(polygons).all(axis=(1, 2)))
    found: dict[str, list[NDArray[Any]]] = {
        "query": [whole[:0]],
        "tile": [np.zeros(0, np.int32)],
        "overlap": [np.zeros(0)],
    }
    for piece in shard.pieces() if len(whole) else ():
        tree = _tree(piece.boxes)
        for start in range(0, len(whole), _BLOCK):
            some = whole[start : start + _BLOCK]
            query, tile = _near(polygons[some], tree, len(piece.boxes))
            ratio = ratios(polygons[some], piece.boxes, query, tile)
            kept = ratio > 0
            found["query"].append(some[query[kept]])
            found["tile"].append((tile[kept] + piece.start).astype(np.int32))
            found["overlap"].append(ratio[kept])
    return {name: np.concatenate(parts) for name, parts in found.items()}


def _in_runs(points: Floats, runs: list[TileRun]) -> tuple[Ints, NDArray[np.int32]]:
    """Tiles of a block of queries: a row of candidates each, sorted, repeats dropped."""
    lon, lat = np.ascontiguousarray(points.reshape(-1, 2).T)
    hits = np.empty((len(lon), sum(run.slots for run in runs)), dtype=np.int32)
    used = 0
    with np.errstate(invalid="ignore", over="ignore"):  # NaN points hit nothing
        for run in runs:
            run.fill(lon, lat, hits[:, used : used + run.slots], _NONE)
            used += run.slots
    hits = hits.reshape(len(points), -1)
    hits.sort(axis=1)
    kept = hits != _NONE
    kept[:, 1:] &= hits[:, 1:] != hits[:, :-1]
    return kept.sum(axis=1), hits[kept]


def _in_boxes(
    points: Floats, boxes: Floats, tree: shapely.STRtree
) -> tuple[Ints, NDArray[np.int32]]:
    """Tiles of a block of queries by the search tree, whatever the tiles are."""
    import shapely

    lon, lat = points.reshape(-1, 2).T
    point, tile = tree.query(shapely.points(lon, lat))
    lon, lat, box = lon[point], lat[point], boxes[tile]
    inside = (box[:, 0] <= lon) & (lon <= box[:, 2]) & (box[:, 1] <= lat) & (lat <= box[:, 3])
    key = np.sort(point[inside] // points.shape[1] * len(boxes) + tile[inside])
    query, tile = np.divmod(key[np.diff(key, prepend=-1) > 0], len(boxes))
    return np.bincount(query, minlength=len(points)), tile.astype(np.int32)


def _near(polygons: Floats, tree: shapely.STRtree, n_tiles: int) -> tuple[Ints, Ints]:
    """Pairs of polygon and tile whose bounding boxes meet, in order."""
    import shapely

    bounds = np.concatenate([polygons.min(axis=1), polygons.max(axis=1)], axis=1)
    query, tile = tree.query(shapely.box(*bounds.T))
    key = np.sort(query * n_tiles + tile)
    return key // max(n_tiles, 1), key % max(n_tiles, 1)


def ratios(polygons: Floats, boxes: Floats, query: Ints, tile: NDArray[np.integer[Any]]) -> Floats:
    """Intersection over union of pairs, in blocks."""
    shapes = untangled(polygons)
    found = np.zeros(len(query))
    for start in range(0, len(query), _PAIRS):
        part = slice(start, start + _PAIRS)
        shape, box = shapes[query[part]], boxes[tile[part]]
        common = intersection_areas(shape, box)
        size = box_areas(box)
        union = polygon_areas(shape) + size - common
        # A NaN corner makes `common` NaN, which is not above the rounding either.
        overlapping = common > _TOUCH * size
        np.divide(common, union, out=found[part], where=overlapping)
    return np.minimum(found, 1)


def _tree(boxes: Floats) -> shapely.STRtree:
    import shapely

    return shapely.STRtree(shapely.box(*boxes.T))
