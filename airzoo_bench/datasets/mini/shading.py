"""The colour of surfaces: their paint, the light on them, and what they mirror."""

from __future__ import annotations

from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.datasets.mini.noise import (
    Singles,
    floor_log2,
    hash_of,
    octaves,
    uniforms,
    volume_noise,
)
from airzoo_bench.datasets.mini.weather import Conditions, column, haze, sky_colour, towards_sun
from airzoo_bench.datasets.mini.world import Material, World
from airzoo_bench.geometry.arrays import Floats

_Indices = NDArray[np.int64]
F = TypeVar("F", np.float32, np.float64)

_LEAST_SIDE = 20  # of the coarsest image of a texture
_STEPS_M = (1.5, 4.0, 9.0, 20.0)  # where the horizon is looked for, in each direction
_AROUND = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
_LAMP_CELL_M, _LAMP_REACH_M = 18.0, 30.0
_LAMP_STREAM, _WINDOW_STREAM, _CLOUD_STREAM = 71, 72, 73
_CLOUDS_M = 20.0  # side of the picture of clouds, 1 m overhead
_DISC_COSINE = np.float32(0.99985)
# left, right, bottom, top of a window as shares of its bay and storey, by style: single windows,
# bands, doors to balconies, none, none; and of a shop.
_WINDOWS = np.array(
    [
        *((0.24, 0.76, 0.30, 0.82), (0.04, 0.96, 0.34, 0.84), (0.16, 0.84, 0.04, 0.80)),
        *((0.0,) * 4, (0.0,) * 4),
    ],
    np.float32,
)
_SHOP = np.array([0.06, 0.94, 0.06, 0.72], np.float32)[:, None]
_BALCONY, _BARN = 2, 3
_PLINTH_M, _HALF_DOOR_M, _DOOR_M = 0.7, 2.0, 3.4
_LIT_SHARE = np.float32(0.30)

_MOST_SLANT = 4.0
_LAMP, _TRUNK, _SNOW = (1.0, 0.74, 0.42), (0.30, 0.24, 0.18), (0.86, 0.88, 0.93)
# Share of the lamps' light that reaches surfaces, by material; walls by their height.
_LAMP_SHARES = np.array([1.0, 0.04, 1.0, 0.35, 1.0, 1.0], np.float32)
# Sunlight that leaves let through to their shadow side.
_THROUGH_LEAVES = 0.13
_BASE_REFLECTANCE = np.float32(0.04)
# Light that the ground throws back at surfaces that look sideways or down.
_BOUNCE = np.float32(0.7)


class Points(NamedTuple):
    """N points where rays of one camera meet surfaces."""

    xyz: Singles  # (3, N): metres of the world's local frame
    normal: Singles  # (3, N): unit, on the side that is seen
    view: Singles  # (3, N): unit direction from the camera
    distance: Singles  # (N,): metres from the camera
    footprint: Singles  # (N,): size of the pixel across the ray, metres
    dither: Singles  # (N,): in [0, 1), another one for each pixel
    material: NDArray[np.uint8]  # (N,)
    owner: NDArray[np.int32]  # (N,)

    def made_of(self, *materials: int) -> tuple[_Indices, Points]:
        """Return the points of some materials, after their numbers."""
        which = np.flatnonzero(np.isin(self.material, materials))
        parts: list[Any] = [values.take(which, axis=-1) for values in self]
        return which, Points(*parts)

    def facing(self) -> Singles:
        """Return the cosine of the angle between surface and line of sight, (N,)."""
        return -dot(self.view, self.normal)


def dot(a: NDArray[F], b: NDArray[F]) -> NDArray[F]:
    """Return products of vectors (3, N) summed in a fixed order, as a BLAS kernel would not."""
    product: NDArray[F] = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


