"""The colour of surfaces: their paint, the light on them, and what they mirror."""

from __future__ import annotations

import numpy as np

from airzoo_bench.datasets.mini.noise import Singles, volume_noise
from airzoo_bench.datasets.mini.surfaces import Facades, Points, Texture, surroundings
from airzoo_bench.datasets.mini.weather import Conditions, column, haze, sky_colour
from airzoo_bench.datasets.mini.world import Material, World
from airzoo_bench.geometry.arrays import Floats

_MOST_SLANT = 4.0
_LAMP = (1.0, 0.74, 0.42)
_TRUNK = (0.30, 0.24, 0.18)
_SNOW = (0.86, 0.88, 0.93)
# Share of the lamps' light that reaches roofs.
_ON_ROOFS = np.float32(0.04)
# Sunlight that leaves let through to their shadow side.
_THROUGH_LEAVES = 0.13
_BASE_REFLECTANCE = np.float32(0.04)
# Light that the ground throws back at surfaces that look sideways or down.
_BOUNCE = np.float32(0.7)


class _Paint:
    """The paint of N points, filled in material by material."""

    def __init__(self, count: int) -> None:
        self.albedo, self.glow = np.zeros((2, 3, count), np.float32)
        self.mirror, self.waves = np.zeros((2, count), np.float32)
        self.lamp_reach = np.ones(count, np.float32)


class Shader:
    """Colours of the surfaces of one world, given normals (3, T) of its mesh's triangles."""

    def __init__(self, world: World, normal: Floats) -> None:
        self._side = world.region.side_m
        seen = world.water & (world.top_albedo == world.ground_albedo).all(axis=-1)
        self._ground, self._top = (
            Texture(np.dstack([albedo, water * np.uint8(255)]), self._side)
            for albedo, water in ((world.ground_albedo, world.water), (world.top_albedo, seen))
        )
        self._around = surroundings(world)
        self._facades = Facades(world.mesh, normal, world.buildings)
        self._leaves = (world.tree_colours / 255.0).astype(np.float32)

    def colour(self, points: Points, lit: Singles, given: Conditions) -> Singles:
        """Return what a camera sees of points, (3, N), `lit` (N,) by the sun."""
        paint = _Paint(len(points.distance))
        self._paint_land(paint, points, self._ground, Material.GROUND)
        self._paint_land(paint, points, self._top, Material.ROOF, Material.APRON)
        self._paint_upright(paint, points)
        if given.snow > 0.0:
            _lay_snow(paint, points, given.snow)
        if given.wet > 0.0:
            _make_wet(paint, points, given.wet)
        colour = paint.albedo * self._light(points, paint, lit, given)
        _mirror_sky(colour, paint, points, given)
        if given.lamps > 0.0:
            colour += paint.glow * np.float32(given.lamps)
        return haze(colour, points.distance, points.view, given)

    def far_land(
        self, view: Singles, origin: Floats, level_m: float, given: Conditions
    ) -> tuple[Singles, Singles]:
        """Return the land beyond the mesh: the region, mirrored on without end at one level."""
        distance = np.float32(max(origin[2] - level_m, 1.0)) / np.maximum(-view[2], 1e-4)
        x, y = (np.float32(origin[k]) + distance * view[k] for k in (0, 1))
        coarse = np.full(len(x), self._side / 40.0, np.float32)
        albedo = self._top.sample(x, y, coarse, np.full(len(x), 0.5, np.float32))[:3]
        if given.snow > 0.0:
            albedo += (column(_SNOW) - albedo) * np.float32(0.75 * given.snow)
        return albedo, distance

    def _paint_land(self, paint: _Paint, points: Points, texture: Texture, *materials: int) -> None:
        which, some = points.made_of(*materials)
        # A pixel that grazes the land covers a long strip of it. Its colour is filtered to the mean
        # of the strip's sides, up to this: a little too sharp along, a little too soft across.
        slant = np.sqrt(np.maximum(some.facing(), np.float32(1.0 / _MOST_SLANT)))
        footprint = np.divide(some.footprint, slant, dtype=np.float32)
        lanes = texture.sample(some.xyz[0], some.xyz[1], footprint, some.dither)
        grain = volume_noise(some.xyz, 0.07, footprint) * np.float32(0.035)
        grain += volume_noise(some.xyz, 0.41, footprint) * np.float32(0.025)
        lanes[:3] *= 1.0 + grain * (1.0 - lanes[3])
        paint.albedo[:, which] = lanes[:3]
        paint.mirror[which] = paint.waves[which] = lanes[3]
        paint.lamp_reach[which] = np.where(some.material == Material.ROOF, _ON_ROOFS, 1.0)

    def _paint_upright(self, paint: _Paint, points: Points) -> None:
        """Paint walls, leaves and trunks."""
        which, some = points.made_of(Material.WALL)
        look = self._facades.look(some)
        paint.albedo[:, which], paint.mirror[which], paint.glow[:, which], height = look
        paint.lamp_reach[which] = np.exp(height * np.float32(-1.0 / 6.0))
        which, some = points.made_of(Material.CANOPY)
        clumps, leaves = (volume_noise(some.xyz, size, some.footprint) for size in (0.33, 0.11))
        light = 0.94 + 0.16 * clumps + 0.14 * leaves + 0.10 * some.normal[2]
        albedo = self._leaves.take(some.owner, axis=0).T * np.maximum(light, 0.25)
        albedo[0] *= 1.0 + 0.05 * clumps
        paint.albedo[:, which] = albedo
        paint.lamp_reach[which] = np.float32(0.35)
        paint.albedo[:, points.material == Material.TRUNK] = column(_TRUNK)

    def _light(self, points: Points, paint: _Paint, lit: Singles, given: Conditions) -> Singles:
        ambient = _BOUNCE + (1 - _BOUNCE) * points.normal[2]
        if given.shade > 0.2 or given.lamps > 0.0:
            out = np.float32(1.0) - np.abs(points.normal[2])
            x, y = (points.xyz[k] + points.normal[k] * out for k in (0, 1))
            fine = np.maximum(points.footprint, np.float32(0.5))
            around = self._around.sample(x, y, fine, points.dither)
            ambient *= 1.0 - np.float32(given.shade) * (1.0 - around[0])
            lamps = around[1] * paint.lamp_reach * np.float32(given.lamps)
        light: Singles = column(given.light.sky) * ambient
        if given.direct:
            through = np.float32(_THROUGH_LEAVES) * (points.material == Material.CANOPY)
            light += column(given.light.sun) * (lit + through)
        if given.lamps > 0.0:
            light += column(_LAMP) * lamps
        return light


