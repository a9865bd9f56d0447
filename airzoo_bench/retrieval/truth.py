"""The truth of one scene: queries, tiles, and which answers which; in memory and in its folder."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import read_excluded, read_queries
from airzoo_bench.benchmark.tables import read_table, refuse_cells, require_columns
from airzoo_bench.core.errors import BenchmarkError, PredictionError, counted
from airzoo_bench.core.files import write_npz
from airzoo_bench.formats.npz import NpzFile
from airzoo_bench.geometry.arrays import Bools, Floats, Ints

LONLAT_DECIMALS = 9
"""Degrees are kept to 0.1 mm, so that two builds of PROJ give the same truth."""

BOX_COLUMNS = ("lon_min", "lat_min", "lon_max", "lat_max")
ANCHOR_COLUMNS = tuple(f"anchor{i}_{axis}" for i in range(4) for axis in ("lon", "lat"))
FOOTPRINT_COLUMNS = ("footprint_lon", "footprint_lat")
TILE_COLUMNS = ("size_px", "size_m", "x", "y", "width", "height", *BOX_COLUMNS, "valid_share")
IMAGE_COLUMNS = ("id", "image")
"""Of the tiles of a gallery of images, next to one of `POSITION_COLUMNS`, or none."""
POSITION_COLUMNS = (("image_lon", "image_lat"), ("image_x_m", "image_y_m"))
"""Where an image is: degrees, or metres of a plane."""

NO_GROUND_POINT = "no ray meets the ground"
UNANSWERED = "positives.npz gives it no tile"
TOO_EMPTY = "without valid pixels, or with too few"

_EARTH_RADIUS_M = 6_371_000.0
_AGAIN = "prepare the benchmark again"


@dataclass(frozen=True, eq=False)
class Positives:
    """The positive tiles of every query, sparse: q has `tiles[offsets[q] : offsets[q + 1]]`."""

    offsets: Ints  # (Q + 1,)
    tiles: NDArray[np.int32]  # (P,) rows of the gallery table, ascending within each query
    overlap: Floats | None = None  # (P,) overlap ratio of footprint and tile, where it is known

    @property
    def counts(self) -> Ints:
        """Number of positives of each query, (Q,)."""
        return np.diff(self.offsets)

    @property
    def queries(self) -> Ints:
        """Query of each pair, (P,)."""
        return np.repeat(np.arange(len(self.counts)), self.counts)

    def tiles_of(self, query: int) -> NDArray[np.int32]:
        """Return the positive tiles of one query."""
        return self.tiles[self.offsets[query] : self.offsets[query + 1]]

    def holds(self, queries: Ints, tiles: NDArray[np.integer[Any]], n_tiles: int) -> Bools:
        """Tell which pairs of query and tile are positive, `n_tiles` tiles in the gallery."""
        keys, asked = self.queries * n_tiles + self.tiles, queries * n_tiles + tiles
        return np.asarray(np.append(keys, -1)[np.searchsorted(keys, asked)] == asked)

    def take(self, queries: Ints) -> Positives:
        """Return the positives of some queries, in their order."""
        counts = self.counts[queries]
        offsets = offsets_of(counts)
        pairs = np.repeat(self.offsets[queries] - offsets[:-1], counts) + np.arange(offsets[-1])
        overlap = None if self.overlap is None else self.overlap[pairs]
        return Positives(offsets, self.tiles[pairs], overlap)

    def where(self, kept: Bools) -> Positives:
        """Return some of the pairs, of the same queries."""
        counts = np.bincount(self.queries[kept], minlength=len(self.counts))
        overlap = None if self.overlap is None else self.overlap[kept]
        return Positives(offsets_of(counts), self.tiles[kept], overlap)


def offsets_of(counts: Ints) -> Ints:
    """Return the offsets (Q + 1,) of groups of the given sizes (Q,)."""
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


@dataclass(frozen=True)
class RetrievalTruth:
    """Queries, tiles and which answers which.

    Tiles are cut from a map (and have windows and boxes), or are images that the benchmark gives
    (with a position each, or none). The number of a tile's row is its index.
    """

    scene: str
    queries: pd.DataFrame  # sorted by id
    footprints: pd.DataFrame  # a row a query: anchor points and their centre, or a position
    tiles: pd.DataFrame  # sorted by id
    positives: Positives
    excluded: pd.DataFrame  # photos that are no queries, with the reason
    dropped_tiles: pd.DataFrame  # not in the gallery, since they hold too little of the map
    overlaps: Positives | None = None  # all pairs that overlap, written for training, never scored

    @property
    def has_images(self) -> bool:
        """Whether the gallery is a set of images, not cut from a map."""
        return "image" in self.tiles.columns

    @property
    def positions(self) -> tuple[Floats, Floats]:
        """Where queries (Q, 2) and images (G, 2) are; of no columns if nobody gives that."""
        columns = position_columns(self.tiles)
        queries, tiles = (table[columns].to_numpy(float) for table in (self.footprints, self.tiles))
        return queries, tiles

    @property
    def tile_centres(self) -> Floats:
        """Centres of the tiles' boxes (G, 2): lon, lat in degrees."""
        boxes = boxes_of(self.tiles)
        return (boxes[:, :2] + boxes[:, 2:]) / 2

    @property
    def footprint_centres(self) -> Floats:
        """Footprint centres (Q, 2): lon, lat in degrees; NaN without a ground point."""
        return self.footprints[list(FOOTPRINT_COLUMNS)].to_numpy(np.float64)

    @property
    def without_ground_point(self) -> int:
        """How many photos of the scene have no ground point, left out or not."""
        if self.has_images:
            return 0
        blind = np.isnan(self.footprint_centres).any(axis=1).sum()
        return int(blind + (self.excluded["reason"] == NO_GROUND_POINT).sum())

    @property
    def fingerprint(self) -> str:
        """SHA-256 over ids, geometry and positives; a score that reads more adds it here."""
        digest = hashlib.sha256()
        for ids in (self.queries["id"], self.tiles["id"]):
            digest.update("\n".join(ids.to_numpy(object)).encode() + b"\0")
        geometry: tuple[Floats, ...] = self.positions
        if not self.has_images:
            sizes = self.tiles["size_m"].to_numpy(float)
            geometry = boxes_of(self.tiles), sizes, self.footprint_centres
        for array in geometry:
            digest.update(array.astype("<f8").tobytes())
        for indices in (self.positives.offsets, self.positives.tiles):
            digest.update(indices.astype("<i8").tobytes())
        return digest.hexdigest()


