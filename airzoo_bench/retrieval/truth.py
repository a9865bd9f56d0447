"""The truth of one scene of the retrieval track, in memory and in the benchmark folder."""

from __future__ import annotations

import hashlib
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark import read_table
from airzoo_bench.errors import BenchmarkError
from airzoo_bench.files import write_npz
from airzoo_bench.retrieval.pairs import Positives

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "ANCHOR_COLUMNS",
    "BOX_COLUMNS",
    "CENTRE_COLUMNS",
    "DISTORTION_COLUMNS",
    "FOOTPRINT_COLUMNS",
    "INTRINSICS_COLUMNS",
    "QUATERNION_COLUMNS",
    "RetrievalTruth",
    "read_truth",
    "write_truth",
]

BOX_COLUMNS = ("lon_min", "lat_min", "lon_max", "lat_max")
INTRINSICS_COLUMNS = ("fx", "fy", "cx", "cy")
DISTORTION_COLUMNS = ("k1", "k2", "p1", "p2", "k3")
QUATERNION_COLUMNS = ("qw", "qx", "qy", "qz")
CENTRE_COLUMNS = ("x", "y", "z")
ANCHOR_COLUMNS = tuple(f"anchor{i}_{axis}" for i in range(4) for axis in ("lon", "lat"))
FOOTPRINT_COLUMNS = ("footprint_lon", "footprint_lat")
_QUERY_COLUMNS = ("id", "image", *FOOTPRINT_COLUMNS)
_NOT_CONDITIONS = {
    *("id", "image", "width", "height"),
    *INTRINSICS_COLUMNS,
    *DISTORTION_COLUMNS,
    *QUATERNION_COLUMNS,
    *CENTRE_COLUMNS,
    *ANCHOR_COLUMNS,
    *FOOTPRINT_COLUMNS,
}
_TILE_COLUMNS = ("id", "size_px", "size_m", "x", "y", "width", "height", *BOX_COLUMNS)


@dataclass(frozen=True)
class RetrievalTruth:
    """Queries, tiles and which answers which.

    Attributes
    ----------
    scene : str
        The scene's id.
    queries : DataFrame
        A row a query, sorted by ``id``; with the footprint's centre and the conditions.
    tiles : DataFrame
        A row a tile, sorted by ``id``; the row's number is the tile's index.
    positives : Positives
        Tile indices that answer each query.
    excluded : DataFrame
        Photos that are no queries, with the reason.
    """

    scene: str
    queries: pd.DataFrame
    tiles: pd.DataFrame
    positives: Positives
    excluded: pd.DataFrame

    @property
    def boxes(self) -> NDArray[np.float64]:
        """Tile boxes (G, 4): lon_min, lat_min, lon_max, lat_max in degrees."""
        return self.tiles[list(BOX_COLUMNS)].to_numpy(np.float64)

    @property
    def footprint_centres(self) -> NDArray[np.float64]:
        """Footprint centres (Q, 2): lon, lat in degrees; NaN without a ground point."""
        return self.queries[list(FOOTPRINT_COLUMNS)].to_numpy(np.float64)

    @property
    def conditions(self) -> pd.DataFrame:
        """The columns of the queries that are neither identity nor geometry."""
        names = [name for name in self.queries.columns if name not in _NOT_CONDITIONS]
        return self.queries[names].reset_index(drop=True)

    @property
    def fingerprint(self) -> str:
        """SHA-256 over all that a score is computed from."""
        digest = hashlib.sha256()
        for ids in (self.queries["id"], self.tiles["id"]):
            digest.update("\n".join(ids).encode() + b"\0")
        for array in (self.boxes, self.footprint_centres):
            digest.update(array.astype("<f8").tobytes())
        for indices in (self.positives.offsets, self.positives.tiles):
            digest.update(indices.astype("<i8").tobytes())
        return digest.hexdigest()


def write_truth(folder: Path, truth: RetrievalTruth, overlaps: Positives) -> None:
    """Write a scene's truth.

    Parameters
    ----------
    folder : Path
        The scene's folder; made where it is missing.
    truth : RetrievalTruth
        What to write.
    overlaps : Positives
        The overlap ratio of every query-tile pair that overlaps, for those who train with it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    truth.queries.to_csv(folder / "queries.csv", index=False, lineterminator="\n")
    truth.excluded.to_csv(folder / "excluded.csv", index=False, lineterminator="\n")
    truth.tiles.to_parquet(folder / "tiles.parquet", index=False)
    _save_sparse(folder / "positives.npz", truth.positives)
    _save_sparse(folder / "overlaps.npz", overlaps)


def read_truth(folder: Path, scene: str) -> RetrievalTruth:
    """Read a scene's truth.

    Raises
    ------
    BenchmarkError
        A file is missing, lacks a column, or the positives do not fit the tables.
    """
    queries = read_table(folder / "queries.csv", _QUERY_COLUMNS)
    tiles = read_table(folder / "tiles.parquet", _TILE_COLUMNS)
    excluded = read_table(folder / "excluded.csv", ("id", "image", "reason"))
    positives = _load_sparse(folder / "positives.npz", len(queries), len(tiles))
    return RetrievalTruth(scene, queries, tiles, positives, excluded)


def _save_sparse(path: Path, pairs: Positives) -> None:
    arrays: dict[str, NDArray[Any]] = {"offsets": pairs.offsets, "tiles": pairs.tiles}
    if pairs.overlap is not None:
        arrays["overlap"] = pairs.overlap
    write_npz(path, arrays, compress=True)


def _load_sparse(path: Path, n_queries: int, n_tiles: int) -> Positives:
    if not path.is_file():
        raise BenchmarkError(
            "the benchmark folder has no truth here",
            where=path,
            mend="prepare the benchmark again; `check` needs no truth, `eval` does",
        )
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        offsets, tiles = arrays["offsets"], arrays["tiles"]
    except (ValueError, KeyError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise BenchmarkError(
            f"the positives are damaged: {error}",
            where=path,
            expected="offsets and tiles, as `airzoo-bench prepare` wrote them",
            mend="prepare the benchmark again",
        ) from error
    return Positives.checked(
        offsets,
        tiles,
        arrays.get("overlap"),
        n_queries=n_queries,
        n_tiles=n_tiles,
        where=path,
    )
