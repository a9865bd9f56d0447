"""``prepare airzoo-mini``: the world that is made on the spot becomes a benchmark folder.

Two flights go over each region. The survey is flown on one day and serves reconstruction; the
barrel roll goes through every weather and time of day, so that retrieval and matching can be broken
down by condition.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from airzoo_bench.benchmark.queries import SceneInputs, photo_table
from airzoo_bench.core.progress import Progress, silent, with_progress
from airzoo_bench.datasets.content import SceneContent
from airzoo_bench.datasets.folder import write_benchmark
from airzoo_bench.datasets.mini.flights import (
    Airspace,
    Trajectory,
    barrel_roll,
    key_frames,
    survey,
    trajectory_poses,
)
from airzoo_bench.datasets.mini.frames import (
    IMAGE_SUFFIX,
    FrameList,
    frame_paths,
    read_depth,
    render_frames,
)
from airzoo_bench.datasets.mini.noise import derived, is_keyed, seed_of, words
from airzoo_bench.datasets.mini.priors import noisy_priors
from airzoo_bench.datasets.mini.rendering.renderer import default_camera
from airzoo_bench.datasets.mini.rendering.weather import TIMES, WEATHERS
from airzoo_bench.datasets.mini.world.build import build_world
from airzoo_bench.datasets.mini.world.model import CRS, REGIONS, Region
from airzoo_bench.datasets.mini.world.store import ensure_world, load_world
from airzoo_bench.datasets.settings import Prepared, PrepareSettings
from airzoo_bench.datasets.truths import BenchmarkProtocols, build_truths
from airzoo_bench.engines.engine import HERE, Engine
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.heightfield import median_height
from airzoo_bench.geometry.poses import Poses, depth_to_points
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.reconstruction.clouds import VoxelGrid, grid_origin

SURVEY, ROLL = "survey", "roll"

_SURVEY_SIDE_M, _SURVEY_SPACING_M = 100.0, 50.0
_SURVEY_OVERLAP, _ROLL_OVERLAP = 0.55, 0.25
_ROLL_PHOTOS = 30  # each of the 15 conditions twice

_CLOUD_DECIMALS = 4
# The voxels of the protocol: exact depth then gives the true points themselves.
_CLOUD_VOXEL_M = 0.5


@dataclass(frozen=True, eq=False)
class Photos:
    """The photos of a region; `sequence` says of each whether it is of `SURVEY` or `ROLL`."""

    frames: FrameList
    sequence: tuple[str, ...]


def mini_photos(region: Region, dsm: NDArray[np.float32], seed: int) -> Photos:
    """Plan the photos of a region, above its surface model (H, W)."""
    own = derived(seed, f"photos of {region.name}")
    camera = default_camera()
    airspace = Airspace.over(region, dsm)
    surveyed = _survey(airspace, own)
    surveyed = surveyed.take(key_frames(surveyed, camera, airspace.ground_m, _SURVEY_OVERLAP))
    rolled = barrel_roll(airspace, derived(own, "barrel roll"))
    keys = key_frames(rolled, camera, airspace.ground_m, _ROLL_OVERLAP)
    number = min(len(keys), _ROLL_PHOTOS)
    rolled = rolled.take(keys[np.arange(number) * len(keys) // number])
    flights = ((SURVEY, surveyed), (ROLL, rolled))
    poses = [trajectory_poses(flight) for _, flight in flights]
    every = [(weather, time) for time in TIMES for weather in WEATHERS]
    # 7 has no factor in common with 15: all come by in an order that mixes them.
    turns = [every[(7 * row + seed) % len(every)] for row in range(number)]
    names = [f"{name}_{row:04d}" for name, flight in flights for row in range(len(flight))]
    if is_keyed(own):
        turns = [
            turns[row] for row in sorted(range(number), key=partial(seed_of, own, "conditions"))
        ]
        # Photos lie off the line of their flight, each by itself, as far as GPS is off.
        gusts = [[f"{name} {row}" for row in range(len(flight))] for name, flight in flights]
        poses = [
            noisy_priors(places, part, derived(own, "gusts"))
            for places, part in zip(gusts, poses, strict=True)
        ]
        names = [f"{seed_of(own, name):016x}" for name in names]
    weather, time = zip(*[("sunny", "day")] * len(surveyed), *turns, strict=True)
    frames = FrameList(
        names=tuple(names),
        camera=camera,
        # Photos are taken from where the truth will say, to the last bit.
        poses=Poses(
            rotation=np.concatenate([part.rotation for part in poses]),
            centres=np.concatenate([part.centres for part in poses]),
        ).rounded(),
        weather=weather,
        time_of_day=time,
        seed=derived(own, "noise"),
    )
    return Photos(frames, tuple(name for name, flight in flights for _ in range(len(flight))))


def _survey(airspace: Airspace, seed: int) -> Trajectory:
    flown = partial(survey, airspace, side_m=_SURVEY_SIDE_M, spacing_m=_SURVEY_SPACING_M)
    if not is_keyed(seed):
        return flown()
    turn, east, north = (words(derived(seed, "survey"), 3) >> np.uint64(11)) * 2.0**-53
    shift = (float((east - 0.5) * _SURVEY_SIDE_M), float((north - 0.5) * _SURVEY_SIDE_M))
    return flown(turn_deg=float(360.0 * turn), shift_m=shift)


def seen_surface(photos: Photos, folder: Path, grid: VoxelGrid, progress: Progress) -> Cloud:
    """Return every surface that photos of the survey see, from exact depth, a point a voxel."""
    frames = photos.frames
    rows = [row for row, sequence in enumerate(photos.sequence) if sequence == SURVEY]
    for row in progress(rows, "true cloud", len(rows)):
        depth = read_depth(frame_paths(folder, frames.names[row])[1]).astype(np.float64)
        points = depth_to_points(depth, depth > 0, frames.camera, frames.poses.take(row))
        grid.add(points)
    return Cloud(np.round(grid.points(), _CLOUD_DECIMALS) + 0.0)


def mini_protocols(seed: int) -> BenchmarkProtocols:
    """Return the shipped protocols; with a seed or key of its own, the benchmark is another."""
    tracks = ("retrieval", "matching", "reconstruction")
    shipped = BenchmarkProtocols.named([f"airzoo-mini-{track}" for track in tracks], Path())
    return BenchmarkProtocols(tuple(_of_seed(one, seed) for one in shipped.every))


def _of_seed(protocol: Protocol, seed: int) -> Protocol:
    if seed == 0:
        return protocol
    which, said = ("sealed", "sealed edition") if is_keyed(seed) else (str(seed), f"seed {seed}")
    name = f"{protocol.benchmark}-{which}"
    changes = {"name": f"{name}-{protocol.track}", "benchmark": name}
    return protocol.model_copy(update=changes | {"title": f"{protocol.title}, {said}"})


def prepare_airzoo_mini(seed: int, settings: PrepareSettings) -> Prepared:
    """Make worlds, fly over them, take photos and work out the truth of every track."""
    protocols = mini_protocols(seed)
    regions = [REGIONS[scene.id] for scene in protocols.every[0].scenes]
    use: Any = {"engine": settings.engine, "progress": settings.progress, "note": settings.note}
    worlds = make_worlds(regions, settings.root, derived(seed, "worlds"), **use)
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
    engine: Engine = HERE,
    progress: Progress = silent,
    note: Callable[[str], None] = lambda _: None,
) -> list[Path]:
    """Make worlds of regions below the data root where they are not yet; return their folders."""
    found = engine.map(
        _world, regions, shared=(root, seed), stage="worlds", name=lambda region: region.name
    )
    folders = []
    for folder, said in progress(found, "worlds", len(regions)):
        folders.append(folder)
        for sentence in said:
            note(sentence)
    return folders


def _world(shared: tuple[Path, int], region: Region) -> tuple[Path, list[str]]:
    root, seed = shared
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
    rendered = world.with_name(f"{world.name}-frames")
    progress, load = settings.progress, partial(load_world, world)
    render_frames(photos.frames, load, rendered, engine=settings.engine, progress=progress)
    cloud = rendered / "cloud.ply"
    voxels = VoxelGrid(_CLOUD_VOXEL_M, grid_origin(_CLOUD_VOXEL_M))
    write_ply(cloud, seen_surface(photos, rendered, voxels, progress))
    files = {"images": rendered / "images", "cloud": cloud, "gallery": world / "satellite.tif"}
    files |= {key: world / f"{key}.tif" for key in ("dom", "dsm")}
    inputs = _inputs(region, photos, files, seed)
    surveyed = inputs.photos["sequence"] == SURVEY
    build = partial(build_truths, inputs, protocols, cloud, surveyed)
    return SceneContent(inputs, with_progress(build, f"{region.name}: truth", progress), files)


def _inputs(region: Region, photos: Photos, files: dict[str, Path], seed: int) -> SceneInputs:
    frames = photos.frames
    images = tuple(f"{name}{IMAGE_SUFFIX}" for name in frames.names)
    plane = median_height(files["dsm"])
    ids = [f"{region.name}/{name}" for name in frames.names]
    priors = noisy_priors(ids, frames.poses, derived(seed, f"priors of {region.name}"))
    cameras = frames.camera.take(np.zeros(len(frames), dtype=np.int64))
    table = photo_table(region.name, images, cameras, frames.poses, priors, plane)
    conditions = pd.DataFrame(
        {"weather": frames.weather, "time_of_day": frames.time_of_day, "sequence": photos.sequence},
        index=ids,
    )
    table = table.join(conditions, on="id")
    dom, gallery = open_info(files["dom"]), open_info(files["gallery"])
    return SceneInputs(region.name, table, CRS, dom, files["dsm"], plane, gallery=gallery)
