"""Exact distances between two clouds, in memory where they fit, in tiles on disk where not.

In tiles, both clouds are written to disk in cells (`spill`); a task is a tile of some cells
(`tiles`), done wherever the engine does it. The distances are those of `neighbours`, to the last
bit, whatever the tiles.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.progress import Progress, shown, silent
from airzoo_bench.engines.engine import HERE, Engine
from airzoo_bench.formats.clouds.cloud import CloudSource, Shard, shards_of
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.reconstruction.cloud_sources import (
    EvenSample,
    InMemoryCloud,
    Sampled,
    concatenated,
    finite_pieces,
)
from airzoo_bench.reconstruction.distances.boxes import gather, morton_order
from airzoo_bench.reconstruction.distances.neighbours import mutual_distances
from airzoo_bench.reconstruction.distances.spill import (
    Cells,
    Runs,
    SpilledCloud,
    cells_of,
    spill_folder,
    spilled,
    write_part,
)
from airzoo_bench.reconstruction.distances.tiles import (
    Side,
    Sides,
    Tile,
    tile_distances,
    tiles_of,
)

__all__ = ["CloudDistances", "block_distances", "cloud_distances"]

_SAMPLE = 1 << 17
_BOUNDING = 1 << 15
_PIECE = 1 << 18
# Points of each cloud that are about a second of work, and 100 MB of memory.
_TILE = 1 << 19
_CELLS = 8  # of a tile; neighbours of other tiles are read cell by cell


@dataclass(frozen=True, eq=False)
class CloudDistances:
    """Nearest distances both ways, infinite where nothing is predicted.

    Attributes
    ----------
    to_truth : (P,) float64
        From each finite predicted point to the true cloud, in the order of the source.
    to_prediction : (T,) float64
        From each finite true point to the predicted cloud.
    """

    to_truth: Floats
    to_prediction: Floats


def cloud_distances(
    prediction: CloudSource,
    truth: CloudSource,
    *,
    block_points: int,
    jobs: int,
    engine: Engine = HERE,
    progress: Progress = silent,
) -> CloudDistances:
    """Exact nearest distances between two clouds, both ways."""
    most = max(prediction.count, truth.count)
    in_shards = len(shards_of(prediction)) > 1 and len(shards_of(truth)) > 1
    if most > block_points or (in_shards and len(engine.cut(most, _TILE)) > 1):
        _require_truth(_any(truth, block_points))
        if not _any(prediction, block_points):
            points = sum(map(len, finite_pieces(truth, block_points)))
            return CloudDistances(np.zeros(0), np.full(points, np.inf))
    else:
        # Small clouds are read once, and cut only where there are others to help.
        predicted, true = (
            concatenated(finite_pieces(cloud, block_points)) for cloud in (prediction, truth)
        )
        _require_truth(len(true) > 0)
        most = max(len(predicted), len(true))
        if not len(predicted) or len(engine.cut(most, _TILE)) == 1:
            measure = partial(mutual_distances, predicted, true, jobs=jobs)
            return CloudDistances(*shown(measure, "distances", progress))
        prediction, truth = InMemoryCloud(predicted), InMemoryCloud(true)
    return block_distances(
        prediction,
        truth,
        block_points=block_points,
        jobs=jobs,
        engine=engine,
        progress=progress,
    )


def _any(cloud: CloudSource, points: int) -> bool:
    known = isinstance(cloud, Sampled) and len(cloud.sample) > 0
    return known or any(len(piece) for piece in finite_pieces(cloud, points))


def _require_truth(there: bool) -> None:
    if not there:
        raise BenchmarkError(
            "the true cloud holds no finite point",
            expected="at least one point, after cropping too",
            fix="check the benchmark's cloud and the protocol's crop",
        )


def block_distances(
    prediction: CloudSource,
    truth: CloudSource,
    *,
    block_points: int,
    jobs: int,
    engine: Engine = HERE,
    progress: Progress = silent,
) -> CloudDistances:
    """Nearest distances both ways, in memory that holds the distances and a tile of both clouds."""
    clouds = prediction, truth
    samples = [_sample(cloud, block_points) for cloud in clouds]
    most = max(cloud.count for cloud in clouds)
    tile_points = min(block_points, -(-most // len(engine.cut(most, _TILE))))
    cells = cells_of(np.concatenate(samples), _CELLS * -(-most // tile_points))
    spilling = _Spilling(cells, min(block_points, _PIECE), max(1, tile_points // 4))
    with spill_folder() as folder:
        one, other = _both_spilled(clouds, folder, spilling, engine)
        shared = Sides((_side(one, samples[0]), _side(other, samples[1])), jobs)
        tiles = tiles_of((one, other), _CELLS, 2 * tile_points)
        done = engine.map(tile_distances, tiles, shared=shared, stage="cells", name=_name)
        squared = np.empty(one.count), np.empty(other.count)
        for found in progress(done, "cells", len(tiles)):
            for which, values in enumerate(squared):
                values[found[f"numbers_{which}"]] = found[f"squared_{which}"]
    to_truth, to_prediction = (np.sqrt(values, out=values) for values in squared)
    return CloudDistances(to_truth, to_prediction)


def _sample(cloud: CloudSource, points: int) -> Floats:
    if isinstance(cloud, Sampled) and len(cloud.sample):
        return cloud.sample
    sample = EvenSample(cloud.count, _SAMPLE)
    for piece in finite_pieces(cloud, points):
        sample.add(piece)
    return sample.points()


@dataclass(frozen=True, eq=False)
class _Spilling:
    """How a cloud is written to disk: by which cells, so many points at a time and in a run."""

    cells: Cells
    points: int
    most: int


def _both_spilled(
    clouds: tuple[CloudSource, CloudSource], folder: Path, spilling: _Spilling, engine: Engine
) -> tuple[SpilledCloud, SpilledCloud]:
    """Write both clouds to disk: of those in memory, which take seconds, at the same time."""
    paths = folder / "prediction", folder / "truth"
    write = partial(_spilled, spilling=spilling, engine=engine)
    if not all(isinstance(cloud, InMemoryCloud) for cloud in clouds):
        return write(clouds[0], paths[0]), write(clouds[1], paths[1])
    with ThreadPoolExecutor(2) as pool:
        one, other = pool.map(write, clouds, paths)
    return one, other


def _spilled(cloud: CloudSource, path: Path, spilling: _Spilling, engine: Engine) -> SpilledCloud:
    """Write a cloud to disk, each of its shards where the engine does it."""
    shards = shards_of(cloud)
    # Paths stand in the items, so that no run takes the files of another for its own.
    items = [(shard, path.with_name(f"{path.name}-{shard.number}")) for shard in shards]
    where = engine if len(shards) > 1 else HERE
    parts = where.map(
        _spilled_shard, items, shared=spilling, stage="shards", name=lambda item: item[0].name
    )
    return spilled([place for _, place in items], list(parts), most=spilling.most)


def _spilled_shard(spilling: _Spilling, item: tuple[Shard, Path]) -> Runs:
    shard, path = item
    pieces = finite_pieces(shard.source, spilling.points)
    return write_part(path, pieces, spilling.cells, most=spilling.most)


def _side(cloud: SpilledCloud, sample: Floats) -> Side:
    some = sample[:: -(-len(sample) // _BOUNDING)]
    return Side(cloud, gather(some, morton_order(some)))


def _name(tile: Tile) -> str:
    return f"blocks {tile.blocks[0]} of the predicted cloud, {tile.blocks[1]} of the true one"
