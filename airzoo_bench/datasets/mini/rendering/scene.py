"""A world ready to be looked at: what comes along rays, and from how far."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.datasets.mini.noise import Singles, hash64, uniforms
from airzoo_bench.datasets.mini.rendering.raycast import MISSED, Points, Raycaster
from airzoo_bench.datasets.mini.rendering.shading import Shader
from airzoo_bench.datasets.mini.rendering.weather import Conditions, column, haze, sky_with_clouds
from airzoo_bench.datasets.mini.world.model import World
from airzoo_bench.geometry.arrays import Floats

__all__ = ["Rays", "Scene"]

_DITHER_SEED = 0xD17


@dataclass(frozen=True, eq=False)
class Rays:
    """N rays of one camera."""

    origin: Floats  # (3,): the camera's centre in the world's local frame
    # (3, N): as long as makes their z in the camera 1; NaN where the lens has no ray
    directions: Floats
    pixel: NDArray[np.uint64]  # (N,): number of the pixel
    pixel_angle: float  # size of a pixel at distance 1

    def take(self, index: NDArray[np.int64]) -> Rays:
        """Return the rays of these numbers."""
        directions = self.directions.take(index, axis=1)
        return Rays(self.origin, directions, self.pixel.take(index), self.pixel_angle)


class Scene:
    """A world's mesh and colours."""

    def __init__(self, world: World) -> None:
        self._caster = Raycaster(world.mesh)
        self.normal = self._caster.normal
        self._shader = Shader(world, self.normal)
        self._mesh = world.mesh
        border = [world.dsm[0], world.dsm[-1], world.dsm[:, 0], world.dsm[:, -1]]
        self._far_level_m = float(np.median(np.concatenate(border)))

    def look(self, rays: Rays, given: Conditions) -> tuple[Singles, Floats, NDArray[np.int64]]:
        """Return what is seen along N rays."""
        triangle, depth = self._caster.trace(rays.origin, rays.directions)
        light = np.zeros((3, len(depth)), np.float32)
        hit = np.flatnonzero(triangle != MISSED)
        free = np.flatnonzero((triangle == MISSED) & ~np.isnan(rays.directions[0]))
        if len(hit):
            light[:, hit] = self._surface(rays.take(hit), depth[hit], triangle[hit], given)
        if len(free):
            light[:, free] = self._beyond(rays.take(free), given)
        return light, depth, triangle

    def _surface(
        self, rays: Rays, depth: Floats, triangle: NDArray[np.int64], given: Conditions
    ) -> Singles:
        xyz = rays.directions * depth + rays.origin[:, None]
        normal = self.normal.take(triangle, axis=1)
        length = np.sqrt(_dot(rays.directions, rays.directions))
        away = _dot(normal, rays.directions) > 0.0
        np.negative(normal, out=normal, where=away)
        distance = (depth * length).astype(np.float32)
        points = Points(
            xyz=xyz.astype(np.float32),
            normal=normal.astype(np.float32),
            view=(rays.directions / length).astype(np.float32),
            distance=distance,
            footprint=distance * np.float32(rays.pixel_angle),
            dither=uniforms(hash64(rays.pixel, _DITHER_SEED)),
            material=self._mesh.material.take(triangle),
            owner=self._mesh.owner.take(triangle),
            triangle=triangle,
        )
        return self._shader.colour(points, self._sunlight(xyz, normal, given), given)

    def _sunlight(self, xyz: Floats, normal: Floats, given: Conditions) -> Singles:
        """Cosine of the sun's angle to surfaces, 0 where something stands in the way."""
        lit = np.zeros(xyz.shape[1], np.float32)
        if not given.direct:
            return lit
        sun = np.array(given.light.direction)
        cosine = _dot(normal, sun[:, None])
        facing = np.flatnonzero(cosine > 0.0)
        up = normal.take(facing, axis=1)
        shadow = self._caster.occluded(xyz.take(facing, axis=1), up, sun)
        lit[facing] = np.where(shadow, 0.0, cosine[facing])
        return lit

    def _beyond(self, rays: Rays, given: Conditions) -> Singles:
        """Sky above the horizon, and below it the land that goes on where the mesh ends."""
        length = np.sqrt(_dot(rays.directions, rays.directions))
        view = (rays.directions / length).astype(np.float32)
        light = np.empty_like(view)
        above, below = np.flatnonzero(view[2] >= 0.0), np.flatnonzero(view[2] < 0.0)
        light[:, above] = sky_with_clouds(view[:, above], given)
        down = view[:, below]
        land, distance = self._shader.far_land(down, rays.origin, self._far_level_m, given)
        sun = column(given.light.sun) * np.float32(given.light.direction[2])
        light[:, below] = haze(land * (column(given.light.sky) + sun), distance, down, given)
        return light


def _dot(a: Floats, b: Floats) -> Floats:
    # Not a matrix product: a BLAS kernel may round differently with the number of columns.
    product: Floats = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product
