"""``prepare airzoo-mini``: the world that is made on the spot becomes a benchmark folder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
import pandas as pd

from airzoo_bench.benchmark.manifest import SceneFile
from airzoo_bench.benchmark.scene_inputs import SceneInputs, photo_table
from airzoo_bench.core.files import atomic_folder, check_new_folder, sha256_of
from airzoo_bench.core.parallel import parallel_map
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.datasets.folder import (
    SceneTruths,
    copied,
    left_in_place,
    write_folder_files,
    write_scene,
)
from airzoo_bench.datasets.mini.export.frame_list import IMAGE_SUFFIX
from airzoo_bench.datasets.mini.export.frames import render_frames
from airzoo_bench.datasets.mini.export.photos import Photos, mini_photos, noisy_priors, seen_surface
from airzoo_bench.datasets.mini.world.build import build_world
from airzoo_bench.datasets.mini.world.canvas import SURVEY
from airzoo_bench.datasets.mini.world.model import CRS, REGIONS, Region
from airzoo_bench.datasets.mini.world.store import ensure_world, load_world
from airzoo_bench.datasets.tiles import write_parts
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.blocks import median_height
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.matching.prepare import build_truth as build_matching_truth
from airzoo_bench.matching.settings import MatchingProtocol
from airzoo_bench.protocol.lookup import protocol_of_track
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.reconstruction.prepared import grid_origin
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.reconstruction.truth import build_truth as build_reconstruction_truth
from airzoo_bench.reconstruction.voxels import VoxelGrid
from airzoo_bench.retrieval.prepare import build_truth as build_retrieval_truth
from airzoo_bench.retrieval.settings import RetrievalProtocol

__all__ = ["MiniProtocols", "PreparedMini", "make_worlds", "mini_protocols", "prepare_airzoo_mini"]

P = TypeVar("P", bound=Protocol)

# The voxels of the protocol: exact depth then gives the true points themselves.
_CLOUD_VOXEL_M = 0.5
_RENDERED = "frames"


@dataclass(frozen=True)
class MiniProtocols:
    """The protocols of AirZoo-Mini, all of the same benchmark and scenes."""

    retrieval: RetrievalProtocol
    matching: MatchingProtocol
    reconstruction: ReconstructionProtocol

    @property
    def every(self) -> tuple[Protocol, ...]:
        """All of them."""
        return (self.retrieval, self.matching, self.reconstruction)


def mini_protocols(seed: int) -> MiniProtocols:
    """Return the shipped protocols; with a seed of its own, the benchmark is another."""
    return MiniProtocols(
        _protocol("retrieval", RetrievalProtocol, seed),
        _protocol("matching", MatchingProtocol, seed),
        _protocol("reconstruction", ReconstructionProtocol, seed),
    )


def _protocol(track: str, kind: type[P], seed: int) -> P:
    protocol = protocol_of_track(f"airzoo-mini-{track}", Path(), kind)
    if seed == 0:
        return protocol
    name = f"{protocol.benchmark}-{seed}"
    changes = {"name": f"{name}-{protocol.track}", "benchmark": name}
    return protocol.model_copy(update=changes | {"title": f"{protocol.title}, seed {seed}"})


@dataclass(frozen=True)
class PreparedMini:
    """What `prepare_airzoo_mini` made: the folder, and what is in it by scene."""

    folder: Path
    scenes: dict[str, SceneTruths]


def prepare_airzoo_mini(
    root: Path,
    folder: Path,
    protocols: MiniProtocols,
    *,
    seed: int = 0,
    jobs: int = 1,
    tiles_on_disk: bool = False,
    crops_on_disk: bool = False,
    copy: bool = False,
    replace: bool = False,
    progress: Progress = silent,
    note: Callable[[str], None] = lambda _: None,
) -> PreparedMini:
    """Make worlds, fly over them, take photos and work out the truth of every track.

    Worlds and photos are kept below the data root; what is there and sound is not made again, so
    that a run that was stopped goes on where it was.

    Parameters
    ----------
    root : Path
        The data root.
    folder : Path
        The benchmark folder; it appears when it is complete.
    protocols : MiniProtocols
    seed : int
        Of worlds, flights, photos and priors.
    jobs : int
        Processes; the benchmark does not depend on it.
    tiles_on_disk, crops_on_disk : bool
        See `photos.prepare_photos`.
    copy : bool
        Copy photos, maps and clouds into the folder; otherwise they stay below the data root.
    replace : bool
        Whether a folder that stands there is replaced.
    progress : Progress
    note : callable
        Takes a sentence for the user.

    Raises
    ------
    UserError
        A folder cannot be written, or the disk is full.
    """
    check_new_folder(folder, replace=replace)
    regions = [REGIONS[scene.id] for scene in protocols.retrieval.scenes]
    worlds = make_worlds(regions, root, seed, jobs=jobs, progress=progress, note=note)
    scenes = [
        _photographed(region, world, seed, jobs, progress)
        for region, world in zip(regions, worlds, strict=True)
    ]
    truths = {scene.region.name: _truths(scene, protocols) for scene in scenes}
    with atomic_folder(folder, replace=replace) as staged:
        entries = []
        for scene in scenes:
            name = scene.region.name
            home = write_scene(staged, name, truths[name])
            write_parts(
                home,
                truths[name],
                scene.inputs.gallery_map,
                tiles=tiles_on_disk,
                crops=crops_on_disk,
                progress=progress,
            )
            images = scene.inputs.photos["image"].tolist()
            kept = copied(staged, name, scene.files, images) if copy else left_in_place(scene.files)
            entries.append(_entry(scene, truths[name], kept))
        write_folder_files(staged, protocols.every, entries)
    return PreparedMini(folder, truths)


def make_worlds(
    regions: Sequence[Region],
    root: Path,
    seed: int,
    *,
    jobs: int,
    progress: Progress = silent,
    note: Callable[[str], None] = lambda _: None,
) -> list[Path]:
    """Make worlds of regions below the data root where they are not yet; return their folders."""
    work = partial(_world, root=root, seed=seed)
    found = parallel_map(work, list(regions), min(jobs, len(regions)))
    folders = []
    for folder, said in progress(found, "worlds", len(regions)):
        folders.append(folder)
        for sentence in said:
            note(sentence)
    return folders


def _world(region: Region, root: Path, seed: int) -> tuple[Path, list[str]]:
    said: list[str] = []
    return ensure_world(region, seed, root, build_world, said.append), said


@dataclass(frozen=True, eq=False)
class _Scene:
    """A region with its photos, as `prepare` finds a scene of own photos."""

    region: Region
    inputs: SceneInputs
    files: dict[str, Path]


def _photographed(region: Region, world: Path, seed: int, jobs: int, progress: Progress) -> _Scene:
    photos = mini_photos(region, load_world(world).dsm, seed)
    rendered = world.with_name(f"{world.name}-{_RENDERED}")
    render_frames(
        photos.frames, partial(load_world, world), rendered, workers=jobs, progress=progress
    )
    cloud = rendered / "cloud.ply"
    voxels = VoxelGrid(_CLOUD_VOXEL_M, grid_origin(_CLOUD_VOXEL_M))
    write_ply(cloud, seen_surface(photos, rendered, voxels, progress))
    files = {"images": rendered / "images", "cloud": cloud, "gallery": world / "satellite.tif"}
    files |= {key: world / f"{key}.tif" for key in ("dom", "dsm")}
    return _Scene(region, _inputs(region, photos, files, seed), files)


def _inputs(region: Region, photos: Photos, files: dict[str, Path], seed: int) -> SceneInputs:
    frames = photos.frames
    images = tuple(f"{name}{IMAGE_SUFFIX}" for name in frames.names)
    plane = median_height(files["dsm"])
    ids = [f"{region.name}/{name}" for name in frames.names]
    priors = noisy_priors(ids, frames.poses, seed)
    cameras = frames.camera.take(np.zeros(len(frames), dtype=np.int64))
    table = photo_table(region.name, images, cameras, frames.poses, priors, plane)
    conditions = pd.DataFrame(
        {"weather": frames.weather, "time_of_day": frames.time_of_day, "sequence": photos.sequence},
        index=ids,
    )
    table = table.join(conditions, on="id")
    dom, gallery = open_info(files["dom"]), open_info(files["gallery"])
    return SceneInputs(region.name, table, CRS, dom, files["dsm"], plane, gallery=gallery)


def _truths(scene: _Scene, protocols: MiniProtocols) -> SceneTruths:
    inputs, retrieval, matching = scene.inputs, protocols.retrieval, protocols.matching
    surveyed = inputs.photos["sequence"] == SURVEY
    return SceneTruths(
        inputs.photos,
        build_retrieval_truth(inputs, retrieval.gallery, retrieval.ground_truth),
        build_matching_truth(inputs, matching.crop, matching.prior),
        build_reconstruction_truth(inputs, scene.files["cloud"], surveyed),
    )


def _entry(scene: _Scene, truths: SceneTruths, kept: dict[str, str]) -> SceneFile:
    name = scene.region.name
    return SceneFile(
        id=name,
        title=name.capitalize(),
        crs=CRS,
        plane_height_m=scene.inputs.plane_height_m,
        dsm_sha256=sha256_of(scene.files["dsm"]),
        cloud_sha256=truths.reconstruction.cloud_sha256 if truths.reconstruction else None,
        **kept,
    )
