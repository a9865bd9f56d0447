"""``prepare airzoo-mini``: the world that is made on the spot becomes a benchmark folder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
import pandas as pd

from airzoo_bench.benchmark.scene_inputs import SceneInputs, photo_table
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.core.workers import parallel_map
from airzoo_bench.datasets.dataset import Prepared, PrepareSettings
from airzoo_bench.datasets.folder import SceneContent, write_benchmark
from airzoo_bench.datasets.mini.export.frame_list import IMAGE_SUFFIX
from airzoo_bench.datasets.mini.export.frames import render_frames
from airzoo_bench.datasets.mini.export.photos import (
    SURVEY,
    Photos,
    mini_photos,
    noisy_priors,
    seen_surface,
)
from airzoo_bench.datasets.mini.world.build import build_world
from airzoo_bench.datasets.mini.world.model import CRS, REGIONS, Region
from airzoo_bench.datasets.mini.world.store import ensure_world, load_world
from airzoo_bench.datasets.truths import BenchmarkProtocols, build_truths
from airzoo_bench.formats.clouds.ply_writer import write_ply
from airzoo_bench.geometry.medians import median_height
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.matching.settings import MatchingProtocol
from airzoo_bench.protocol.lookup import protocol_of_track
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.reconstruction.prepared import grid_origin
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.reconstruction.voxels import VoxelGrid
from airzoo_bench.retrieval.settings import RetrievalProtocol

__all__ = ["make_worlds", "mini_protocols", "prepare_airzoo_mini"]

P = TypeVar("P", bound=Protocol)

# The voxels of the protocol: exact depth then gives the true points themselves.
_CLOUD_VOXEL_M = 0.5
_RENDERED = "frames"


def mini_protocols(seed: int) -> BenchmarkProtocols:
    """Return the shipped protocols; with a seed of its own, the benchmark is another."""
    return BenchmarkProtocols(
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


def prepare_airzoo_mini(seed: int, settings: PrepareSettings) -> Prepared:
    """Make worlds, fly over them, take photos and work out the truth of every track.

    Worlds and photos are kept below the data root; what is there and sound is not made again, so
    that a run that was stopped goes on where it was.

    Parameters
    ----------
    seed : int
        Of worlds, flights, photos and priors.
    settings : PrepareSettings

    Raises
    ------
    UserError
        A folder cannot be written, or the disk is full.
    """
    protocols = mini_protocols(seed)
    regions = [REGIONS[scene.id] for scene in protocols.every[0].scenes]
    worlds = make_worlds(
        regions,
        settings.root,
        seed,
        jobs=settings.jobs,
        progress=settings.progress,
        note=settings.note,
    )
    scenes = [
        _scene(region, world, seed, protocols, settings)
        for region, world in zip(regions, worlds, strict=True)
    ]
    return write_benchmark(scenes, protocols, settings)


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


def _scene(
    region: Region,
    world: Path,
    seed: int,
    protocols: BenchmarkProtocols,
    settings: PrepareSettings,
) -> SceneContent:
    """Take the photos of a region, and make the truth of all tracks."""
    photos = mini_photos(region, load_world(world).dsm, seed)
    rendered = world.with_name(f"{world.name}-{_RENDERED}")
    jobs, progress = settings.jobs, settings.progress
    load = partial(load_world, world)
    render_frames(photos.frames, load, rendered, workers=jobs, progress=progress)
    cloud = rendered / "cloud.ply"
    voxels = VoxelGrid(_CLOUD_VOXEL_M, grid_origin(_CLOUD_VOXEL_M))
    write_ply(cloud, seen_surface(photos, rendered, voxels, progress))
    files = {"images": rendered / "images", "cloud": cloud, "gallery": world / "satellite.tif"}
    files |= {key: world / f"{key}.tif" for key in ("dom", "dsm")}
    inputs = _inputs(region, photos, files, seed)
    surveyed = inputs.photos["sequence"] == SURVEY
    return SceneContent(inputs, build_truths(inputs, protocols, cloud, surveyed), files)


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
