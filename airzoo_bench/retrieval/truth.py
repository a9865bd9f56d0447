"""The truth of one scene: queries, tiles, and which answers which; in memory and in its folder."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import conditions_of, read_excluded, read_queries
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
IMAGE_COLUMNS = ("id", "image")
"""Of the tiles of a gallery of images, next to one of `POSITION_COLUMNS`, or none."""
POSITION_COLUMNS = (("image_lon", "image_lat"), ("image_x_m", "image_y_m"))
"""Where an image is: degrees, or metres of a plane."""

NO_GROUND_POINT = "no ray meets the ground"
UNANSWERED = "positives.npz gives it no tile"

_WINDOW_COLUMNS = ("size_px", "size_m", "x", "y", "width", "height")
_TILE_COLUMNS = ("id", *_WINDOW_COLUMNS, *BOX_COLUMNS, "valid_share")
_EARTH_RADIUS_M = 6_371_000.0
_AGAIN = "prepare the benchmark again"


@dataclass(frozen=True, eq=False)
class Positives:
    """The positive tiles of every query, sparse: q has `tiles[offsets[q] : offsets[q + 1]]`."""

    offsets: Ints  # (Q + 1,)
    tiles: NDArray[np.int32]  # (P,) rows of the gallery table, ascending within each query
    overlap: Floats | None = None  # (P,) overlap ratio of footprint and tile, where it is known

    @property
    def n_queries(self) -> int:
        """Number of queries."""
        return len(self.offsets) - 1

    @property
    def counts(self) -> Ints:
        """Number of positives of each query, (Q,)."""
        return np.diff(self.offsets)

    @property
    def queries(self) -> Ints:
        """Query of each pair, (P,)."""
        return np.repeat(np.arange(self.n_queries), self.counts)

    def of_query(self, query: int) -> NDArray[np.int32]:
        """Return the positive tiles of one query."""
        return self.tiles[self.offsets[query] : self.offsets[query + 1]]

    def holds(self, queries: Ints, tiles: NDArray[np.integer[Any]], n_tiles: int) -> Bools:
        """Tell which pairs of query and tile are positive, `n_tiles` tiles in the gallery."""
        keys, asked = self.queries * n_tiles + self.tiles, queries * n_tiles + tiles
        if not len(keys):
            return np.zeros(asked.shape, np.bool_)
        place = np.minimum(np.searchsorted(keys, asked), len(keys) - 1)
        return np.asarray(keys[place] == asked)

    def pairs(self, queries: Ints) -> Ints:
        """Return the places in `tiles` of the pairs of some queries, in their order."""
        counts = self.counts[queries]
        offsets = offsets_of(counts)
        within = np.arange(offsets[-1]) - np.repeat(offsets[:-1], counts)
        return np.asarray(np.repeat(self.offsets[queries], counts) + within)

    def take(self, queries: Ints) -> Positives:
        """Return the positives of some queries, in their order."""
        pairs = self.pairs(queries)
        overlap = None if self.overlap is None else self.overlap[pairs]
        return Positives(offsets_of(self.counts[queries]), self.tiles[pairs], overlap)

    def where(self, kept: Bools) -> Positives:
        """Return some of the pairs, of the same queries."""
        counts = np.bincount(self.queries[kept], minlength=self.n_queries)
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

    @property
    def of_images(self) -> bool:
        """Whether the gallery is a set of images, not cut from a map."""
        return "image" in self.tiles.columns

    @property
    def positions(self) -> tuple[Floats, Floats] | None:
        """Where queries (Q, 2) and images (G, 2) are, if the benchmark gives that."""
        columns = _position_columns(self.tiles)
        if not columns:
            return None
        queries, tiles = (table[columns].to_numpy(float) for table in (self.footprints, self.tiles))
        return queries, tiles

    @property
    def boxes(self) -> Floats:
        """Tile boxes (G, 4): lon_min, lat_min, lon_max, lat_max in degrees."""
        return boxes_of(self.tiles)

    @property
    def footprint_centres(self) -> Floats:
        """Footprint centres (Q, 2): lon, lat in degrees; NaN without a ground point."""
        return self.footprints[list(FOOTPRINT_COLUMNS)].to_numpy(np.float64)

    @property
    def conditions(self) -> pd.DataFrame:
        """The columns of the queries that are neither identity nor geometry."""
        return conditions_of(self.queries)

    @property
    def without_ground_point(self) -> int:
        """How many photos of the scene have no ground point, left out or not."""
        if self.of_images or not set(FOOTPRINT_COLUMNS) <= set(self.footprints):
            return 0  # of a sealed truth, nobody may know
        blind = np.isnan(self.footprint_centres).any(axis=1).sum()
        return int(blind + (self.excluded["reason"] == NO_GROUND_POINT).sum())

    @property
    def fingerprint(self) -> str:
        """SHA-256 over ids, geometry and positives; a score that reads more adds it here."""
        digest = hashlib.sha256()
        for ids in (self.queries["id"], self.tiles["id"]):
            digest.update("\n".join(ids.to_numpy(object)).encode() + b"\0")
        geometry: tuple[Floats, ...] = self.positions or ()
        if not self.of_images:
            sizes = self.tiles["size_m"].to_numpy(np.float64)
            geometry = (self.boxes, sizes, self.footprint_centres)
        for array in geometry:
            digest.update(array.astype("<f8").tobytes())
        for indices in (self.positives.offsets, self.positives.tiles):
            digest.update(indices.astype("<i8").tobytes())
        return digest.hexdigest()


def _position_columns(tiles: pd.DataFrame) -> list[str]:
    """Return the columns of `POSITION_COLUMNS` that a table of images has."""
    found = [list(names) for names in POSITION_COLUMNS if set(names) <= set(tiles.columns)]
    return found[0] if found and "image" in tiles.columns else []


def boxes_of(tiles: pd.DataFrame) -> Floats:
    """Return boxes (G, 4) of tiles: lon_min, lat_min, lon_max, lat_max in degrees."""
    return tiles[list(BOX_COLUMNS)].to_numpy(np.float64)


def write_truth(folder: Path, truth: RetrievalTruth, overlaps: Positives) -> None:
    """Write a scene's truth below its folder, next to ``queries.csv``."""
    home = folder / "retrieval"
    home.mkdir(parents=True, exist_ok=True)
    for name in ("footprints", "excluded", "dropped_tiles"):
        getattr(truth, name).to_csv(home / f"{name}.csv", index=False, lineterminator="\n")
    truth.tiles.to_parquet(home / "tiles.parquet", index=False)
    for name, pairs in (("positives", truth.positives), ("overlaps", overlaps)):
        arrays: dict[str, NDArray[Any]] = {"offsets": pairs.offsets, "tiles": pairs.tiles}
        if pairs.overlap is not None:
            arrays["overlap"] = pairs.overlap
        write_npz(home / f"{name}.npz", arrays, compress=True)


