"""Points where rays meet surfaces, textures of the land, and walls.

A texel is one 64-bit number of four 16-bit lanes (red, green, blue and one more). Weights of a
bilinear mean add up to 256, so that a lane never carries into the next and one multiplication
serves all four. The light that a place gets besides the sun's is a texture too.
Storeys, bays, windows, balconies and doors of walls are filtered to the pixel's size.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.datasets.mini.noise import Singles, floor_log2, hash64, uniforms, volume_noise
from airzoo_bench.datasets.mini.world import Buildings, Material, Mesh, World
from airzoo_bench.geometry.arrays import Floats

_Indices = NDArray[np.int64]

F = TypeVar("F", np.float32, np.float64)
_LANE_SCALE = np.float32(1.0 / (255.0 * 256.0))
_MOST_LEVELS = 8
_STEPS_M = (1.5, 4.0, 9.0, 20.0)  # where the horizon is looked for, in each direction
_AROUND = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
_LAMP_CELL_M, _LAMP_TRIES, _LAMP_REACH_M = 26.0, 12, 30.0
# left, right, bottom, top of a window as shares of its bay and storey, by style: single windows,
# bands, doors to balconies, none.
_WINDOWS = np.array(
    [(0.24, 0.76, 0.30, 0.82), (0.04, 0.96, 0.34, 0.84), (0.16, 0.84, 0.04, 0.80), (0, 0, 0, 0)],
    np.float32,
)
_SHOP = np.array([0.06, 0.94, 0.06, 0.72], np.float32)[:, None]
_BALCONY, _BARN = 2, 3
_PLINTH_M = 0.7
_DOOR_M = (2.0, 3.4)
_LIT_SHARE = np.float32(0.30)


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

    def made_of(self, *materials: int) -> tuple[_Indices, Points]:
        """Return the points of some materials, after their numbers."""
        which = np.flatnonzero(np.isin(self.material, materials))
        return which, Points(*(values.take(which, axis=-1) for values in vars(self).values()))

    def facing(self) -> Singles:
        """Return the cosine of the angle between surface and line of sight, (N,)."""
        return -dot(self.view, self.normal)


def dot(a: NDArray[F], b: NDArray[F]) -> NDArray[F]:
    """Return products of vectors (3, N) summed in a fixed order, as a BLAS kernel would not."""
    product: NDArray[F] = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


class Texture:
    """A square image (n, n, 4) and its halvings, the first row in the north; `side_m` long."""

    def __init__(self, lanes: NDArray[np.uint8], side_m: float) -> None:
        levels = [lanes]
        while len(levels) < _MOST_LEVELS and len(levels[-1]) > 4:
            odd = len(levels[-1]) % 2
            even = np.pad(levels[-1], ((0, odd), (0, odd), (0, 0)), mode="edge").astype(np.uint16)
            total = even[0::2, 0::2] + even[1::2, 0::2] + even[0::2, 1::2] + even[1::2, 1::2]
            levels.append(((total + 2) >> 2).astype(np.uint8))
        self._side_m, self._gsd_m = np.float32(side_m), side_m / len(lanes)
        self._sizes = np.array([len(level) for level in levels], np.int64)
        self._starts = np.cumsum(self._sizes**2) - self._sizes**2
        # 256ths of a texel
        self._scales = (256.0 / self._gsd_m / (1 << np.arange(len(levels)))).astype(np.float32)
        packed = [np.ascontiguousarray(level, np.uint16).view(np.uint64) for level in levels]
        self._texels = np.concatenate([level.ravel() for level in packed])

    def sample(self, x: Singles, y: Singles, footprint_m: Singles, dither: Singles) -> Singles:
        """Return the colour (4, N), in 0 to 1, at points of the square, mirrored beyond it."""
        level = floor_log2(footprint_m * (1.0 + dither) * np.float32(1.0 / self._gsd_m))
        np.clip(level, 0, len(self._sizes) - 1, out=level)
        size, scale, side = self._sizes.take(level), self._scales.take(level), self._side_m
        column, share_x = _split(_mirrored(x, side) * scale, size)
        row, share_y = _split((side - _mirrored(y, side)) * scale, size)
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


def _mirrored(x: Singles, side: np.float32) -> Singles:
    """Fold coordinates beyond [0, side] back into it, as between two mirrors."""
    period = 2 * side
    folded: Singles = side - np.abs(x - np.floor(x * (1 / period)) * period - side)
    return folded


def _split(position: Singles, size: _Indices) -> tuple[_Indices, _Indices]:
    """Split 256ths of texels into whole texels, from the centre of the first on, and the rest."""
    fixed = position.astype(np.int64) - 128
    np.clip(fixed, 0, (size - 1) << 8, out=fixed)
    return fixed >> 8, fixed & 255


def surroundings(world: World) -> Texture:
    """Return a texture: the first lane is the share of sky seen, the second the lamps' light."""
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
    """Rows and columns of lamps: in each cell of a grid, the first tried place that is paved.

    That is where the land is grey, not bright and not built over.
    """
    step = len(world.ground_albedo) // len(world.dsm)
    ground, top = (
        albedo[::step, ::step].astype(np.int16)
        for albedo in (world.ground_albedo, world.top_albedo)
    )
    bright, bare = ground.max(axis=-1), (top == ground).all(axis=-1)
    grey = (bright - ground.min(axis=-1) < 16) & (bright > 60) & (bright < 190)
    paved = grey & bare & ~world.water[::step, ::step]
    count = max(round(world.region.side_m / _LAMP_CELL_M), 1)
    hashes = hash64(np.arange(count * count * _LAMP_TRIES, dtype=np.uint64), world.seed + 0x1A3B)
    draws = np.stack([uniforms(hashes, k).reshape(count, count, _LAMP_TRIES) for k in (0, 1)])
    cells = np.mgrid[:count, :count][..., None]
    places = ((cells + draws) * (len(paved) / count)).astype(np.int64)
    good = paved[places[0], places[1]]
    first = np.take_along_axis(places, good.argmax(axis=2)[None, ..., None], 3)[..., 0]
    found: list[list[int]] = first[:, good.any(axis=2)].T.tolist()
    return found


