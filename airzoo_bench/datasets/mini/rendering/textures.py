"""Colours of a square of land as a texture, filtered to the size of the pixel that sees it.

A texel is one 64-bit number of four 16-bit lanes (red, green, blue and one more). Weights of a
bilinear mean add up to 256, so that a lane never carries into the next and one multiplication
serves all four. What light a place gets besides the sun's is a texture too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.datasets.mini.noise import Singles, floor_log2, hash64, uniforms
from airzoo_bench.datasets.mini.world.model import World

__all__ = ["Texture", "surroundings"]

_LANE_SCALE = np.float32(1.0 / (255.0 * 256.0))
_MOST_LEVELS = 8


@dataclass(frozen=True, eq=False)
class Texture:
    """A square image and its halvings."""

    texels: NDArray[np.uint64]  # (sum of level sizes,)
    offsets: NDArray[np.int64]  # (levels,): where each level starts
    sizes: NDArray[np.int64]  # (levels,): how many texels a side it has
    side_m: float  # length of the square on the ground

    @classmethod
    def of(cls, lanes: NDArray[np.uint8], side_m: float) -> Texture:
        """Make a texture of lanes (n, n, 4), the first row in the north."""
        levels = [lanes]
        while len(levels) < _MOST_LEVELS and len(levels[-1]) > 4:
            levels.append(_halved(levels[-1]))
        sizes = np.array([len(level) for level in levels], np.int64)
        offsets = np.concatenate(([0], np.cumsum(sizes * sizes)[:-1])).astype(np.int64)
        packed = [np.ascontiguousarray(level, np.uint16).view(np.uint64) for level in levels]
        return cls(np.concatenate([level.ravel() for level in packed]), offsets, sizes, side_m)

    def sample(self, x: Singles, y: Singles, footprint_m: Singles, dither: Singles) -> Singles:
        """Return the colour (4, N), in 0 to 1, at points of the square."""
        gsd_m = self.side_m / int(self.sizes[0])
        level = floor_log2(footprint_m * (1.0 + dither) * np.float32(1.0 / gsd_m))
        np.clip(level, 0, len(self.sizes) - 1, out=level)
        size, start = self.sizes.take(level), self.offsets.take(level)
        # 256ths of a texel
        scale = (256.0 / gsd_m / (1 << np.arange(len(self.sizes)))).astype(np.float32).take(level)
        north, side = self._mirrored(y), np.float32(self.side_m)
        column, share_x = _split(self._mirrored(x) * scale, size)
        row, share_y = _split((side - north) * scale, size)
        right = column < size - 1
        down = np.where(row < size - 1, size, 0)
        first = start + row * size + column
        both = (share_x * share_y) >> 8
        weights = (256 - share_x - share_y + both, share_x - both, share_y - both, both)
        places = (first, first + right, first + down, first + down + right)
        total = np.zeros(len(first), np.uint64)
        for place, weight in zip(places, weights, strict=True):
            total += self.texels.take(place) * weight.view(np.uint64)
        lanes = total.view(np.uint16).reshape(-1, 4).T
        return lanes.astype(np.float32, order="C") * _LANE_SCALE

    def _mirrored(self, x: Singles) -> Singles:
        """Fold coordinates beyond [0, side] back into it, as between two mirrors."""
        side = np.float32(self.side_m)
        period = 2 * side
        folded: Singles = side - np.abs(x - np.floor(x * (1 / period)) * period - side)
        return folded


def _split(
    position: Singles, size: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Split 256ths of texels into whole texels, from the centre of the first on, and the rest."""
    fixed = position.astype(np.int64) - 128
    np.clip(fixed, 0, (size - 1) << 8, out=fixed)
    return fixed >> 8, fixed & 255


def _halved(level: NDArray[np.uint8]) -> NDArray[np.uint8]:
    odd = len(level) % 2
    even = np.pad(level, ((0, odd), (0, odd), (0, 0)), mode="edge").astype(np.uint16)
    total = even[0::2, 0::2] + even[1::2, 0::2] + even[0::2, 1::2] + even[1::2, 1::2]
    return ((total + 2) >> 2).astype(np.uint8)


_STEPS_M = (1.5, 4.0, 9.0, 20.0)
_AROUND = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))

_LAMP_CELL_M = 26.0
_LAMP_TRIES = 12
_LAMP_REACH_M = 30.0


def surroundings(world: World) -> Texture:
    """Return a texture whose first lane is the share of sky seen, the second the lamps' light."""
    gsd = world.region.side_m / len(world.dsm)
    lanes = np.zeros((*world.dsm.shape, 4), np.uint8)
    lanes[..., 0] = np.rint(255.0 * _openness(world.dsm, gsd))
    lanes[..., 1] = np.rint(255.0 * np.clip(_lamp_light(world, gsd), 0.0, 1.0))
    return Texture.of(lanes, world.region.side_m)


def _openness(dsm: NDArray[np.float32], gsd: float) -> Singles:
    """Mean over directions of cos^2 of the horizon's height: the share of a uniform sky's light."""
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


def _lamp_light(world: World, gsd: float) -> Singles:
    reach = round(_LAMP_REACH_M / gsd)
    offsets = np.arange(-reach, reach + 1) * gsd
    square = offsets[:, None] ** 2 + offsets[None] ** 2
    pool = 0.75 * np.exp(-square / 7.0**2) + 0.25 * np.exp(-square / 14.0**2)
    pool = pool.astype(np.float32)
    light = np.pad(np.zeros(world.dsm.shape, np.float32), reach)
    for row, column in _lamp_places(world):
        light[row : row + len(pool), column : column + len(pool)] += pool
    return light[reach:-reach, reach:-reach]


def _lamp_places(world: World) -> list[tuple[int, int]]:
    """Rows and columns of lamps: in each cell of a grid, the first tried place that is paved."""
    paved = _paved(world)
    cells = max(round(world.region.side_m / _LAMP_CELL_M), 1)
    tries = np.arange(cells * cells * _LAMP_TRIES, dtype=np.uint64)
    hashes = hash64(tries, world.seed + 0x1A3B)
    down, right = (uniforms(hashes, k).reshape(cells, cells, _LAMP_TRIES) for k in (0, 1))
    own, cell = np.arange(cells), len(paved) / cells
    rows = ((own[:, None, None] + down) * cell).astype(np.int64)
    columns = ((own[None, :, None] + right) * cell).astype(np.int64)
    good = paved[rows, columns]
    first, found = good.argmax(axis=2)[..., None], good.any(axis=2)
    chosen = (np.take_along_axis(places, first, 2)[..., 0][found] for places in (rows, columns))
    return list(zip(*(places.tolist() for places in chosen), strict=True))


def _paved(world: World) -> NDArray[np.bool_]:
    """Where the land is grey, not bright and not built over, on the surface model's grid."""
    step = len(world.ground_albedo) // len(world.dsm)
    ground = world.ground_albedo[::step, ::step].astype(np.int16)
    bright = ground.max(axis=-1)
    covered = (world.top_albedo[::step, ::step] != ground).any(axis=-1)
    grey = bright - ground.min(axis=-1) < 16
    paved: NDArray[np.bool_] = grey & (bright > 60) & (bright < 190) & ~covered
    return paved & ~world.water[::step, ::step]