class Texture:
    """Square images (n, n, 4) of one place and their halvings, the first row in the north."""

    def __init__(self, side_m: float, *images: NDArray[np.uint8]) -> None:
        levels = [np.stack(images)]
        while levels[-1].shape[1] > _LEAST_SIDE:
            odd = levels[-1].shape[1] % 2
            even = np.pad(levels[-1], ((0, 0), (0, odd), (0, odd), (0, 0)), mode="edge")
            rows = (even[:, 0::2].astype(np.uint16) + even[:, 1::2]) >> 1
            levels.append(((rows[:, :, 0::2] + rows[:, :, 1::2]) >> 1).astype(np.uint8))
        self._side_m, self._gsd_m = np.float32(side_m), side_m / len(images[0])
        self._sizes = np.array([level.shape[1] for level in levels], np.int64)
        self._starts = len(images) * (np.cumsum(self._sizes**2) - self._sizes**2)
        self._texels = np.concatenate([level.reshape(-1, 4) for level in levels])

    def sample(self, xy: Any, size_m: Singles, dither: Singles, image: Any = 0) -> Singles:
        """Return the colour (4, N), in 0 to 1, at points of the square, mirrored beyond it."""
        level = floor_log2(size_m * (1.0 + dither) * np.float32(1.0 / self._gsd_m))
        size = self._sizes.take(level, mode="clip")
        scale = size.astype(np.float32)
        shares, cells = [], []
        for at in (1.0 - xy[1] / self._side_m, xy[0] / self._side_m):
            folded = 1.0 - np.abs(at - 2.0 * np.floor(at * np.float32(0.5)) - 1.0)
            place = np.clip(folded * scale - np.float32(0.5), 0.0, scale - np.float32(1.01))
            cells.append(place.astype(np.int64))
            shares.append(place - cells[-1].astype(np.float32))
        first = self._starts.take(level, mode="clip") + (image * size + cells[0]) * size + cells[1]
        total = np.zeros((len(first), 4), np.float32)
        for down, share_y in ((0, 1.0 - shares[0]), (size, shares[0])):
            for right, share_x in ((0, 1.0 - shares[1]), (1, shares[1])):
                weight = (share_x * share_y * np.float32(1 / 255))[:, None]
                total += self._texels.take(first + down + right, axis=0) * weight
        return np.ascontiguousarray(total.T)


def surroundings(world: World) -> Texture:
    """Return a texture: the first lane is the share of sky seen, the second the lamps' light."""
    gsd = world.region.side_m / len(world.dsm)
    lanes = np.zeros((*world.dsm.shape, 4), np.uint8)
    lanes[..., 0] = np.rint(255.0 * _openness(world.dsm, gsd))
    lanes[..., 1] = np.rint(255.0 * np.clip(_lamp_light(world, gsd), 0.0, 1.0))
    return Texture(world.region.side_m, lanes)


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
    """Return pools of light about the places of a jittered grid that are paved: grey, and bare."""
    step = len(world.ground) // len(world.dsm)
    ground, top = (part[::step, ::step].astype(np.int16) for part in (world.ground, world.top))
    bright = ground[..., :3].max(axis=-1)
    paved = (bright - ground[..., :3].min(axis=-1) < 16) & (bright > 60) & (bright < 190)
    paved &= (top == ground).all(axis=-1) & (ground[..., 3] == 0)
    count = round(world.region.side_m / _LAMP_CELL_M)
    number = hash_of(_LAMP_STREAM, np.arange(count)[:, None], np.arange(count))
    cell = np.mgrid[:count, :count] + np.stack([uniforms(number, lane) for lane in (0, 1)])
    places = (cell * (len(paved) / count)).astype(np.int64).reshape(2, -1)
    reach = round(_LAMP_REACH_M / gsd)
    offsets = np.arange(-reach, reach + 1) * gsd
    square = offsets[:, None] ** 2 + offsets[None] ** 2
    pool = (0.75 * np.exp(-square / 7.0**2) + 0.25 * np.exp(-square / 14.0**2)).astype(np.float32)
    light = np.pad(np.zeros(world.dsm.shape, np.float32), reach)
    for south, east in places[:, paved[*places]].T.tolist():
        light[south : south + len(pool), east : east + len(pool)] += pool
    return light[reach:-reach, reach:-reach]


class _Paint:
    """The paint of N points, filled in material by material."""

    def __init__(self, points: Points) -> None:
        count = len(points.distance)
        self.albedo, self.glow = np.zeros((2, 3, count), np.float32)
        self.mirror, self.waves = np.zeros((2, count), np.float32)
        self.lamp_reach = _LAMP_SHARES.take(points.material)


