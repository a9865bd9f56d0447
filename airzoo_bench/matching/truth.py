"""The truth of one scene of the matching track: queries, their crops, and maps to match them to."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from airzoo_bench.benchmark.folder import Benchmark, needed
from airzoo_bench.benchmark.queries import (
    CAMERA_COLUMNS,
    POSE_COLUMNS,
    PRIOR_COLUMNS,
    cameras_of,
    conditions_of,
    poses_of,
    read_excluded,
    read_queries,
)
from airzoo_bench.benchmark.tables import read_table, refuse_cells
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.files import read_text
from airzoo_bench.geometry.arrays import Ints
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import check_same_crs
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.raster_files import raster_sha256
from airzoo_bench.geometry.rasters import RasterInfo, open_info
from airzoo_bench.storage.urls import ensure_file

CROP_COLUMNS = ("crop_x", "crop_y", "crop_width", "crop_height")
_GRID = ("width", "height", "a", "b", "c", "d", "e", "f")
_ANEW = "prepare the benchmark again"


@dataclass(frozen=True, eq=False)
class ReferenceMap:
    """A map, used for its georeference alone, and the surface model below it."""

    dom: RasterInfo
    dsm: Path
    dsm_sha256: str

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.dom.width, self.dom.height

    @property
    def grid(self) -> dict[str, Any]:
        """Size, geotransform and CRS of the map."""
        transform = [float(value) for value in self.dom.transform[:6]]
        width, height = self.size
        crs = self.dom.crs.to_string()
        return {"width": width, "height": height, "transform": transform, "crs": crs}


@dataclass(frozen=True, eq=False)
class MatchingTruth:
    """Queries with cameras, poses, priors and crops, and the rasters that they are lifted by."""

    scene: str
    queries: pd.DataFrame  # a row a query, sorted by id
    crops: Ints  # (Q, 4), the window of each query in its map: x, y, width, height
    maps: tuple[ReferenceMap, ...]  # one of the whole scene, or one a query
    excluded: pd.DataFrame  # photos that are no queries, with the reason
    own_maps: bool = False  # each query has a map of its own

    def map_of(self, query: int) -> ReferenceMap:
        """Return the map that a query is matched to."""
        return self.maps[query if self.own_maps else 0]

    @property
    def conditions(self) -> pd.DataFrame:
        """Columns of the queries that records repeat, such as weather."""
        return conditions_of(self.queries)

    @cached_property
    def cameras(self) -> Cameras:
        """Cameras of the Q queries."""
        return cameras_of(self.queries)

    @property
    def has_poses(self) -> bool:
        """Whether the true poses are known, as they are unless the benchmark is sealed."""
        return set(POSE_COLUMNS) <= set(self.queries.columns)

    @cached_property
    def poses(self) -> Poses:
        """True poses of the Q queries."""
        return poses_of(self.queries)

    @cached_property
    def priors(self) -> Poses:
        """Prior poses of the Q queries."""
        return poses_of(self.queries, PRIOR_COLUMNS)

    @property
    def fingerprint(self) -> str:
        """SHA-256 over all that a score is computed from."""
        digest = hashlib.sha256("\n".join(self.queries["id"]).encode() + b"\0")
        cameras, poses = self.cameras, self.poses
        for array in (
            *(cameras.width, cameras.height, cameras.focal, cameras.principal_point),
            *(cameras.distortion, poses.rotation, poses.centres, self.crops),
        ):
            digest.update(array.astype("<f8").tobytes())
        for one in self.maps:
            digest.update(repr([*one.grid.values()]).encode() + one.dsm_sha256.encode())
        return digest.hexdigest()


def with_truth_as_prior(queries: pd.DataFrame) -> pd.DataFrame:
    """Return the queries with their true poses as priors, for a protocol that says so."""
    pairs = zip(PRIOR_COLUMNS, POSE_COLUMNS, strict=True)
    return queries.assign(**{prior: queries[pose] for prior, pose in pairs})


def own_map(folder: Path, photo: str) -> tuple[Path, Path]:
    """Return the files of a photo's own map and surface model."""
    name = photo.split("/", 1)[1]
    return folder / f"{name}_dom.tif", folder / f"{name}_dsm.tif"


