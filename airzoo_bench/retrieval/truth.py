"""The truth of one scene of the retrieval track, in memory and in the benchmark folder."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.benchmark.queries import conditions_of, read_queries
from airzoo_bench.benchmark.tables import read_table
from airzoo_bench.core.errors import BenchmarkError, counted
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.retrieval.pairs import Positives, read_pairs, write_pairs

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "ANCHOR_COLUMNS",
    "BOX_COLUMNS",
    "FOOTPRINT_COLUMNS",
    "IMAGE_COLUMNS",
    "LONLAT_DECIMALS",
    "NO_GROUND_POINT",
    "NO_TILE",
    "POSITION_COLUMNS",
    "UNANSWERED",
    "RetrievalTruth",
    "boxes_of",
    "read_tile_table",
    "read_tiles",
    "read_truth",
    "write_truth",
]

LONLAT_DECIMALS = 9
"""Degrees are kept to 0.1 mm, so that two builds of PROJ give the same truth."""

BOX_COLUMNS = ("lon_min", "lat_min", "lon_max", "lat_max")
ANCHOR_COLUMNS = tuple(f"anchor{i}_{axis}" for i in range(4) for axis in ("lon", "lat"))
FOOTPRINT_COLUMNS = ("footprint_lon", "footprint_lat")
_EARTH_RADIUS_M = 6_371_000.0
NO_GROUND_POINT = "no ray meets the ground"
NO_TILE = "the footprint meets no tile"
UNANSWERED = "positives.npz gives it no tile"
_WINDOW_COLUMNS = ("x", "y", "width", "height")
_TILE_COLUMNS = ("id", "size_px", "size_m", *_WINDOW_COLUMNS, *BOX_COLUMNS, "valid_share")

IMAGE_COLUMNS = ("id", "image")
"""Of the tiles of a gallery of images, next to one of `POSITION_COLUMNS`, or none."""
POSITION_COLUMNS = (("image_lon", "image_lat"), ("image_x_m", "image_y_m"))
"""Where an image is: degrees, or metres of a plane."""


@dataclass(frozen=True)
class RetrievalTruth:
    """Queries, tiles and which answers which.

    Tiles are cut from a map, or are images that the benchmark gives; see `of_images`.

    Attributes
    ----------
    scene : str
        The scene's id.
    queries : DataFrame
        A row a query, sorted by ``id``.
    footprints : DataFrame
        A row a query. With a map: its anchor points on the ground and the footprint's centre, in
        degrees. With images: its position, where the benchmark gives one.
    tiles : DataFrame
        A row a tile, sorted by ``id``; the row's number is the tile's index. With a map: window
        and box. With images: the file and, where the benchmark gives one, the position.
    positives : Positives
        Tile indices that answer each query.
    excluded : DataFrame
        Photos that are no queries, with the reason.
    dropped_tiles : DataFrame
        Tiles that are not in the gallery, since they hold too little of the map.
    """

    scene: str
    queries: pd.DataFrame
    footprints: pd.DataFrame
    tiles: pd.DataFrame
    positives: Positives
    excluded: pd.DataFrame
    dropped_tiles: pd.DataFrame

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
        if self.of_images:
            return 0
        if not set(FOOTPRINT_COLUMNS) <= set(self.footprints):  # of a sealed truth, nobody may know
            return 0
        blind = np.isnan(self.footprint_centres).any(axis=1).sum()
        return int(blind + (self.excluded["reason"] == NO_GROUND_POINT).sum())

    @property
    def fingerprint(self) -> str:
        """SHA-256 over all that a score is computed from."""
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
    """Boxes (G, 4) of tiles: lon_min, lat_min, lon_max, lat_max in degrees."""
    return tiles[list(BOX_COLUMNS)].to_numpy(np.float64)


def write_truth(folder: Path, truth: RetrievalTruth, overlaps: Positives) -> None:
    """Write a scene's truth below its folder, next to ``queries.csv``."""
    home = folder / "retrieval"
    home.mkdir(parents=True, exist_ok=True)
    for name in ("footprints", "excluded"):
        getattr(truth, name).to_csv(home / f"{name}.csv", index=False, lineterminator="\n")
    truth.dropped_tiles.to_csv(home / "dropped_tiles.csv", index=False, lineterminator="\n")
    truth.tiles.to_parquet(home / "tiles.parquet", index=False)
    write_pairs(home / "positives.npz", truth.positives)
    write_pairs(home / "overlaps.npz", overlaps)


def read_truth(folder: Path, scene: str, *, answerable: bool = False) -> RetrievalTruth:
    """Read a scene's truth; where `answerable`, queries without a positive are excluded."""
    home = folder / "retrieval"
    excluded = read_table(home / "excluded.csv", ("id", "image", "reason"))
    queries = read_queries(folder, excluded)
    tiles = read_tiles(home)
    footprints = _read_footprints(home / "footprints.csv", tiles)
    dropped = read_tile_table(home / "dropped_tiles.csv")
    if not footprints["id"].array.equals(queries["id"].array):
        raise BenchmarkError(
            "the footprints are not those of queries.csv",
            where=home / "footprints.csv",
            fix="prepare the benchmark again",
        )
    if "image" not in tiles.columns and not queries.empty:
        _check_near(footprints, boxes_of(tiles), home / "footprints.csv")
    positives = read_pairs(home / "positives.npz", len(queries), len(tiles))
    truth = RetrievalTruth(scene, queries, footprints, tiles, positives, excluded, dropped)
    truth = _without_unanswered(truth) if answerable else truth
    if truth.queries.empty:
        raise BenchmarkError(
            f"scene {scene} has no query: {counted(len(truth.excluded), 'photo')} excluded",
            where=home / "excluded.csv",
            expected="at least one photo that a tile answers",
            fix="prepare the benchmark again with other photos, or leave the scene out of the "
            "protocol",
        )
    return truth


