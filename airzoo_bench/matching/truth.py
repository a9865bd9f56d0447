"""The truth of one scene of the matching track, and the crops that its queries are matched to."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.benchmark import Benchmark
from airzoo_bench.benchmark_tables import read_table
from airzoo_bench.errors import BenchmarkError
from airzoo_bench.files import sha256_of
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import RasterInfo, open_info
from airzoo_bench.queries import (
    POSE_COLUMNS,
    PRIOR_COLUMNS,
    cameras_of,
    conditions_of,
    poses_of,
    read_queries,
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
    crops: NDArray[np.int64]
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
        grid = [self.dom.width, self.dom.height, *self.dom.transform[:6], self.dom.crs.to_string()]
        digest.update(repr(grid).encode() + self.dsm_sha256.encode())
        return digest.hexdigest()


def with_truth_as_prior(queries: pd.DataFrame) -> pd.DataFrame:
    """Return the queries with their true poses as priors, for a protocol that says so."""
    return queries.assign(
        **{prior: queries[pose] for prior, pose in zip(PRIOR_COLUMNS, POSE_COLUMNS, strict=True)}
    )


def write_truth(folder: Path, truth: MatchingTruth) -> None:
    """Write a scene's truth below its folder, beside ``queries.csv``."""
    home = folder / "matching"
    home.mkdir(parents=True, exist_ok=True)
    columns = dict(zip(CROP_COLUMNS, truth.crops.T, strict=True))
    crops = truth.queries[["id"]].assign(**columns)
    crops.to_csv(home / "crops.csv", index=False, lineterminator="\n")
    truth.excluded.to_csv(home / "excluded.csv", index=False, lineterminator="\n")


def read_truth(benchmark: Benchmark, scene: str) -> MatchingTruth:
    """Read a scene's truth, and hold the surface model to its checksum.

    Raises
    ------
    BenchmarkError
        A file is missing or damaged, or the surface model is not the one that was prepared.
    RasterError
        Map or surface model cannot be read.
    """
    folder, entry = benchmark.scene_folder(scene), benchmark.scene(scene)
    home = folder / "matching"
    excluded = read_table(home / "excluded.csv", ("id", "image", "reason"))
    queries = read_queries(folder, excluded)
    if benchmark.file.tracks.get("matching", {}).get("prior", {}).get("source") == "truth":
        queries = with_truth_as_prior(queries)
    crops = read_table(home / "crops.csv", ("id", *CROP_COLUMNS))
    if crops["id"].tolist() != queries["id"].tolist():
        raise BenchmarkError(
            "the crops are not those of queries.csv",
            where=home / "crops.csv",
            mend="prepare the benchmark again",
        )
    dsm = benchmark.resolve(entry.dsm or "")
    found = _dsm_checksum(dsm)
    if found != entry.dsm_sha256:
        raise BenchmarkError(
            "the surface model is not the one that the benchmark was prepared with",
            where=dsm,
            expected=f"SHA-256 {(entry.dsm_sha256 or 'none')[:12]}…",
            mend="put it back, or prepare the benchmark again",
        )
    windows = crops[list(CROP_COLUMNS)].to_numpy(np.int64)
    dom = open_info(benchmark.resolve(entry.dom))
    return MatchingTruth(scene, queries, windows, dom, dsm, found, excluded)


def _dsm_checksum(dsm: Path) -> str:
    if not dsm.is_file():
        raise BenchmarkError(
            "the surface model is not there",
            where=dsm,
            expected="the DSM that matches are lifted by",
            mend="put it back where benchmark.toml says, or prepare with --copy",
        )
    return sha256_of(dsm)
