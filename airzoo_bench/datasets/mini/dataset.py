"""``prepare airzoo-mini``: the world that is made on the spot becomes a benchmark folder.

Two flights go over each region. The survey is flown on one day and serves reconstruction; the
barrel roll goes through every weather and time of day, so that retrieval and matching can be broken
down by condition.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import partial
from operator import attrgetter
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from airzoo_bench.benchmark.queries import SceneInputs, photo_id, photo_table
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import read_text
from airzoo_bench.core.progress import Progress, silent, with_progress
from airzoo_bench.datasets.about import load_about
from airzoo_bench.datasets.content import SceneContent
from airzoo_bench.datasets.dataset import Dataset
from airzoo_bench.datasets.folder import write_benchmark
from airzoo_bench.datasets.geometry_checks import key_frames
from airzoo_bench.datasets.metadata import noisy_priors
from airzoo_bench.datasets.mini import renderer
from airzoo_bench.datasets.mini.build import build_world
from airzoo_bench.datasets.mini.flights import barrel_roll, flight_levels, survey
from airzoo_bench.datasets.mini.noise import is_key, seed_of
from airzoo_bench.datasets.mini.shading import TIMES, WEATHERS
from airzoo_bench.datasets.mini.world import CRS, REGIONS, Region, ensure_world, load_world
from airzoo_bench.datasets.settings import MiniOptions, Prepared, PrepareSettings
from airzoo_bench.datasets.truths import BenchmarkProtocols, build_truths
from airzoo_bench.engines.engine import Engine
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.heightfield import median_height
from airzoo_bench.geometry.poses import Poses, depth_to_points
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.reconstruction.clouds import VoxelGrid, grid_origin

SURVEY, ROLL = "survey", "roll"

_SURVEY_SIDE_M, _SURVEY_SPACING_M = 100.0, 50.0
_SURVEY_OVERLAP, _ROLL_OVERLAP = 0.55, 0.25
_ROLL_PHOTOS = 30  # each of the 15 conditions twice

# The voxels of the protocol: exact depth then gives the true points themselves.
_CLOUD_VOXEL_M = 0.5


def mini_photos(region: Region, dsm: NDArray[np.float32], seed: int) -> renderer.FrameList:
    """Plan the photos of a region, above its surface model (H, W)."""
    of = partial(_seed_in, seed, region)
    camera, (ground_m, floor_m) = renderer.default_camera(), flight_levels(dsm)
    surveyed = survey(region, ground_m, floor_m, _SURVEY_SIDE_M, _SURVEY_SPACING_M)
    surveyed = surveyed.take(key_frames(surveyed, camera, ground_m, _SURVEY_OVERLAP))
    rolled = barrel_roll(region, floor_m, of("barrel roll"))
    keys = key_frames(rolled, camera, ground_m, _ROLL_OVERLAP)
    number = min(len(keys), _ROLL_PHOTOS)
    rolled = rolled.take(keys[np.arange(number) * len(keys) // number])
    every = [(weather, time) for time in TIMES for weather in WEATHERS]
    # 7 has no factor in common with 15: all come by in an order that mixes them.
    turns = [every[(7 * row + seed) % len(every)] for row in range(number)]
    weather, time = zip(*[("sunny", "day")] * len(surveyed), *turns, strict=True)
    rows = [(SURVEY, row) for row in range(len(surveyed))] + [(ROLL, row) for row in range(number)]
    names = [f"{name}_{row:04d}" for name, row in rows]
    rotation = np.concatenate([surveyed.rotation, rolled.rotation])
    poses = Poses(rotation=rotation, centres=np.concatenate([surveyed.centres, rolled.centres]))
    if is_key(seed):
        # Each photo is off its line, so that who flies the survey again knows no more than priors.
        poses = noisy_priors(names, poses, of("gusts"))
        names = [f"{seed_of(of('names'), name):016x}" for name in names]
    return renderer.FrameList(
        names=tuple(names),
        camera=camera,
        poses=poses.rounded(),  # where the truth will say, to the last bit
        weather=weather,
        time_of_day=time,
        seed=of("noise"),
        sequence=tuple(name for name, _ in rows),
    )


def _seed_in(seed: int, region: Region, purpose: str) -> int:
    """Return the seed of a purpose: of a key another one for each, of a seed itself."""
    return seed_of(seed, f"{purpose} of {region.name}") if is_key(seed) else seed


def seen_surface(photos: renderer.FrameList, folder: Path, progress: Progress = silent) -> Cloud:
    """Return every surface that photos of the survey see, from exact depth, a point a voxel."""
    grid = VoxelGrid(_CLOUD_VOXEL_M, grid_origin(_CLOUD_VOXEL_M))
    rows = [row for row, sequence in enumerate(photos.sequence) if sequence == SURVEY]
    for row in progress(rows, "true cloud", len(rows)):
        depth = renderer.read_depth(renderer.frame_paths(folder, photos.names[row])[1])
        grid.add(depth_to_points(depth, depth > 0, photos.camera, photos.poses.take(row)))
    return Cloud(np.round(grid.points(), 4) + 0.0)


def mini_protocols(seed: int) -> BenchmarkProtocols:
    """Return the shipped protocols; with a seed or key of its own, the benchmark is another."""
    tracks = ("retrieval", "matching", "reconstruction")
    shipped = BenchmarkProtocols.find([f"airzoo-mini-{track}" for track in tracks], Path())
    if seed == 0:
        return shipped
    which, said = ("sealed", "sealed edition") if is_key(seed) else (str(seed), f"seed {seed}")
    name, changed = f"airzoo-mini-{which}", []
    for one in shipped.every:
        own = {"name": f"{name}-{one.track}", "benchmark": name, "title": f"{one.title}, {said}"}
        changed.append(one.model_copy(update=own))
    return BenchmarkProtocols(tuple(changed))


def make_worlds(
    regions: Sequence[Region], root: Path, seed: int, engine: Engine, progress: Progress
) -> list[Path]:
    """Make worlds of regions below the data root where they are not yet; return their folders."""
    shared, name = (root, seed), attrgetter("name")
    worlds = engine.map(_make_world, regions, shared=shared, stage="worlds", name=name)
    return list(progress(worlds, "worlds", len(regions)))


def _make_world(shared: tuple[Path, int], region: Region) -> Path:
    root, seed = shared
    return ensure_world(region, _seed_in(seed, region, "world"), root, build_world)


def scene_inputs(
    region: Region, photos: renderer.FrameList, files: Mapping[str, Path], seed: int
) -> SceneInputs:
    """Lay out a region's photos with their priors and conditions, and open its maps."""
    images = tuple(f"{name}{renderer.IMAGE_SUFFIX}" for name in photos.names)
    ids, plane = [photo_id(region.name, image) for image in images], median_height(files["dsm"])
    priors = noisy_priors(ids, photos.poses, _seed_in(seed, region, "priors"))
    cameras = photos.camera.take(np.zeros(len(images), dtype=np.int64))
    table = photo_table(region.name, images, cameras, photos.poses, priors, plane)
    columns = ("weather", "time_of_day", "sequence")
    conditions = {name: getattr(photos, name) for name in columns}
    table = table.join(pd.DataFrame(conditions, index=ids), on="id")
    dom, gallery = open_info(files["dom"]), open_info(files["gallery"])
    return SceneInputs(region.name, table, CRS, dom, files["dsm"], plane, gallery=gallery)


