"""Walls of buildings: storeys, bays, windows, balconies and doors, filtered to a pixel's size."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.datasets.mini.model import Buildings, Material, Mesh
from airzoo_bench.datasets.mini.noise import Singles, hash64, uniforms, volume_noise
from airzoo_bench.datasets.mini.surfaces import Points
from airzoo_bench.geometry.arrays import Floats

_Indices = NDArray[np.int64]
_Numbers = NDArray[np.uint64]

# left, right, bottom, top of a window as shares of its bay and storey, by style: single windows,
# bands, doors to balconies, none.
_WINDOWS = np.array(
    [(0.24, 0.76, 0.30, 0.82), (0.04, 0.96, 0.34, 0.84), (0.16, 0.84, 0.04, 0.80), (0, 0, 0, 0)],
    np.float32,
)
_BALCONY, _BARN = 2, 3
_SHOP = (0.06, 0.94, 0.06, 0.72)
_PLINTH_M = 0.7
_DOOR_M = (2.0, 3.4)
_LIT_SHARE = 0.30


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
        u, height = x * along_x + y * along_y - start, z - base
        width = length / np.maximum(np.floor(length / bay_m), 1.0)
        across, up = u / width, height / storey_m
        column, storey = np.floor(across), np.floor(up)
        slant = np.divide(points.footprint, np.maximum(points.facing(), np.float32(0.2)))
        fuzz = np.stack([slant / width, points.footprint / storey_m])
        # The same for all pixels of a window, whichever of the wall's triangles they hit.
        place = (owner.astype(np.int64) * 4096 + column.astype(np.int64)) * 256
        number = hash64((place + storey.astype(np.int64)).view(np.uint64), 0x57A11)
        style = self._style.take(owner)
        cell = np.stack([across - column, up - storey])
        glass = _glass(cell, fuzz, style, storey, number)
        glass[storey < 0] = 0.0
        albedo = self._plaster(points, style, cell, fuzz, height)
        door = _door(u - length / 2, height, slant, style)
        glass *= 1.0 - door
        albedo += (np.float32(0.16) - albedo) * door
        albedo += (self._panes(owner, number) - albedo) * glass
        return albedo, glass, _glow(number, glass), height

    def _plaster(
        self, points: Points, style: _Indices, cell: Singles, fuzz: Singles, height: Singles
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

    def _panes(self, owner: NDArray[np.int32], number: _Numbers) -> Singles:
        shade = np.float32(0.65) + np.float32(0.6) * uniforms(number, 1)
        curtain = (uniforms(number, 2) < 0.22) * np.float32(0.35)
        pane: Singles = self._window.take(owner, axis=0).T * shade
        return pane + (np.float32(0.75) - pane) * curtain


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


def _glass(
    cell: Singles, fuzz: Singles, style: _Indices, storey: Singles, number: _Numbers
) -> Singles:
    box = _WINDOWS.take(style, axis=0).T
    street = (storey == 0) & (style < _BALCONY) & (uniforms(number, 3) < 0.6)
    left, right, bottom, top = (
        np.where(street, np.float32(shop), side) for shop, side in zip(_SHOP, box, strict=True)
    )
    return _covered(cell[0], left, right, fuzz[0]) * _covered(cell[1], bottom, top, fuzz[1])


def _covered(place: Singles, low: Singles | float, high: Singles | float, size: Singles) -> Singles:
    """Share of a pixel of `size` at `place` that lies between `low` and `high` of a cell of 1."""
    half = np.clip(size, 0.02, 1.0) * np.float32(0.5)
    inside = np.minimum(place + half, high) - np.maximum(place - half, low)
    sharp = np.clip(inside / (2 * half), 0.0, 1.0)
    # A pixel of a cell or more sees the mean of all cells.
    coarse = np.clip(size * 2.0 - 0.8, 0.0, 1.0)
    share: Singles = sharp + (np.subtract(high, low, dtype=np.float32) - sharp) * coarse
    return share


def _door(offset: Singles, height: Singles, slant: Singles, style: _Indices) -> Singles:
    half, top = _DOOR_M
    fuzz = np.maximum(slant, np.float32(0.02))
    across = np.clip((half - np.abs(offset)) / fuzz + 0.5, 0.0, 1.0)
    up = np.clip((top - height) / fuzz + 0.5, 0.0, 1.0)
    door: Singles = across * up * (style == _BARN) * np.float32(0.9)
    return door


def _glow(number: _Numbers, glass: Singles) -> Singles:
    lit = uniforms(number, 0) < np.float32(_LIT_SHARE)
    strength = lit * (np.float32(0.45) + np.float32(0.6) * uniforms(number, 1)) * glass
    warmth = uniforms(number, 2)
    colour = np.stack([np.ones_like(warmth), 0.74 + 0.2 * warmth, 0.40 + 0.5 * warmth])
    return (colour * strength).astype(np.float32)