def write_truth(folder: Path, truth: MatchingTruth) -> None:
    """Write a scene's truth below its folder, next to ``queries.csv``."""
    home, ids = folder / "matching", truth.queries[["id"]]
    home.mkdir(parents=True, exist_ok=True)
    crops = dict(zip(CROP_COLUMNS, truth.crops.T, strict=True))
    tables = {"crops.csv": ids.assign(**crops), "excluded.csv": truth.excluded}
    if truth.own_maps:
        rows = [
            (*one.size, *map(repr, one.grid["transform"]), one.grid["crs"], one.dsm_sha256)
            for one in truth.maps
        ]
        grids = pd.DataFrame(rows, columns=[*_GRID, "crs", "dsm_sha256"])
        tables["maps.csv"] = pd.concat((ids.reset_index(drop=True), grids), axis=1)
    else:
        text = json.dumps(truth.maps[0].grid, indent=1)
        (home / "map.json").write_text(text + "\n", encoding="utf-8")
    for name, table in tables.items():
        table.to_csv(home / name, index=False, lineterminator="\n")


def read_truth(benchmark: Benchmark, scene: str) -> MatchingTruth:
    """Read a scene's truth, and check that its surface model and map are the prepared ones."""
    folder, entry = benchmark.scene_folder(scene), benchmark.scene(scene)
    excluded = read_excluded(benchmark, scene, "matching")
    prior = benchmark.file.tracks.get("matching", {}).get("prior", {}).get("source")
    is_truth = prior in ("truth", "given")
    poses = () if benchmark.is_sealed else POSE_COLUMNS
    columns = (*CAMERA_COLUMNS, *poses, *(() if is_truth else PRIOR_COLUMNS))
    queries = read_queries(folder, excluded, columns)
    if is_truth:
        queries = with_truth_as_prior(queries)
    home, ids = folder / "matching", queries["id"].tolist()
    if entry.maps is None:
        dom, grid = benchmark.resolve(needed(entry.dom, "map", scene)), home / "map.json"
        try:
            prepared = dict(json.loads(read_text(grid, BenchmarkError, "grid of the map")))
        except (ValueError, TypeError) as error:
            raise BenchmarkError(f"not JSON: {error}", where=grid, fix=_ANEW) from error
        files = [(dom, benchmark.resolve(entry.dsm or ""), entry.dsm_sha256, prepared)]
    else:
        table, own = home / "maps.csv", benchmark.resolve(entry.maps)
        files = []
        for row in _read_rows(table, (*_GRID, "crs", "dsm_sha256"), ids).to_dict("records"):
            prepared = {"width": int(row["width"]), "height": int(row["height"])}
            prepared |= {"transform": [float(row[one]) for one in _GRID[2:]], "crs": row["crs"]}
            files.append((*own_map(own, row["id"]), str(row["dsm_sha256"]), prepared))
    maps = tuple(_checked_map(*one) for one in files)
    rows = _read_rows(home / "crops.csv", CROP_COLUMNS, ids)
    crops = rows[list(CROP_COLUMNS)].to_numpy(np.int64)
    sizes = np.broadcast_to([one.size for one in maps], (len(ids), 2))
    outside = (crops < (0, 0, 1, 1)).any(axis=1) | (crops[:, :2] + crops[:, 2:] > sizes).any(axis=1)
    refuse_cells(home / "crops.csv", "id", ids, outside, "windows inside the map")
    return MatchingTruth(scene, queries, crops, maps, excluded, own_maps=entry.maps is not None)


def _read_rows(path: Path, columns: Sequence[str], ids: list[str]) -> pd.DataFrame:
    """Read a table that has a row for each query, in their order."""
    table = read_table(path, ("id", *columns))
    if table["id"].tolist() != ids:
        raise BenchmarkError("the rows are not those of queries.csv", where=path, fix=_ANEW)
    return table


def _checked_map(
    dom: Path, dsm: Path, dsm_sha256: str | None, prepared: dict[str, Any]
) -> ReferenceMap:
    """Open a map with the grid and surface model that were prepared."""
    found = ReferenceMap(open_info(dom), dsm, dsm_sha256 or "")
    if prepared | {"crs": found.grid["crs"]} != found.grid:  # one CRS has several spellings
        raise BenchmarkError(
            f"the map has another grid than the prepared one: {json.dumps(found.grid)}",
            where=dom,
            expected=json.dumps(prepared),
            fix=f"put the map back, or {_ANEW}",
        )
    check_same_crs(found.dom.crs, prepared.get("crs"), f"{dom} and the map that was prepared")
    check_dsm(dsm, dsm_sha256)
    return found


def check_dsm(dsm: Path, prepared: str | None) -> None:
    """Refuse a surface model that is not the one that was prepared."""
    if not ensure_file(dsm).is_file() or raster_sha256(dsm) != prepared:
        raise BenchmarkError(
            "the surface model is not there, or not the one that was prepared",
            where=dsm,
            expected=f"a raster with the SHA-256 {(prepared or 'none')[:12]}…",
            fix="put it back where benchmark.toml says, with its side files (.aux.xml, .msk, world "
            f"file), or prepare with --copy; or {_ANEW}",
        )