def seed_or_key(options: MiniOptions) -> int:
    """Return the source of all randomness: the seed, or the key of a sealed edition."""
    if options.key_file is None:
        return options.seed
    text = read_text(options.key_file, UsageError, "key file", 1 << 10).strip()
    if options.seed or not re.fullmatch("[0-9a-fA-F]{32}", text):
        fix = f"openssl rand -hex 16 > {options.key_file}"
        expected = "32 hexadecimal digits, and no --seed beside it"
        raise UsageError("no key", where=options.key_file, expected=expected, fix=fix)
    return 1 << 128 | int(text, 16)


class AirZooMini(Dataset[MiniOptions]):
    """The benchmark that is made on the spot."""

    name = "airzoo-mini"
    about = load_about("airzoo-mini")
    options = MiniOptions
    jobs = 2

    def folder_name(self, options: MiniOptions, root: Path) -> str:
        """Return the benchmark's name, which has the seed in it where that is not 0."""
        return mini_protocols(seed_or_key(options)).benchmark

    def is_prepared(self, options: MiniOptions, settings: PrepareSettings) -> bool:
        """Return False: worlds and photos that are kept make another run short."""
        return False

    def prepare(self, options: MiniOptions, settings: PrepareSettings) -> Prepared:
        """Make worlds, fly over them, take photos and work out the truth of every track."""
        seed, engine, progress = seed_or_key(options), settings.engine, settings.progress
        protocols = mini_protocols(seed)
        regions = [REGIONS[scene.id] for scene in protocols.every[0].scenes]
        scenes, worlds = [], make_worlds(regions, settings.root, seed, engine, progress)
        for region, world in zip(regions, worlds, strict=True):
            photos = mini_photos(region, load_world(world).dsm, seed)
            folder = world.with_name(f"{world.name}-frames")
            renderer.render_frames(photos, world, folder, engine=engine, progress=progress)
            files = {"images": folder / "images", "cloud": folder / "cloud.ply"}
            maps = {"dom": "dom", "dsm": "dsm", "gallery": "satellite"}
            files |= {key: world / f"{name}.tif" for key, name in maps.items()}
            write_ply(files["cloud"], seen_surface(photos, folder, progress))
            inputs = scene_inputs(region, photos, files, seed)
            surveyed = inputs.photos["sequence"] == SURVEY  # they serve reconstruction
            make = partial(build_truths, inputs, protocols, files["cloud"], surveyed)
            truths = with_progress(make, f"{region.name}: truth", progress)
            scenes.append(SceneContent(inputs, truths, files))
        return write_benchmark(scenes, protocols, settings)


AIRZOO_MINI = AirZooMini()
