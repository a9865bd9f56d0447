"""What light a place gets besides the sun's: the share of sky that it sees, and street lamps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.mini.pixel_noise import Singles, hash64, uniforms
from airzoo_bench.mini.textures import Texture
from airzoo_bench.mini.world import World

__all__ = ["surroundings"]

_STEPS_M = (1.5, 4.0, 9.0, 20.0)
_AROUND = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))

_LAMP_CELL_M = 26.0
_LAMP_TRIES = 12
_LAMP_REACH_M = 30.0


def surroundings(world: World) -> Texture:
    """Return a texture whose first lane is the share of sky seen, the second the lamps' light.

    Its grid is that of the surface model.
    """
    lanes = np.zeros((*world.dsm.shape, 4), np.uint8)
    lanes[..., 0] = np.rint(255.0 * _openness(world.dsm, world.region.side_m))
    lanes[..., 1] = np.rint(255.0 * np.clip(_lamp_light(world), 0.0, 1.0))
    return Texture.of(lanes, world.region.side_m)


def _openness(dsm: NDArray[np.float32], side_m: float) -> Singles:
    """Mean over directions of cos^2 of the horizon's height: the share of a uniform sky's light."""
    gsd = side_m / len(dsm)
    reach = round(max(_STEPS_M) / gsd) + 1
    padded = np.pad(dsm, reach, mode="edge")
    total = np.zeros_like(dsm)
    for right, up in _AROUND:
        length = float(np.hypot(right, up))
        steepest = np.zeros_like(dsm)
        for step in _STEPS_M:
            pixels = round(step / gsd / length)
            rows = slice(reach - up * pixels, reach - up * pixels + len(dsm))
            columns = slice(reach + right * pixels, reach + right * pixels + len(dsm))
            rise = (padded[rows, columns] - dsm) / np.float32(pixels * gsd * length)
            np.maximum(steepest, rise, out=steepest)
        total += 1.0 / (1.0 + steepest * steepest)
    return total / np.float32(len(_AROUND))


def _lamp_light(world: World) -> Singles:
    gsd = world.region.side_m / len(world.dsm)
    light = np.zeros(world.dsm.shape, np.float32)
    pool = _pool(gsd)
    reach = len(pool) // 2
    light = np.pad(light, reach)
    for row, column in _lamp_places(world, gsd):
        light[row : row + len(pool), column : column + len(pool)] += pool
    return light[reach:-reach, reach:-reach]


def _pool(gsd: float) -> Singles:
    reach = round(_LAMP_REACH_M / gsd)
    offsets = np.arange(-reach, reach + 1) * gsd
    square = offsets[:, None] ** 2 + offsets[None] ** 2
    pool = 0.75 * np.exp(-square / 7.0**2) + 0.25 * np.exp(-square / 14.0**2)
    return pool.astype(np.float32)


def _lamp_places(world: World, gsd: float) -> list[tuple[int, int]]:
    """Rows and columns of lamps: in each cell of a grid, the first tried place that is paved."""
    paved = _paved(world)
    cells = max(round(world.region.side_m / _LAMP_CELL_M), 1)
    cell = len(paved) / cells
    tries = np.arange(cells * cells * _LAMP_TRIES, dtype=np.uint64)
    hashes = hash64(tries, world.seed + 0x1A3B).reshape(cells, cells, _LAMP_TRIES)
    own = np.arange(cells)
    down = uniforms(hashes.ravel(), 0).reshape(hashes.shape)
    right = uniforms(hashes.ravel(), 1).reshape(hashes.shape)
    rows = ((own[:, None, None] + down) * cell).astype(np.int64)
    columns = ((own[None, :, None] + right) * cell).astype(np.int64)
    good = paved[rows, columns]
    first = good.argmax(axis=2)[..., None]
    found = good.any(axis=2)
    chosen = (np.take_along_axis(places, first, 2)[..., 0][found] for places in (rows, columns))
    return list(zip(*(places.tolist() for places in chosen), strict=True))


def _paved(world: World) -> NDArray[np.bool_]:
    """Where the land is grey, not bright and not built over, on the surface model's grid."""
    step = len(world.ground_albedo) // len(world.dsm)
    ground = world.ground_albedo[::step, ::step].astype(np.int16)
    spread = ground.max(axis=-1) - ground.min(axis=-1)
    bright = ground.max(axis=-1)
    covered = (world.top_albedo[::step, ::step] != ground).any(axis=-1)
    paved: NDArray[np.bool_] = (spread < 16) & (bright > 60) & (bright < 190) & ~covered
    return paved & ~world.water[::step, ::step]