def _without_unanswered(truth: RetrievalTruth) -> RetrievalTruth:
    """Exclude queries without a positive, as `prepare` does; a folder made by hand has some."""
    import pandas as pd

    right = truth.positives.counts > 0
    if right.all():
        return truth
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
    tiles = read_tile_table(home / "tiles.parquet")
    _check_sorted(tiles, home / "tiles.parquet")
    if "image" in tiles.columns:
        return tiles
    _check_boxes(boxes_of(tiles), home / "tiles.parquet")
    _check_sizes(tiles, home / "tiles.parquet")
    return tiles


def read_tile_table(path: Path) -> pd.DataFrame:
    """Read a table of tiles or, as its columns tell, of images."""
    found = read_table(path, ("id",))
    if "image" in found.columns:
        return read_table(path, IMAGE_COLUMNS, complete=_position_columns(found))
    return read_table(path, _TILE_COLUMNS, complete=_TILE_COLUMNS[1:])


def _check_sizes(tiles: pd.DataFrame, path: Path) -> None:
    """Refuse sides that are not those of the boxes, which a turned map makes up to 1.41 larger."""
    west, south, east, north = np.radians(boxes_of(tiles)).T
    height, width = north - south, (east - west) * np.cos((north + south) / 2)
    sides = _EARTH_RADIUS_M * (height + width) / 2
    sizes = tiles["size_m"].to_numpy(np.float64)
    wrong = np.flatnonzero(~((sizes > sides / 1.5) & (sizes < sides * 1.1)))
    if wrong.size:
        row = wrong[0]
        raise BenchmarkError(
            f"row {row + 1}, {tiles['id'].iloc[row]}, column size_m: {sizes[row]:g}",
            where=path,
            expected=f"the tile's side in metres; its box is about {sides[row]:.1f} m wide",
            fix="prepare the benchmark again",
        )


def _check_sorted(tiles: pd.DataFrame, path: Path) -> None:
    """Refuse rows out of order: ties are ranked by row, which is to mean by id."""
    ids = tiles["id"].tolist()
    row = next((row for row in range(1, len(ids)) if ids[row] < ids[row - 1]), None)
    if row is not None:
        raise BenchmarkError(
            f"row {row + 1}, {ids[row]}, stands after {ids[row - 1]}",
            where=path,
            expected="rows sorted by id, which positives.npz counts tiles by",
            fix="sort the rows by id and number the tiles in positives.npz and overlaps.npz anew, "
            "or prepare the benchmark again",
        )


def _read_footprints(path: Path, tiles: pd.DataFrame) -> pd.DataFrame:
    if "image" not in tiles.columns:
        return read_table(path, ("id", *FOOTPRINT_COLUMNS))
    columns = _position_columns(tiles)
    return read_table(path, ("id", *columns), complete=columns)


def _check_near(footprints: pd.DataFrame, boxes: Floats, where: Path) -> None:
    """Refuse footprints of which most are farther from the tiles than these reach."""
    low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
    away = footprints[list(FOOTPRINT_COLUMNS)].to_numpy(np.float64) - (low + high) / 2
    away[:, 0] = (away[:, 0] + 180.0) % 360.0 - 180.0
    far = (np.abs(away) > 1.5 * (high - low)).any(axis=1)
    if far.mean() > 0.5:
        lon, lat = footprints[list(FOOTPRINT_COLUMNS)].iloc[int(np.argmax(far))]
        raise BenchmarkError(
            f"centres of {int(far.sum())} of {counted(len(far), 'footprint')} are far from every "
            f"tile, such as longitude {lon:.6f}, latitude {lat:.6f}",
            where=where,
            expected=f"about longitude {low[0]:.6f} to {high[0]:.6f}, latitude {low[1]:.6f} to "
            f"{high[1]:.6f}",
            fix="look whether longitude and latitude are swapped",
        )


def _check_boxes(boxes: Floats, where: Path) -> None:
    west, south, east, north = boxes.T
    good = (west <= east) & (south <= north) & (east - west < 180)  # also tells NaN
    good &= (south >= -90) & (north <= 90) & np.isfinite(boxes).all(axis=1)
    if not good.all():
        row = int(np.flatnonzero(~good)[0])
        raise BenchmarkError(
            f"row {row + 1} is no box in degrees: {boxes[row].tolist()}",
            where=where,
            expected="lon_min <= lon_max less than 180 apart (unwrapped: 179.9 to 180.1 across "
            "the 180th meridian), lat_min <= lat_max between -90 and 90",
            fix="prepare the benchmark again",
        )