def position_columns(images: pd.DataFrame) -> list[str]:
    """Return the columns of `POSITION_COLUMNS` that a table of images has; none of other tables."""
    found = (list(names) for names in POSITION_COLUMNS if {"image", *names} <= {*images.columns})
    return next(found, [])


def boxes_of(tiles: pd.DataFrame) -> Floats:
    """Return boxes (G, 4) of tiles: lon_min, lat_min, lon_max, lat_max in degrees."""
    return tiles[list(BOX_COLUMNS)].to_numpy(np.float64)


def write_truth(folder: Path, truth: RetrievalTruth) -> None:
    """Write a scene's truth below its folder, next to ``queries.csv``."""
    home = folder / "retrieval"
    home.mkdir(parents=True, exist_ok=True)
    for name in ("footprints", "excluded", "dropped_tiles"):
        getattr(truth, name).to_csv(home / f"{name}.csv", index=False, lineterminator="\n")
    truth.tiles.to_parquet(home / "tiles.parquet", index=False)
    for name in ("positives", "overlaps"):
        if (pairs := getattr(truth, name)) is not None:
            arrays = {key: value for key, value in vars(pairs).items() if value is not None}
            write_npz(home / f"{name}.npz", arrays, compress=True)


def scene_truth(benchmark: Benchmark, scene: str) -> RetrievalTruth:
    """Read a scene's truth; where it is sealed, queries and tiles without any answer."""
    folder = benchmark.scene_folder(scene)
    if not benchmark.is_sealed:
        rules = benchmark.file.tracks["retrieval"]["ground_truth"]
        return read_truth(folder, scene, exclude_unanswered=rules["without_positive"] == "exclude")
    excluded = read_excluded(benchmark, scene, "retrieval")
    queries, tiles = read_queries(folder, excluded), read_tiles(folder / "retrieval")
    dropped = read_table(folder / "retrieval" / "dropped_tiles.csv", ("id",))
    unknown = dict.fromkeys((*FOOTPRINT_COLUMNS, *position_columns(tiles)), np.nan)
    positives = Positives(np.zeros(len(queries) + 1, np.int64), np.zeros(0, np.int32))
    footprints = queries[["id"]].assign(**unknown)
    return RetrievalTruth(scene, queries, footprints, tiles, positives, excluded, dropped)


