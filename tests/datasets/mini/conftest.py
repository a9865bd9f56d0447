"""AirZoo-Mini, prepared once a session; and a small world made by hand, with views of it.

The small world is the corner of a plan whose every measure is known: flat land at `GROUND_M`, one
block with a flat roof, one with a gable, trees and a pond.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.datasets.mini import build
from airzoo_bench.datasets.mini.dataset import AIRZOO_MINI
from airzoo_bench.datasets.mini.layout import Box, Building, Decal, Frame, Plan, Raster
from airzoo_bench.datasets.mini.noise import Dice
from airzoo_bench.datasets.mini.renderer import Renderer, default_camera, read_depth
from airzoo_bench.datasets.mini.world import Region, World, load_world
from airzoo_bench.datasets.settings import MiniOptions, PrepareSettings
from airzoo_bench.engines.engine import Engine
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras, back_project
from airzoo_bench.geometry.poses import Poses, angles_to_rotations
from tests.support import made_once

SIDE_M, GROUND_M = 96.0, 20.0
REGION = Region("small", 401_000.0, 3_120_000.0, SIDE_M)
CORNER = np.array([REGION.west, REGION.south, 0.0])
BLOCK = (20.0, 30.0, 40.0, 50.0, 32.0)  # west, south, east, north, top


@dataclass(frozen=True)
class Prepared:
    """A data root with AirZoo-Mini in it."""

    root: Path
    benchmark: Benchmark

    def depth(self, scene: str, image: str) -> Floats:
        frames = self.root / "mini-worlds" / f"{scene}-0-frames"
        return read_depth(frames / "depth" / f"{Path(image).stem}.tif")

    def world(self, scene: str) -> World:
        return load_world(self.root / "mini-worlds" / f"{scene}-0")


@pytest.fixture(scope="session")
def mini(tmp_path_factory: pytest.TempPathFactory) -> Prepared:
    def make(root: Path) -> None:
        folder, files = root / "airzoo-mini", {"tiles_on_disk": True, "crops_on_disk": True}
        AIRZOO_MINI.prepare(MiniOptions(), PrepareSettings(folder, root, engine=Engine(2), **files))

    root = made_once(tmp_path_factory, "airzoo-mini", make)
    return Prepared(root, Benchmark.open(root / "airzoo-mini"))


@cache
def small_world() -> World:
    plan, origin = Plan(0, Dice(0), np.full((301, 301), GROUND_M)), Frame(0.0, 0.0)
    grass, street, pond = (-8, 608, -8, 608), (45, 51, -8, 608), (70, 88, 8, 22)
    for kind, box in (("meadow", grass), ("asphalt", street), ("water", pond)):
        plan.paint(kind, Box(origin, *map(float, box)))
    block, house = Frame(30.0, 40.0).box(10.0, 10.0), Frame(66.0, 66.0, 0.0, 1.0).box(10.0, 6.0)
    flat, tiled = (
        (Decal(kind, box, 0, colour=(150, 148, 142)),)
        for kind, box in (("membrane", block), ("tiles", house))
    )
    plan.buildings += [
        Building(block, GROUND_M, BLOCK[4], BLOCK[4], "flat", flat, style=0),
        Building(house, GROUND_M, 27.0, 31.0, "gabled", tiled, style=2),
    ]
    for x, y, radius in ((50, 20, 3.0), (58, 24, 2.5), (80, 40, 3.5), (15, 70, 3.0)):
        plan.plant((x, y), radius, 2.5 * radius)
    # Maps of the corner alone: those of a whole region take some seconds.
    rasters = Raster(384, 0.25), Raster(192, 0.5), Raster(320, 0.3, 0.48, -0.36)
    with mock.patch.multiple(build, **dict(zip(("_MAP", "_DSM", "_MOSAIC"), rasters, strict=True))):
        return build.world_of_plan(REGION, plan)


@cache
def renderer() -> Renderer:
    return Renderer(small_world())


def pose(centre: Sequence[float], yaw: float, pitch: float, roll: float = 0.0) -> Poses:
    rotation = angles_to_rotations(yaw, pitch, roll, convergence_deg=0.0)
    return Poses.from_centres(rotation[None], np.array([centre]) + CORNER)


CAMERA = default_camera(160, 120)
NADIR = pose((48.0, 48.0, 100.0), 20.0, -90.0)
OBLIQUE = pose((48.0, -20.0, 90.0), 5.0, -45.0)
HORIZON = pose((110.0, -10.0, 45.0), -35.0, -10.0)


def rays(camera: Cameras, view: Poses) -> Floats:
    x, y = np.meshgrid(np.arange(camera.width[0]) + 0.5, np.arange(camera.height[0]) + 0.5)
    unit = back_project(camera, np.stack([x.ravel(), y.ravel()], axis=-1)[None])[0]
    directions: Floats = (unit / unit[:, 2:]) @ view.rotation[0]
    return directions