class Shader:
    """Colours of the surfaces of one world."""

    def __init__(self, world: World) -> None:
        self._side = world.region.side_m
        self._land = Texture(self._side, world.ground, world.top)
        self._around = surroundings(world)
        self._walls = world.walls
        self._leaves = (world.leaves / 255.0).astype(np.float32)
        billow = octaves(0, _CLOUD_STREAM, 1024, {24: 7, 8: 5, 3: 4}) // 16 + 128
        self._clouds = Texture(_CLOUDS_M, np.repeat(billow[..., None], 4, 2).astype(np.uint8))

    def sky(self, view: Singles, given: Conditions) -> Singles:
        """Return the sky as the camera sees it in unit directions (3, N)."""
        colour = sky_colour(view, given)
        lit = column(given.horizon) * np.float32(1.04) + column(given.light.sun) * np.float32(0.05)
        far = np.float32(1.0) / (np.maximum(view[2], 0.0) + np.float32(0.14))
        fine = np.zeros_like(far) + np.float32(0.01)
        xy = view[:2] * far + np.float32(_CLOUDS_M / 2)
        thick = self._clouds.sample(xy, fine, fine)[0]
        thick = np.clip((thick - np.float32(0.42)) * 4.0, 0.0, 1.0)
        thick *= np.clip(view[2] * 30.0, 0.0, 1.0) * np.float32(given.clouds)
        colour += (lit - colour) * thick
        if given.direct:
            colour += (towards_sun(view, given) > _DISC_COSINE) * np.float32(1.0)
        return colour

    def colour(self, points: Points, lit: Singles, given: Conditions) -> Singles:
        """Return what a camera sees of points, (3, N), `lit` (N,) by the sun."""
        paint = _Paint(points)
        self._paint_land(paint, points)
        self._paint_leaves(paint, points)
        which, some = points.made_of(Material.WALL)
        if which.size:
            self._paint_walls(paint, which, some)
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
        xy = [np.float32(origin[k]) + distance * view[k] for k in (0, 1)]
        coarse = np.full(len(distance), self._side / 40.0, np.float32)
        albedo = self._land.sample(xy, coarse, np.full_like(coarse, 0.5), 1)[:3]
        if given.snow > 0.0:
            albedo += (column(_SNOW) - albedo) * np.float32(0.75 * given.snow)
        return albedo, distance

    def _paint_land(self, paint: _Paint, points: Points) -> None:
        which, some = points.made_of(Material.GROUND, Material.ROOF, Material.APRON)
        # A pixel that grazes the land covers a long strip of it. Its colour is filtered to the mean
        # of the strip's sides, up to this: a little too sharp along, a little too soft across.
        slant = np.sqrt(np.maximum(some.facing(), np.float32(1.0 / _MOST_SLANT)))
        footprint = np.divide(some.footprint, slant, dtype=np.float32)
        image = (some.material != Material.GROUND).astype(np.int64)
        lanes = self._land.sample(some.xyz, footprint, some.dither, image)
        grain = volume_noise(some.xyz, 0.11, footprint) * np.float32(0.045)
        lanes[:3] *= 1.0 + grain * (1.0 - lanes[3])
        paint.albedo[:, which] = lanes[:3]
        paint.mirror[which] = paint.waves[which] = lanes[3]

    def _paint_leaves(self, paint: _Paint, points: Points) -> None:
        which, some = points.made_of(Material.CANOPY)
        clumps, leaves = (volume_noise(some.xyz, size, some.footprint) for size in (0.33, 0.11))
        light = 0.94 + 0.16 * clumps + 0.14 * leaves + 0.10 * some.normal[2]
        albedo = self._leaves.take(some.owner, axis=0).T * np.maximum(light, 0.25)
        albedo[0] *= 1.0 + 0.05 * clumps
        paint.albedo[:, which] = albedo
        paint.albedo[:, points.material == Material.TRUNK] = column(_TRUNK)

    def _paint_walls(self, paint: _Paint, which: _Indices, points: Points) -> None:
        """Paint storeys, bays, windows, balconies and doors, filtered to the pixel's size."""
        x0, y0, cosine, sine, half_u, half_v, base, storey_m, bay_m, style = (
            self._walls.T[:10].take(points.owner, axis=1)
        )  # fmt: skip
        x, y, height = points.xyz[0] - x0, points.xyz[1] - y0, points.xyz[2] - base
        # A wall runs along u or v of its building, on either side.
        out_u = points.normal[0] * cosine + points.normal[1] * sine
        out_v = points.normal[1] * cosine - points.normal[0] * sine
        ends = np.abs(out_u) > np.abs(out_v)
        half = np.where(ends, half_v, half_u)
        u = np.where(ends, y * cosine - x * sine, x * cosine + y * sine) + half
        side = 2 * ends + (np.where(ends, out_u, out_v) > 0)
        width = 2 * half / np.maximum(np.floor(2 * half / bay_m), 1.0)
        (column_, across), (storey, up) = (
            np.divmod(at, np.float32(1)) for at in (u / width, height / storey_m)
        )
        slant = points.footprint / np.maximum(points.facing(), np.float32(0.2))
        fuzz_u, fuzz_v = slant / width, points.footprint / storey_m
        # The same for all pixels of a window.
        cell = (points.owner * 4 + side).astype(np.int64), column_.astype(np.int64)
        number = hash_of(
            _WINDOW_STREAM, (cell[0] << 20) + (cell[1] << 10) + storey.astype(np.int64)
        )
        lit, shade, curtain, shop = (uniforms(number, lane) for lane in range(4))
        street = (storey == 0) & (style < _BALCONY) & (shop < 0.6)
        frame = np.where(street, _SHOP, _WINDOWS.T.take(style.astype(np.int64), axis=1))
        glass = _covered(across, frame[0], frame[1], fuzz_u) * _covered(
            up, frame[2], frame[3], fuzz_v
        )
        glass[storey < 0] = 0.0
        fuzzy = np.maximum(slant, np.float32(0.02))
        door = np.clip((_HALF_DOOR_M - np.abs(u - half)) / fuzzy + 0.5, 0.0, 1.0)
        door *= np.clip((_DOOR_M - height) / fuzzy + 0.5, 0.0, 1.0) * (style == _BARN)
        stain = volume_noise(
            (points.xyz[0], points.xyz[1], points.xyz[2] * 0.15), 0.5, points.footprint
        )
        light = 1.0 + np.float32(0.045) * stain
        light -= np.float32(0.16) * _covered(up, 0.0, 0.045, fuzz_v)
        railing = _covered(up, 0.0, 0.34, fuzz_v) * _covered(across, 0.08, 0.92, fuzz_u)
        light += np.float32(0.14) * railing * (style == _BALCONY)
        light *= 1.0 - np.float32(0.22) * (height < _PLINTH_M)
        albedo, pane = self._walls.T[10:].take(points.owner, axis=1).reshape(2, 3, -1)
        albedo = albedo * light
        albedo += (np.float32(0.16) - albedo) * (door * np.float32(0.9))
        dim = np.float32(0.6) * shade
        pane = pane * (np.float32(0.65) + dim)
        pane += (np.float32(0.75) - pane) * ((curtain < 0.22) * np.float32(0.35))
        paint.albedo[:, which] = albedo + (pane - albedo) * glass
        paint.mirror[which] = glass
        strength = (lit < _LIT_SHARE) * (np.float32(0.45) + dim) * glass
        warm = (np.ones_like(curtain), 0.74 + 0.2 * curtain, 0.40 + 0.5 * curtain)
        paint.glow[:, which] = np.stack(warm) * strength
        paint.lamp_reach[which] = np.exp(height * np.float32(-1.0 / 6.0))

    def _light(self, points: Points, paint: _Paint, lit: Singles, given: Conditions) -> Singles:
        ambient = _BOUNCE + (1 - _BOUNCE) * points.normal[2]
        lamps: Singles | float = 0.0
        if given.shade > 0.2 or given.lamps > 0.0:
            out = np.float32(1.0) - np.abs(points.normal[2])
            xy = points.xyz[:2] + points.normal[:2] * out
            fine = np.maximum(points.footprint, np.float32(0.5))
            around = self._around.sample(xy, fine, points.dither)
            ambient *= 1.0 - np.float32(given.shade) * (1.0 - around[0])
            lamps = around[1] * paint.lamp_reach * np.float32(given.lamps)
        light: Singles = column(given.light.sky) * ambient
        if given.direct:
            through = np.float32(_THROUGH_LEAVES) * (points.material == Material.CANOPY)
            light += column(given.light.sun) * (lit + through)
        if given.lamps > 0.0:
            light += column(_LAMP) * lamps
        return light


