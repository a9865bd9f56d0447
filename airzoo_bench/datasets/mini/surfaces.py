"""Points where rays meet surfaces, and textures of the land.

A texel is one 64-bit number of four 16-bit lanes (red, green, blue and one more). Weights of a
bilinear mean add up to 256, so that a lane never carries into the next and one multiplication
serves all four. The light that a place gets besides the sun's is a texture too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.datasets.mini.model import World
from airzoo_bench.datasets.mini.noise import Singles, floor_log2, hash64, uniforms
from airzoo_bench.geometry.arrays import Bools

_Indices = NDArray[np.int64]

# A pixel that grazes a surface covers a long strip of it. Its colour is filtered to the geometric
# mean of the strip's sides, up to this: a little too sharp along, a little too soft across.
_MOST_SLANT = 4.0

F = TypeVar("F", np.float32, np.float64)
_LANE_SCALE = np.float32(1.0 / (255.0 * 256.0))
_MOST_LEVELS = 8
_STEPS_M = (1.5, 4.0, 9.0, 20.0)  # where the horizon is looked for, in each direction
_AROUND = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
_LAMP_CELL_M, _LAMP_TRIES, _LAMP_REACH_M = 26.0, 12, 30.0


@dataclass(frozen=True, eq=False)
class Points:
    """N points where rays of one camera meet surfaces."""

    xyz: Singles  # (3, N): metres of the world's local frame
    normal: Singles  # (3, N): unit, on the side that is seen
    view: Singles  # (3, N): unit direction from the camera
    distance: Singles  # (N,): metres from the camera
    footprint: Singles  # (N,): size of the pixel across the ray, metres
    dither: Singles  # (N,): in [0, 1), another one for each pixel
    material: NDArray[np.uint8]  # (N,)
    owner: NDArray[np.int32]  # (N,)
    triangle: _Indices  # (N,)

    def __len__(self) -> int:
        return len(self.distance)

    def made_of(self, *materials: int) -> tuple[_Indices, Points]:
        """Return the points of some materials, after their numbers."""
        which = np.flatnonzero(np.isin(self.material, materials))
        return which, Points(*(values.take(which, axis=-1) for values in vars(self).values()))

    def facing(self) -> Singles:
        """Return the cosine of the angle between surface and line of sight, (N,)."""
        return -dot(self.view, self.normal)

    def texture_footprint(self) -> Singles:
        """Return the size of the pixel on the surface, (N,) metres."""
        shrink = np.sqrt(np.maximum(self.facing(), np.float32(1.0 / _MOST_SLANT)))
        return np.divide(self.footprint, shrink, dtype=np.float32)


def dot(a: NDArray[F], b: NDArray[F]) -> NDArray[F]:
    """Return products of vectors (3, N) summed in a fixed order, as a BLAS kernel would not."""
    product: NDArray[F] = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


class Texture:
    """A square image (n, n, 4) and its halvings, the first row in the north; `side_m` long."""

    def __init__(self, lanes: NDArray[np.uint8], side_m: float) -> None:
        levels = [lanes]
        while len(levels) < _MOST_LEVELS and len(levels[-1]) > 4:
            levels.append(_halved(levels[-1]))
        self._side_m, self._gsd_m = side_m, side_m / len(lanes)
        self._sizes = np.array([len(level) for level in levels], np.int64)
        self._starts = np.cumsum(self._sizes**2) - self._sizes**2
        # 256ths of a texel
        steps = 1 << np.arange(len(levels))
        self._scales = (256.0 / self._gsd_m / steps).astype(np.float32)
        packed = [np.ascontiguousarray(level, np.uint16).view(np.uint64) for level in levels]
        self._texels = np.concatenate([level.ravel() for level in packed])

    def sample(self, x: Singles, y: Singles, footprint_m: Singles, dither: Singles) -> Singles:
        """Return the colour (4, N), in 0 to 1, at points of the square."""
        level = floor_log2(footprint_m * (1.0 + dither) * np.float32(1.0 / self._gsd_m))
        np.clip(level, 0, len(self._sizes) - 1, out=level)
        size, scale = self._sizes.take(level), self._scales.take(level)
        side = np.float32(self._side_m)
        column, share_x = _split(_mirror(x, side) * scale, size)
        row, share_y = _split((side - _mirror(y, side)) * scale, size)
        right = column < size - 1
        down = np.where(row < size - 1, size, 0)
        first = self._starts.take(level) + row * size + column
        both = (share_x * share_y) >> 8
        weights = (256 - share_x - share_y + both, share_x - both, share_y - both, both)
        places = (first, first + right, first + down, first + down + right)
        total = np.zeros(len(first), np.uint64)
        for place, weight in zip(places, weights, strict=True):
            total += self._texels.take(place) * weight.view(np.uint64)
        lanes = total.view(np.uint16).reshape(-1, 4).T
        return lanes.astype(np.float32, order="C") * _LANE_SCALE


def _mirror(x: Singles, side: np.float32) -> Singles:
    """Fold coordinates beyond [0, side] back into it, as between two mirrors."""
    period = 2 * side
    folded: Singles = side - np.abs(x - np.floor(x * (1 / period)) * period - side)
    return folded


def _split(position: Singles, size: _Indices) -> tuple[_Indices, _Indices]:
    """Split 256ths of texels into whole texels, from the centre of the first on, and the rest."""
    fixed = position.astype(np.int64) - 128
    np.clip(fixed, 0, (size - 1) << 8, out=fixed)
    return fixed >> 8, fixed & 255


def _halved(level: NDArray[np.uint8]) -> NDArray[np.uint8]:
    odd = len(level) % 2
    even = np.pad(level, ((0, odd), (0, odd), (0, 0)), mode="edge").astype(np.uint16)
    total = even[0::2, 0::2] + even[1::2, 0::2] + even[0::2, 1::2] + even[1::2, 1::2]
    return ((total + 2) >> 2).astype(np.uint8)


def surroundings(world: World) -> Texture:
    """Return a texture whose first lane is the share of sky seen, the second the lamps' light."""
    gsd = world.region.side_m / len(world.dsm)
    lanes = np.zeros((*world.dsm.shape, 4), np.uint8)
    lanes[..., 0] = np.rint(255.0 * _openness(world.dsm, gsd))
    lanes[..., 1] = np.rint(255.0 * np.clip(_lamp_light(world, gsd), 0.0, 1.0))
    return Texture(lanes, world.region.side_m)


