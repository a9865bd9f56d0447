"""The truth of one scene of the matching track, and the crops that its queries are matched to."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from airzoo_bench.benchmark.folder import Benchmark, needed
from airzoo_bench.benchmark.queries import (
    CAMERA_COLUMNS,
    POSE_COLUMNS,
    PRIOR_COLUMNS,
    cameras_of,
    conditions_of,
    poses_of,
    read_queries,
)
from airzoo_bench.benchmark.tables import read_table
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.files import read_text, sha256_of
from airzoo_bench.geometry.arrays import Bools, Ints
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import check_same_crs
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import RasterInfo, open_info

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["CROP_COLUMNS", "MatchingTruth", "read_truth", "with_truth_as_prior", "write_truth"]

_MAP_LIMIT_BYTES = 1 << 20

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
        Window of each query in the map: x, y, width, height in pixels.
    dom : RasterInfo
        The map; only its georeference is used for scoring.
    dsm : Path
        The surface model.
    dsm_sha256 : str
        Of the surface model's bytes.
    excluded : DataFrame
        Photos that are no queries, with the reason.
    """

    scene: str
    queries: pd.DataFrame
    crops: Ints
    dom: RasterInfo
    dsm: Path
    dsm_sha256: str
    excluded: pd.DataFrame

    @property
    def cameras(self) -> Cameras:
        """Cameras of the Q queries."""
        return cameras_of(self.queries)

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
        digest.update(repr([*_grid(self.dom).values()]).encode() + self.dsm_sha256.encode())
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
    grid = json.dumps(_grid(truth.dom), indent=1)
    (home / "map.json").write_text(grid + "\n", encoding="utf-8")


def read_truth(benchmark: Benchmark, scene: str) -> MatchingTruth:
    """Read a scene's truth, and compare surface model and map with those that were prepared.

    Raises
    ------
    BenchmarkError
        A file is missing or damaged, a crop is not inside the map, or map or surface model are not
        those that were prepared.
    RasterError
        Map or surface model cannot be read.
    """
    folder, entry = benchmark.scene_folder(scene), benchmark.scene(scene)
    home = folder / "matching"
    excluded = read_table(home / "excluded.csv", ("id", "image", "reason"))
    prior = benchmark.file.tracks.get("matching", {}).get("prior", {}).get("source")
    priors = () if prior == "truth" else PRIOR_COLUMNS
    queries = read_queries(folder, excluded, (*CAMERA_COLUMNS, *POSE_COLUMNS, *priors))
    if prior == "truth":
        queries = with_truth_as_prior(queries)
    crops = read_table(home / "crops.csv", ("id", *CROP_COLUMNS))
    if crops["id"].tolist() != queries["id"].tolist():
        raise BenchmarkError(
            "the crops are not those of queries.csv",
            where=home / "crops.csv",
            fix="prepare the benchmark again",
        )
    dsm = benchmark.resolve(entry.dsm or "")
    found = _dsm_checksum(dsm)
    if found != entry.dsm_sha256:
        raise BenchmarkError(
            "the surface model is not the one that the benchmark was prepared with",
            where=dsm,
            expected=f"SHA-256 {(entry.dsm_sha256 or 'none')[:12]}…",
            fix="put it back, or prepare the benchmark again",
        )
    dom = open_info(benchmark.resolve(needed(entry.dom, "map", scene)))
    _check_map(home / "map.json", dom)
    windows = _windows(crops, dom, home / "crops.csv")
    return MatchingTruth(scene, queries, windows, dom, dsm, found, excluded)


def _grid(dom: RasterInfo) -> dict[str, Any]:
    """All of a map that scores are computed from: size, geotransform, CRS."""
    transform = [float(value) for value in dom.transform[:6]]
    size = {"width": dom.width, "height": dom.height}
    return size | {"transform": transform, "crs": dom.crs.to_string()}


def _check_map(path: Path, dom: RasterInfo) -> None:
    text = read_text(path, BenchmarkError, "grid of the map", _MAP_LIMIT_BYTES)
    try:
        prepared = json.loads(text)
    except ValueError as error:
        raise BenchmarkError(
            f"not JSON: {error}", where=path, fix="prepare the benchmark again"
        ) from error
    if not isinstance(prepared, dict):
        prepared = {}
    # One CRS has several spellings: it is compared by what it means.
    found = _grid(dom)
    if prepared | {"crs": found["crs"]} != found:
        raise BenchmarkError(
            "the map's grid is not the one that the benchmark was prepared with: "
            f"{json.dumps(found)}",
            where=dom.path,
            expected=json.dumps(prepared),
            fix="put the map back, or prepare the benchmark again",
        )
    check_same_crs(dom.crs, prepared.get("crs"), f"{dom.path} and the map that was prepared")


def _windows(crops: pd.DataFrame, dom: RasterInfo, path: Path) -> Ints:
    """Return the crops (Q, 4), each inside the map; `read_table` has seen to whole numbers."""
    values = crops[list(CROP_COLUMNS)].to_numpy(np.int64)
    far = max(dom.width, dom.height)
    _refuse_cells((values < (0, 0, 1, 1)) | (values > far), crops, "not inside the map", path)
    over = values[:, :2] + values[:, 2:] > (dom.width, dom.height)
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


def _dsm_checksum(dsm: Path) -> str:
    if not dsm.is_file():
        raise BenchmarkError(
            "the surface model is not there",
            where=dsm,
            expected="the DSM that matches are lifted by",
            fix="put it back where benchmark.toml says, or prepare with --copy",
        )
    return sha256_of(dsm)