class Facades:
    """The walls of a mesh, each with its own run of bays, given normals (3, T) of its triangles."""

    def __init__(self, mesh: Mesh, normal: Floats, buildings: Buildings) -> None:
        walls = np.flatnonzero(mesh.material == Material.WALL)
        # (4, T): direction along the wall of a triangle, where the wall starts, how long it is
        self._runs = np.zeros((4, len(mesh.triangles)), np.float32)
        self._runs[:, walls] = _runs(mesh, normal, walls)
        self._wall = (buildings.wall_colour / 255.0).astype(np.float32)
        self._window = (buildings.window_colour / 255.0).astype(np.float32)
        sizes = (buildings.base_m, buildings.storey_m, buildings.bay_m)
        self._sizes = np.stack(sizes).astype(np.float32)
        self._style = buildings.style.astype(np.int64)

    def look(self, points: Points) -> tuple[Singles, Singles, Singles, Singles]:
        """Return the look of M points on walls.

        Returns
        -------
        (3, M) albedo, (M,) share of glass, (3, M) light from within at night, (M,) metres above
        the building's floor
        """
        owner, (x, y, z) = points.owner, points.xyz
        along_x, along_y, start, length = self._runs.take(points.triangle, axis=1)
        base, storey_m, bay_m = self._sizes.take(owner, axis=1)
        u, height, style = x * along_x + y * along_y - start, z - base, self._style.take(owner)
        width = length / np.maximum(np.floor(length / bay_m), 1.0)
        across, up = u / width, height / storey_m
        column, storey = np.floor(across), np.floor(up)
        slant = np.divide(points.footprint, np.maximum(points.facing(), np.float32(0.2)))
        cell, fuzz = (across - column, up - storey), (slant / width, points.footprint / storey_m)
        # The same for all pixels of a window, whichever of the wall's triangles they hit.
        place = (owner.astype(np.int64) * 4096 + column.astype(np.int64)) * 256
        number = hash64((place + storey.astype(np.int64)).view(np.uint64), 0x57A11)
        lit, shade, curtain, shop = (uniforms(number, lane) for lane in range(4))
        street = (storey == 0) & (style < _BALCONY) & (shop < 0.6)
        left, right, bottom, top = np.where(street, _SHOP, _WINDOWS.take(style, axis=0).T)
        glass = _covered(cell[0], left, right, fuzz[0]) * _covered(cell[1], bottom, top, fuzz[1])
        glass[storey < 0] = 0.0
        # Of a barn, the door.
        half, fuzzy = _DOOR_M[0], np.maximum(slant, np.float32(0.02))
        door = np.clip((half - np.abs(u - length / 2)) / fuzzy + 0.5, 0.0, 1.0)
        door *= np.clip((_DOOR_M[1] - height) / fuzzy + 0.5, 0.0, 1.0)
        door = door * (style == _BARN) * np.float32(0.9)
        glass *= 1.0 - door
        albedo = self._plaster(points, style, cell, fuzz, height)
        albedo += (np.float32(0.16) - albedo) * door
        dim = np.float32(0.6) * shade
        pane = self._window.take(owner, axis=0).T * (np.float32(0.65) + dim)
        pane += (np.float32(0.75) - pane) * ((curtain < 0.22) * np.float32(0.35))
        albedo += (pane - albedo) * glass
        strength = (lit < _LIT_SHARE) * (np.float32(0.45) + dim) * glass
        warm = np.stack([np.ones_like(curtain), 0.74 + 0.2 * curtain, 0.40 + 0.5 * curtain])
        return albedo, glass, (warm * strength).astype(np.float32), height

    def _plaster(
        self,
        points: Points,
        style: _Indices,
        cell: tuple[Singles, Singles],
        fuzz: tuple[Singles, Singles],
        height: Singles,
    ) -> Singles:
        x, y, z = points.xyz
        stain = volume_noise((x, y, z * np.float32(0.15)), 0.5, points.footprint)
        grain = volume_noise(points.xyz, 0.07, points.footprint)
        light = 1.0 + np.float32(0.035) * stain + np.float32(0.03) * grain
        light -= np.float32(0.16) * _covered(cell[1], 0.0, 0.045, fuzz[1])
        railing = _covered(cell[1], 0.0, 0.34, fuzz[1]) * _covered(cell[0], 0.08, 0.92, fuzz[0])
        light += np.float32(0.14) * railing * (style == _BALCONY)
        light *= 1.0 - np.float32(0.22) * (height < _PLINTH_M)
        return self._wall.take(points.owner, axis=0).T * light