def scene_truth(benchmark: Benchmark, scene: str) -> RetrievalTruth:
    """Read a scene's truth; where it is sealed, queries and tiles without any answer."""
    folder = benchmark.scene_folder(scene)
    if not benchmark.is_sealed:
        rules = benchmark.file.tracks["retrieval"]["ground_truth"]
        return read_truth(folder, scene, exclude_unanswered=rules["without_positive"] == "exclude")
    excluded = read_excluded(benchmark, scene, "retrieval")
    queries, tiles = read_queries(folder, excluded), read_tiles(folder / "retrieval")
    dropped = _read_tile_table(folder / "retrieval" / "dropped_tiles.csv")
    positives = Positives(np.zeros(len(queries) + 1, np.int64), np.zeros(0, np.int32))
    footprints = queries[["id"]].assign(**dict.fromkeys(FOOTPRINT_COLUMNS, np.nan))
    return RetrievalTruth(scene, queries, footprints, tiles, positives, excluded, dropped)


def read_truth(folder: Path, scene: str, *, exclude_unanswered: bool = False) -> RetrievalTruth:
    """Read a scene's truth; where `exclude_unanswered`, queries without a positive are excluded."""
    home = folder / "retrieval"
    excluded = read_table(home / "excluded.csv", ("id", "image", "reason"))
    queries, tiles = read_queries(folder, excluded), read_tiles(home)
    footprints = _read_footprints(home / "footprints.csv", queries, tiles)
    dropped = _read_tile_table(home / "dropped_tiles.csv")
    positives = _read_positives(home / "positives.npz", len(queries), len(tiles))
    truth = RetrievalTruth(scene, queries, footprints, tiles, positives, excluded, dropped)
    if exclude_unanswered and not (positives.counts > 0).all():
        truth = _without_unanswered(truth)
    if truth.queries.empty:
        raise BenchmarkError(
            f"scene {scene} has no query: {counted(len(truth.excluded), 'photo')} excluded",
            where=home / "excluded.csv",
            expected="at least one photo that a tile answers",
            fix=f"{_AGAIN} with other photos, or leave the scene out of the protocol",
        )
    return truth


def _without_unanswered(truth: RetrievalTruth) -> RetrievalTruth:
    """Exclude queries without a positive, as `prepare` does; a folder made by hand has some."""
    right = truth.positives.counts > 0
    lacking = truth.queries.loc[~right, ["id", "image"]].assign(reason=UNANSWERED)
    return replace(
        truth,
        queries=truth.queries[right].reset_index(drop=True),
        footprints=truth.footprints[right].reset_index(drop=True),
        positives=truth.positives.take(np.flatnonzero(right)),
        excluded=pd.concat([truth.excluded, lacking]).sort_values("id", ignore_index=True),
    )


