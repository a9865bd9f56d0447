"""The truth of one scene of the reconstruction track: its photos, their poses, and the cloud."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import pandas as pd

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import (
    CAMERA_COLUMNS,
    POSE_COLUMNS,
    SceneInputs,
    cameras_of,
    poses_of,
    read_excluded,
    read_queries,
    with_unposed,
)
from airzoo_bench.core.errors import BenchmarkError, UsageError
from airzoo_bench.core.files import sha256_of_tree
from airzoo_bench.formats.clouds.cloud import CloudSource, MeshSampling, open_cloud
from airzoo_bench.formats.clouds.las import open_shards, shards_in
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.alignment import PosedCameras


@dataclass(frozen=True, eq=False)
class ReconstructionTruth:
    """The truth of a scene: its photos, which a reconstruction is made from, and its cloud.

    `photos` have a row each, sorted by ``id``, with camera and, unless sealed, true pose; those of
    the scene that are not used are `excluded`, with the reason. The true cloud is a file or a
    folder of shards in the scene's CRS; path and SHA-256 are empty where it is sealed.
    """

    scene: str
    photos: pd.DataFrame
    cloud: Path
    cloud_sha256: str
    excluded: pd.DataFrame

    @property
    def is_sealed(self) -> bool:
        """Whether poses and cloud are not known."""
        return not self.cloud_sha256

    @cached_property
    def cameras(self) -> Cameras:
        """Cameras of the photos."""
        return cameras_of(self.photos)

    @cached_property
    def poses(self) -> Poses:
        """True poses of the photos."""
        return poses_of(self.photos)

    @property
    def posed(self) -> PosedCameras:
        """The true poses by the names of the photos."""
        poses = self.poses
        return PosedCameras(tuple(self.photos["image"]), poses.centres, poses.rotation)

    @property
    def fingerprint(self) -> str:
        """SHA-256 over all that a score is computed from."""
        digest = hashlib.sha256("\n".join(self.photos["image"]).encode() + b"\0")
        cameras, poses = self.cameras, self.poses
        for array in (
            *(cameras.width, cameras.height, cameras.focal, cameras.principal_point),
            *(cameras.distortion, poses.rotation, poses.centres),
        ):
            digest.update(array.astype("<f8").tobytes())
        digest.update(self.cloud_sha256.encode())
        return digest.hexdigest()


def build_truth(
    inputs: SceneInputs, cloud: Path, chosen: pd.Series[bool] | None = None
) -> ReconstructionTruth:
    """Put the photos of a scene, all or the chosen rows, and the true cloud together."""
    if not cloud.exists():
        raise UsageError("no such cloud", where=cloud)
    photos = inputs.photos
    kept = pd.Series(True, index=photos.index) if chosen is None else chosen
    excluded = photos[~kept][["id", "image"]].reset_index(drop=True)
    excluded = excluded.assign(reason="not among the photos of the reconstruction")
    chosen_photos, digest = photos[kept].reset_index(drop=True), sha256_of_tree(cloud)
    unused = with_unposed(excluded, inputs)
    return ReconstructionTruth(inputs.scene, chosen_photos, cloud, digest, unused)


def write_truth(folder: Path, truth: ReconstructionTruth) -> None:
    """Write a scene's truth below its folder, next to ``queries.csv``."""
    home = folder / "reconstruction"
    home.mkdir(parents=True, exist_ok=True)
    for name, table in (("photos", truth.photos[["id", "image"]]), ("excluded", truth.excluded)):
        table.to_csv(home / f"{name}.csv", index=False, lineterminator="\n")


def read_truth(benchmark: Benchmark, scene: str) -> ReconstructionTruth:
    """Read a scene's truth, without poses and cloud where sealed, and verify the cloud."""
    folder, entry = benchmark.scene_folder(scene), benchmark.scene(scene)
    excluded = read_excluded(benchmark, scene, "reconstruction")
    poses = () if benchmark.is_sealed else POSE_COLUMNS
    photos = read_queries(folder, excluded, (*CAMERA_COLUMNS, *poses))
    if benchmark.is_sealed:
        return ReconstructionTruth(scene, photos, Path(), "", excluded)
    cloud = benchmark.resolve(entry.cloud or "")
    checksum = sha256_of_tree(cloud) if entry.cloud and cloud.exists() else None
    if checksum is None or checksum != entry.cloud_sha256:
        what = "the true cloud is not there, or is not the one that the benchmark was prepared with"
        fix = "put it back where benchmark.toml says, or prepare with --copy"
        raise BenchmarkError(what, where=cloud, fix=fix)
    return ReconstructionTruth(scene, photos, cloud, checksum, excluded)


def open_true_cloud(path: Path, memory_bytes: int, sampling: MeshSampling) -> CloudSource:
    """Open the true cloud, a file or a folder of shards that are read one after the other."""
    if path.is_dir():
        return open_shards(path, shards_in(path))
    return open_cloud(path, limit_bytes=memory_bytes, sampling=sampling)