def _openness(dsm: Singles, gsd: float) -> Singles:
    """Mean over directions of cos^2 of the horizon's height: the share of a uniform sky's light."""
    reach = round(max(_STEPS_M) / gsd) + 1
    padded = np.pad(dsm, reach, mode="edge")
    total = np.zeros_like(dsm)
    for right, up in _AROUND:
        length = float(np.hypot(right, up))
        steepest = np.zeros_like(dsm)
        for step in _STEPS_M:
            pixels = round(step / gsd / length)
            top, left = reach - up * pixels, reach + right * pixels
            there = padded[top : top + len(dsm), left : left + len(dsm)]
            np.maximum(steepest, (there - dsm) / np.float32(pixels * gsd * length), out=steepest)
        total += 1.0 / (1.0 + steepest * steepest)
    return total / np.float32(len(_AROUND))


def _lamp_light(world: World, gsd: float) -> Singles:
    reach = round(_LAMP_REACH_M / gsd)
    offsets = np.arange(-reach, reach + 1) * gsd
    square = offsets[:, None] ** 2 + offsets[None] ** 2
    pool = (0.75 * np.exp(-square / 7.0**2) + 0.25 * np.exp(-square / 14.0**2)).astype(np.float32)
    light = np.pad(np.zeros(world.dsm.shape, np.float32), reach)
    for row, column in _lamp_places(world):
        light[row : row + len(pool), column : column + len(pool)] += pool
    return light[reach:-reach, reach:-reach]


def _lamp_places(world: World) -> list[list[int]]:
    """Rows and columns of lamps: in each cell of a grid, the first tried place that is paved."""
    paved = _paved(world)
    count = max(round(world.region.side_m / _LAMP_CELL_M), 1)
    hashes = hash64(np.arange(count * count * _LAMP_TRIES, dtype=np.uint64), world.seed + 0x1A3B)
    draws = np.stack([uniforms(hashes, k).reshape(count, count, _LAMP_TRIES) for k in (0, 1)])
    cells = np.mgrid[:count, :count][..., None]
    places = ((cells + draws) * (len(paved) / count)).astype(np.int64)
    good = paved[places[0], places[1]]
    first = np.take_along_axis(places, good.argmax(axis=2)[None, ..., None], 3)[..., 0]
    found: list[list[int]] = first[:, good.any(axis=2)].T.tolist()
    return found


def _paved(world: World) -> Bools:
    """Where the land is grey, not bright and not built over, on the surface model's grid."""
    step = len(world.ground_albedo) // len(world.dsm)
    ground = world.ground_albedo[::step, ::step].astype(np.int16)
    bright = ground.max(axis=-1)
    covered = (world.top_albedo[::step, ::step] != ground).any(axis=-1)
    grey = (bright - ground.min(axis=-1) < 16) & (bright > 60) & (bright < 190)
    paved: Bools = grey & ~covered & ~world.water[::step, ::step]
    return paved