def read_tiles(home: Path) -> pd.DataFrame:
    """Read the table of a scene's tiles from the folder of its retrieval track."""
    path = home / "tiles.parquet"
    tiles = _read_tile_table(path)
    ids = tiles["id"].tolist()
    falls = np.zeros(len(ids), np.bool_)
    falls[1:] = [*map(str.__gt__, ids, ids[1:])]
    refuse_cells(path, "id", ids, falls, "rows sorted by id, as positives count them")
    if "image" in tiles.columns:
        return tiles
    west, south, east, north = boxes_of(tiles).T
    wide = ~((west <= east) & (east - west < 180))  # also tells NaN
    refuse_cells(path, "lon_min", west, wide, "at most lon_max, less than 180 below it", ids)
    refuse_cells(path, "lat_min", south, ~(south <= north), "at most lat_max", ids)
    # Boxes are up to 1.41 times as large as the tiles of a turned map.
    height, width = north - south, (east - west) * np.cos(np.radians((north + south) / 2))
    sides, sizes = np.radians((height + width) / 2) * _EARTH_RADIUS_M, tiles["size_m"].to_numpy()
    wrong = ~((sizes > sides / 1.5) & (sizes < sides * 1.1))
    refuse_cells(path, "size_m", sizes, wrong, "the tile's side in metres, near its box's", ids)
    return tiles


def _read_tile_table(path: Path) -> pd.DataFrame:
    """Read a table of tiles or, as its columns tell, of images."""
    found = read_table(path, ("id",))
    if "image" in found:
        return require_columns(path, found, IMAGE_COLUMNS, _position_columns(found))
    return require_columns(path, found, _TILE_COLUMNS, _TILE_COLUMNS[1:])


def _read_footprints(path: Path, queries: pd.DataFrame, tiles: pd.DataFrame) -> pd.DataFrame:
    positions, of_images = _position_columns(tiles), "image" in tiles.columns
    needed = positions if of_images else FOOTPRINT_COLUMNS
    footprints = read_table(path, ("id", *needed), complete=positions)
    if not footprints["id"].array.equals(queries["id"].array):
        raise BenchmarkError("the footprints are not those of queries.csv", where=path, fix=_AGAIN)
    if not of_images and len(queries):  # latitudes and longitudes may be exchanged
        boxes = boxes_of(tiles)
        low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
        away = footprints[list(FOOTPRINT_COLUMNS)].to_numpy(np.float64) - (low + high) / 2
        away[:, 0] = (away[:, 0] + 180.0) % 360.0 - 180.0
        far = (np.abs(away) > 1.5 * (high - low)).any(axis=1)
        expected = f"longitudes near the tiles' {low[0]:.6f} to {high[0]:.6f}: is it a latitude?"
        lons = footprints["footprint_lon"]
        refuse_cells(path, "footprint_lon", lons, far & (far.mean() > 0.5), expected)
    return footprints


def _read_positives(path: Path, n_queries: int, n_tiles: int) -> Positives:
    if not path.is_file():
        raise BenchmarkError(
            "the benchmark folder has no truth here",
            where=path,
            fix=f"{_AGAIN}; `check` needs no truth, `eval` does",
        )
    try:
        # No more than each query's offset, and the tile and overlap of every pair there can be.
        file = NpzFile(path, 8 * (n_queries + 1 + 2 * n_queries * n_tiles))
        found = {name: file.read(name) for name in {"offsets", "tiles", "overlap"} & file.names()}
    except PredictionError as error:
        what, found = f"the positives are damaged: {error.what}", {}
    else:
        what = "the positives are damaged, or not those of the queries and tiles beside them"
    if not _are_sound(found, n_queries, n_tiles):
        raise BenchmarkError(
            what,
            where=path,
            expected=f"offsets ({n_queries + 1},) that rise from 0, tiles below {n_tiles} that "
            "ascend within each query, overlaps (if any) from 0 to 1",
            fix=_AGAIN,
        )
    overlap = found["overlap"].astype(np.float64) if "overlap" in found else None
    return Positives(found["offsets"].astype(np.int64), found["tiles"].astype(np.int32), overlap)


def _are_sound(found: dict[str, NDArray[Any]], n_queries: int, n_tiles: int) -> bool:
    """Tell whether stored positives fit these numbers of queries and tiles."""
    if not {"offsets", "tiles"} <= found.keys():
        return False
    offsets, tiles, overlap = found["offsets"], found["tiles"], found.get("overlap")
    overlap = np.zeros(tiles.shape) if overlap is None else overlap
    if not {offsets.dtype.kind, tiles.dtype.kind} <= {*"iu"} or overlap.dtype.kind not in "fiu":
        return False
    if offsets.shape != (n_queries + 1,) or tiles.ndim != 1 or overlap.shape != tiles.shape:
        return False
    offsets = offsets.astype(np.int64)
    counts: Ints = offsets[1:] - offsets[:-1]
    if offsets[0] != 0 or offsets[-1] != len(tiles) or (counts < 0).any():
        return False
    pairs = np.repeat(np.arange(n_queries), counts) * n_tiles + tiles
    inside = (tiles >= 0) & (tiles < n_tiles) & (overlap >= 0) & (overlap <= 1)
    return bool(inside.all() and (np.diff(pairs) > 0).all())