def _runs(mesh: Mesh, normal: Floats, walls: _Indices) -> Floats:
    """Return the directions (2, W) along walls of triangles, their starts and lengths, (4, W)."""
    nx, ny = normal[0, walls], normal[1, walls]
    level = np.hypot(nx, ny)
    safe = np.where(level > 0.0, level, 1.0)
    along = np.stack([-ny / safe, nx / safe])
    corners = mesh.vertices[mesh.triangles[walls], :2]
    reach = corners[..., 0] * along[0][:, None] + corners[..., 1] * along[1][:, None]
    plane = (corners[:, 0] * np.stack([nx, ny], axis=-1)).sum(axis=1)
    # Triangles of one plane of one building are one wall.
    key = np.stack([mesh.owner[walls], np.rint(nx * 100), np.rint(ny * 100), np.rint(plane * 5)])
    walls_found, wall = np.unique(key, axis=1, return_inverse=True)
    wall, count = wall.ravel(), walls_found.shape[1]
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, wall, reach.min(axis=1))
    np.maximum.at(high, wall, reach.max(axis=1))
    return np.stack([*along, low[wall], np.maximum(high - low, 0.1)[wall]])


def _covered(place: Singles, low: Singles | float, high: Singles | float, size: Singles) -> Singles:
    """Share of a pixel of `size` at `place` that lies between `low` and `high` of a cell of 1."""
    half = np.clip(size, 0.02, 1.0) * np.float32(0.5)
    inside = np.minimum(place + half, high) - np.maximum(place - half, low)
    sharp = np.clip(inside / (2 * half), 0.0, 1.0)
    # A pixel of a cell or more sees the mean of all cells.
    coarse = np.clip(size * 2.0 - 0.8, 0.0, 1.0)
    share: Singles = sharp + (np.subtract(high, low, dtype=np.float32) - sharp) * coarse
    return share
