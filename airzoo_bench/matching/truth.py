"""The truth of one scene of the matching track, and the crops that its queries are matched to."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

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
from airzoo_bench.benchmark.tables import read_table
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.geometry.arrays import Bools, Ints
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import RasterInfo, open_info
from airzoo_bench.matching.maps import (
    ReferenceMap,
    check_dsm,
    check_map,
    dsm_checksum,
    grid_of,
    read_own_maps,
    write_own_maps,
)

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["CROP_COLUMNS", "MatchingTruth", "read_truth", "with_truth_as_prior", "write_truth"]

CROP_COLUMNS = ("crop_x", "crop_y", "crop_width", "crop_height")


@dataclass(frozen=True, eq=False)
class MatchingTruth:
    """Queries with cameras, poses, priors and crops, and the rasters that they are lifted by.

    Attributes
    ----------
    scene : str
        The scene's id.
    queries : DataFrame
        A row a query, sorted by ``id``.
    crops : (Q, 4) int64
        Window of each query in its map: x, y, width, height in pixels.
    maps : tuple of ReferenceMap
        One of the whole scene, or one a query, in their order.
    excluded : DataFrame
        Photos that are no queries, with the reason.
    own_maps : bool
        Whether each query has a map of its own.
    """

    scene: str
    queries: pd.DataFrame
    crops: Ints
    maps: tuple[ReferenceMap, ...]
    excluded: pd.DataFrame
    own_maps: bool = False

    @property
    def scene_map(self) -> ReferenceMap | None:
        """The map of the whole scene; None where each query has its own."""
        return None if self.own_maps else self.maps[0]

    def map_of(self, query: int) -> ReferenceMap:
        """Return the map that a query is matched to."""
        return self.maps[query if self.own_maps else 0]

    @property
    def cameras(self) -> Cameras:
        """Cameras of the Q queries."""
        return cameras_of(self.queries)

    @property
    def has_poses(self) -> bool:
        """Whether the true poses are known: those of a sealed benchmark are not."""
        return set(POSE_COLUMNS) <= set(self.queries.columns)

    @property
    def poses(self) -> Poses:
        """True poses of the Q queries."""
        return poses_of(self.queries)

    @property
    def priors(self) -> Poses:
        """Prior poses of the Q queries."""
        return poses_of(self.queries, PRIOR_COLUMNS)

    @property
    def conditions(self) -> pd.DataFrame:
        """The columns of the queries that are neither identity nor geometry."""
        return conditions_of(self.queries)

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
            digest.update(repr([*grid_of(one.dom).values()]).encode() + one.dsm_sha256.encode())
        return digest.hexdigest()


def with_truth_as_prior(queries: pd.DataFrame) -> pd.DataFrame:
    """Return the queries with their true poses as priors, for a protocol that says so."""
    return queries.assign(
        **{prior: queries[pose] for prior, pose in zip(PRIOR_COLUMNS, POSE_COLUMNS, strict=True)}
    )


def write_truth(folder: Path, truth: MatchingTruth) -> None:
    """Write a scene's truth below its folder, next to ``queries.csv``."""
    home = folder / "matching"
    home.mkdir(parents=True, exist_ok=True)
    columns = dict(zip(CROP_COLUMNS, truth.crops.T, strict=True))
    crops = truth.queries[["id"]].assign(**columns)
    crops.to_csv(home / "crops.csv", index=False, lineterminator="\n")
    truth.excluded.to_csv(home / "excluded.csv", index=False, lineterminator="\n")
    if truth.own_maps:
        write_own_maps(home / "maps.csv", truth.queries["id"].tolist(), truth.maps)
        return
    grid = json.dumps(grid_of(truth.maps[0].dom), indent=1)
    (home / "map.json").write_text(grid + "\n", encoding="utf-8")


def read_truth(benchmark: Benchmark, scene: str) -> MatchingTruth:
    """Read a scene's truth, and compare surface model and map with those that were prepared."""
    folder, entry = benchmark.scene_folder(scene), benchmark.scene(scene)
    home = folder / "matching"
    excluded = read_excluded(benchmark, scene, "matching")
    prior = benchmark.file.tracks.get("matching", {}).get("prior", {}).get("source")
    priors = () if prior in ("truth", "given") else PRIOR_COLUMNS
    poses = () if benchmark.is_sealed else POSE_COLUMNS
    queries = read_queries(folder, excluded, (*CAMERA_COLUMNS, *poses, *priors))
    if prior in ("truth", "given"):
        queries = with_truth_as_prior(queries)
    crops = read_table(home / "crops.csv", ("id", *CROP_COLUMNS))
    if crops["id"].tolist() != queries["id"].tolist():
        raise BenchmarkError(
            "the crops are not those of queries.csv",
            where=home / "crops.csv",
            fix="prepare the benchmark again",
        )
    if entry.maps is not None:
        own = read_own_maps(
            home / "maps.csv", benchmark.resolve(entry.maps), queries["id"].tolist()
        )
        windows = _windows(crops, [one.dom for one in own], home / "crops.csv")
        return MatchingTruth(scene, queries, windows, own, excluded, own_maps=True)
    dsm = benchmark.resolve(entry.dsm or "")
    found = dsm_checksum(dsm)
    check_dsm(dsm, found, entry.dsm_sha256)
    dom = open_info(benchmark.resolve(needed(entry.dom, "map", scene)))
    check_map(home / "map.json", dom)
    windows = _windows(crops, [dom] * len(crops), home / "crops.csv")
    return MatchingTruth(scene, queries, windows, (ReferenceMap(dom, dsm, found),), excluded)


def _windows(crops: pd.DataFrame, doms: list[RasterInfo], path: Path) -> Ints:
    """Return the crops (Q, 4), each inside its map; `read_table` has seen to whole numbers."""
    values = crops[list(CROP_COLUMNS)].to_numpy(np.int64)
    sizes = np.array([(dom.width, dom.height) for dom in doms], np.int64).reshape(-1, 2)
    far = sizes.max(axis=1, initial=0, keepdims=True)
    _refuse_cells((values < (0, 0, 1, 1)) | (values > far), crops, "not inside the map", path)
    over = values[:, :2] + values[:, 2:] > sizes
    _refuse_cells(np.hstack((np.zeros_like(over), over)), crops, "beyond the map's edge", path)
    return values


def _refuse_cells(bad: Bools, crops: pd.DataFrame, what: str, path: Path) -> None:
    if not bad.any():
        return
    row, column = (int(index[0]) for index in np.nonzero(bad))
    name = CROP_COLUMNS[column]
    raise BenchmarkError(
        f"column {name!r}, row {row + 1} ({crops['id'].iloc[row]}): "
        f"{str(crops[name].iloc[row])[:40]!r} is {what}",
        where=path,
        expected="a window of whole pixels, inside the map",
        fix="prepare the benchmark again",
    )
