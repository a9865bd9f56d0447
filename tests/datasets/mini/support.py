"""A small world, the corner of a plan made by hand whose every measure is known, and views of it.

Flat land at `GROUND_M`, one block with a flat roof, one with a gable, trees and a pond.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from airzoo_bench.datasets.mini.build import world_of_plan
from airzoo_bench.datasets.mini.noise import Dice
from airzoo_bench.datasets.mini.plan import Box, Building, Decal, Frame, Plan
from airzoo_bench.datasets.mini.renderer import Renderer, default_camera
from airzoo_bench.datasets.mini.world import Region, World
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras, back_project
from airzoo_bench.geometry.poses import Poses, angles_to_rotations

SIDE_M, GROUND_M, RIDGE_M = 96.0, 20.0, 31.0
LAND_M = (-800.0, 1400.0)  # where the mesh ends
REGION = Region("small", 401_000.0, 3_120_000.0, SIDE_M)
CORNER = np.array([REGION.west, REGION.south, 0.0])
# west, south, east, north, top
BLOCK = (20.0, 30.0, 40.0, 50.0, 32.0)
TREES = ((50.0, 20.0, 3.0), (58.0, 24.0, 2.5), (80.0, 40.0, 3.5), (15.0, 70.0, 3.0))


@cache
def world() -> World:
    """Return the world, the same object each time."""
    plan, origin = Plan(0, Dice(0), np.full((301, 301), GROUND_M)), Frame(0.0, 0.0)
    for kind, *box in (
        ("meadow", -8, 608, -8, 608), ("asphalt", 45, 51, -8, 608), ("water", 70, 88, 8, 22)
    ):  # fmt: skip
        plan.paint(kind, Box(origin, *map(float, box)))
    block, house = Frame(30.0, 40.0).box(10.0, 10.0), Frame(66.0, 66.0, 0.0, 1.0).box(10.0, 6.0)
    covers = [
        (Decal(kind, box, 0, colour=(150, 148, 142)),)
        for kind, box in (("membrane", block), ("tiles", house))
    ]
    plan.buildings += [
        Building(block, GROUND_M, BLOCK[4], BLOCK[4], "flat", covers[0], style=0),
        Building(house, GROUND_M, 27.0, RIDGE_M, "gabled", covers[1], style=2),
    ]
    for x, y, radius in TREES:
        plan.plant((x, y), radius, 2.5 * radius)
    whole = world_of_plan(REGION, plan)
    names = ("ground", "top", "dsm", "dom", "satellite")
    maps = {name: getattr(whole, name) for name in names}
    corners = {name: pixels[-(len(pixels) * 4 // 25) :] for name, pixels in maps.items()}
    return replace(whole, **{name: part[:, : len(part)].copy() for name, part in corners.items()})


@cache
def renderer() -> Renderer:
    return Renderer(world())


def camera(width: int = 160, height: int = 120) -> Cameras:
    return default_camera(width, height)


def pose(centre: Sequence[float], yaw: float, pitch: float, roll: float = 0.0) -> Poses:
    """Return one pose; the centre is in the world's local frame."""
    rotation = angles_to_rotations(yaw, pitch, roll, convergence_deg=0.0)
    return Poses.from_centres(rotation[None], np.array([centre]) + CORNER)


NADIR = pose((48.0, 48.0, 100.0), 20.0, -90.0)
OBLIQUE = pose((48.0, -20.0, 90.0), 5.0, -45.0)
HORIZON = pose((110.0, -10.0, 45.0), -35.0, -10.0)


def rays(camera: Cameras, pose: Poses) -> Floats:
    """Return directions (H * W, 3) in the world, z of the camera being 1."""
    width, height = int(camera.width[0]), int(camera.height[0])
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    unit = back_project(camera, np.stack([x.ravel(), y.ravel()], axis=-1)[None])[0]
    directions: Floats = (unit / unit[:, 2:]) @ pose.rotation[0]
    return directions