def _lay_snow(paint: _Paint, points: Points, snow: float) -> None:
    patches = volume_noise(points.xyz, 0.6, points.footprint)
    fine = volume_noise(points.xyz, 0.15, points.footprint)
    steep = np.clip((points.normal[2] - np.float32(0.25)) * np.float32(2.2), 0.0, 1.0)
    # Cars and brooms clear pavements: grey, and not bright.
    spread = paint.albedo.max(axis=0) - paint.albedo.min(axis=0)
    paved = np.clip(1.4 - spread * 12.0, 0.0, 1.0) * (points.material == Material.GROUND)
    leafy = (points.material == Material.CANOPY) * np.float32(0.35)
    cover = np.float32(0.82) + 0.10 * patches + 0.08 * fine - 0.5 * paved - leafy
    cover = np.clip(cover, 0.0, 0.92) * steep * (1.0 - paint.waves) * np.float32(snow)
    white = column(_SNOW) * (1.0 + np.float32(0.03) * patches)
    paint.albedo += (white - paint.albedo) * cover
    paint.mirror *= 1.0 - cover


def _make_wet(paint: _Paint, points: Points, wet: float) -> None:
    flat = np.clip((points.normal[2] - np.float32(0.3)) * 2.0, 0.0, 1.0) * np.float32(wet)
    land = (points.material == Material.GROUND) | (points.material == Material.APRON)
    dips = volume_noise(points.xyz, 0.9, points.footprint)
    puddles = np.clip(dips - np.float32(0.8), 0.0, 1.0) * land
    paint.albedo *= 1.0 - np.float32(0.22) * flat * (1.0 - paint.waves)
    soaked = (np.float32(0.25) + puddles) * flat * (points.material != Material.CANOPY)
    np.maximum(paint.mirror, soaked, out=paint.mirror)


def _mirror_sky(colour: Singles, paint: _Paint, points: Points, given: Conditions) -> None:
    which = np.flatnonzero(paint.mirror > 0.02)
    view, normal = points.view[:, which], points.normal[:, which]
    (x, y, _), footprint = points.xyz[:, which], points.footprint[which]
    flat, waves = np.zeros_like(x), paint.waves[which]
    normal[0] += np.float32(0.02) * waves * volume_noise((x, y, flat), 0.3, footprint)
    normal[1] += np.float32(0.02) * waves * volume_noise((y, x, flat + 3.0), 0.3, footprint)
    facing = -(view * normal).sum(axis=0)
    away = view + 2.0 * facing * normal
    slant = 1.0 - np.clip(facing, 0.0, 1.0)
    square = slant * slant
    share = _BASE_REFLECTANCE + (1 - _BASE_REFLECTANCE) * square * square * slant
    share *= paint.mirror[which]
    seen = sky_colour(away, given)
    seen *= np.clip(1.0 + 2.0 * away[2], 0.3, 1.0)
    colour[:, which] += (seen - colour[:, which]) * share