def _covered(place: Singles, low: Singles | float, high: Singles | float, size: Singles) -> Singles:
    """Share of a pixel of `size` at `place` that lies between `low` and `high` of a cell of 1."""
    half = np.clip(size, 0.02, 1.0) * np.float32(0.5)
    inside = np.minimum(place + half, high) - np.maximum(place - half, low)
    sharp = np.clip(inside / (2 * half), 0.0, 1.0)
    # A pixel of a cell or more sees the mean of all cells.
    coarse = np.clip(size * 2.0 - 0.8, 0.0, 1.0)
    share: Singles = sharp + (np.subtract(high, low, dtype=np.float32) - sharp) * coarse
    return share


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
    ripple = volume_noise(points.xyz[:, which], 0.3, points.footprint[which])
    normal[:2] += np.float32(0.02) * paint.waves[which] * ripple
    facing = -dot(view, normal)
    away = view + 2.0 * facing * normal
    slant = 1.0 - np.clip(facing, 0.0, 1.0)
    square = slant * slant
    share = _BASE_REFLECTANCE + (1 - _BASE_REFLECTANCE) * square * square * slant
    share *= paint.mirror[which]
    seen = sky_colour(away, given)
    seen *= np.clip(1.0 + 2.0 * away[2], 0.3, 1.0)
    colour[:, which] += (seen - colour[:, which]) * share