def read_truth(folder: Path, scene: str, *, exclude_unanswered: bool = False) -> RetrievalTruth:
    """Read a scene's truth; where `exclude_unanswered`, queries without a positive are excluded.

    `prepare` excludes them itself; a folder made by hand has some.
    """
    home = folder / "retrieval"
    excluded = read_table(home / "excluded.csv", ("id", "image", "reason"))
    queries, tiles = read_queries(folder, excluded), read_tiles(home)
    dropped = read_table(home / "dropped_tiles.csv", ("id",))
    positions = position_columns(tiles)
    needed = positions if "image" in tiles.columns else FOOTPRINT_COLUMNS
    footprints = read_table(home / "footprints.csv", ("id", *needed), complete=positions)
    if not footprints["id"].array.equals(queries["id"].array):
        what, where = "the footprints are not those of queries.csv", home / "footprints.csv"
        raise BenchmarkError(what, where=where, fix=_AGAIN)
    positives = _read_positives(home / "positives.npz", len(queries), len(tiles))
    right = (positives.counts > 0) | (not exclude_unanswered)
    if not right.all():
        lacking = queries.loc[~right, ["id", "image"]].assign(reason=UNANSWERED)
        excluded = pd.concat([excluded, lacking]).sort_values("id", ignore_index=True)
        queries, footprints = (one[right].reset_index(drop=True) for one in (queries, footprints))
        positives = positives.take(np.flatnonzero(right))
    if queries.empty:
        raise BenchmarkError(
            f"scene {scene} has no query: {counted(len(excluded), 'photo')} excluded",
            where=home / "excluded.csv",
            fix=f"{_AGAIN} with other photos, or leave the scene out of the protocol",
        )
    return RetrievalTruth(scene, queries, footprints, tiles, positives, excluded, dropped)


def read_tiles(home: Path) -> pd.DataFrame:
    """Read the table of a scene's tiles from the folder of its retrieval track."""
    path = home / "tiles.parquet"
    tiles = read_table(path, ("id",))
    ids = tiles["id"].tolist()
    falls = np.array([False, *map(str.__gt__, ids, ids[1:])][: len(ids)], np.bool_)
    refuse_cells(path, "id", ids, falls, "rows sorted by id, as positives count them")
    if "image" in tiles.columns:
        return require_columns(path, tiles, IMAGE_COLUMNS, position_columns(tiles))
    require_columns(path, tiles, TILE_COLUMNS, TILE_COLUMNS)
    west, south, east, north = np.radians(boxes_of(tiles)).T
    # Boxes are up to 1.41 times as large as the tiles of a turned map.
    sides = (north - south + (east - west) * np.cos((north + south) / 2)) / 2 * _EARTH_RADIUS_M
    sizes = tiles["size_m"].to_numpy()
    wrong = ~((sizes > sides / 1.5) & (sizes < sides * 1.1))  # also tells NaN
    refuse_cells(path, "size_m", sizes, wrong, "the tile's side in metres, near its box's", ids)
    return tiles


def _read_positives(path: Path, n_queries: int, n_tiles: int) -> Positives:
    """Read pairs of query and tile, and refuse others than the tables of both can have."""
    try:
        # No more than each query's offset, and the tile and overlap of every pair there can be.
        file = NpzFile(path, 8 * (n_queries + 1 + 2 * n_queries * n_tiles))
        offsets, tiles = (
            file.read(name).astype(np.int64, casting="safe") for name in ("offsets", "tiles")
        )
        counts: Ints = np.diff(offsets)
        pairs = np.repeat(np.arange(n_queries), counts) * n_tiles + tiles
        fits = offsets.shape == (n_queries + 1,) and (offsets[0], offsets[-1]) == (0, len(tiles))
        if not (fits and ((tiles >= 0) & (tiles < n_tiles)).all() and (np.diff(pairs) > 0).all()):
            raise ValueError("queries or tiles that the scene lacks, or out of order")
    except (PredictionError, LookupError, TypeError, ValueError) as error:
        raise BenchmarkError(
            f"the positives are damaged, or those of other queries and tiles: {error}",
            where=path,
            fix=f"{_AGAIN}; `check` needs no positives, `eval` does",
        ) from error
    return Positives(offsets, tiles.astype(np.int32))
