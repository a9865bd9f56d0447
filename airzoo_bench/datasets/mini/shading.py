"""Weather and time of day, and the colour of surfaces in them.

Conditions are the light, the sky and the air of a photo; they never change geometry. A surface has
paint, the light on it, and what it mirrors. Colours are display values, 1.0 being the white of the
image, as the survey's light is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.datasets.mini import noise
from airzoo_bench.datasets.mini.layout import LOOKS
from airzoo_bench.datasets.mini.noise import Singles, hash_of, uniforms, volume_noise
from airzoo_bench.datasets.mini.world import SURVEY_SUN, Light, Material, World
from airzoo_bench.geometry.arrays import Floats

Spans = dict[str, slice]
Colour = Sequence[float] | Floats
WEATHERS, TIMES = ("sunny", *LOOKS["weathers"]), tuple(LOOKS["skies"])

_LEAST_SIDE = 20  # of the coarsest image of a texture
_STEPS_M = (1.5, 4.0, 9.0, 20.0)  # where the horizon is looked for, in each direction
_AROUND = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
_LAMP_CELL_M, _LAMP_REACH_M = 18.0, 30.0
_LAMP_STREAM, _WINDOW_STREAM, _CLOUD_STREAM = 71, 72, 73
_CLOUDS_M = 20.0  # side of the picture of clouds, 1 m overhead
_DISC_COSINE = np.float32(0.99985)
_WINDOWS, _SHOP = (np.array(LOOKS["windows"][name], np.float32) for name in ("styles", "shop"))
_BALCONY, _BARN = 2, 3
_PLINTH_M, _HALF_DOOR_M, _DOOR_M = 0.7, 2.0, 3.4
_LIT_SHARE = np.float32(0.30)

_MOST_SLANT = 4.0
_LAMP, _TRUNK, _SNOW = (1.0, 0.74, 0.42), (0.30, 0.24, 0.18), (0.86, 0.88, 0.93)
_LAMPS_ON_ROOFS, _LAMPS_ON_LEAVES = np.float32(0.04), np.float32(0.35)  # share of their light
# Sunlight that leaves let through to their shadow side.
_THROUGH_LEAVES = 0.13
_BASE_REFLECTANCE = np.float32(0.04)
# Light that the ground throws back at surfaces that look sideways or down.
_BOUNCE = np.float32(0.7)


@dataclass(frozen=True, eq=False)
class Conditions:
    """Light, sky and air that a photo is taken in."""

    light: Light  # sun (or moon) and sky
    zenith: Colour  # the sky straight up
    horizon: Colour  # the sky at the horizon, which haze takes on
    glow: Colour  # added to the sky around the sun
    clouds: float  # how much of the sky has visible clouds, 0 to 1
    # extinction: after d metres exp(-d * haze_per_m) of a surface's light is left
    haze_per_m: float
    # how much less skylight narrow places get, 0 to 1: little in the sun, as in the orthophoto
    shade: float
    noise: float  # standard deviation of the sensor's noise at mid-grey, in levels of 255
    direct: bool = True  # whether anything casts a shadow
    lamps: float = 0.0  # strength of street lamps and lit windows
    wet: float = 0.0  # how wet surfaces are, 0 to 1
    snow: float = 0.0  # how much snow lies, 0 to 1
    falling: str = ""  # "rain" or "snow" in the air


def conditions(weather: str, time: str) -> Conditions:
    """Return the conditions of a weather, one of `WEATHERS`, and a time of day, one of `TIMES`."""
    clear: dict[str, Any] = dict(LOOKS["skies"][time])
    light = Light(*map(tuple, clear.pop("light"))) if "light" in clear else SURVEY_SUN
    if weather == "sunny":
        return Conditions(light=light, **clear)
    grey: dict[str, Any] = dict(LOOKS["weathers"][weather])
    bright, tint, noisier = (grey.pop(name) for name in ("bright", "tint", "noisier"))
    soft = bright * (light.sky + 0.8 * np.array(light.sun) * max(light.direction[2], 0.3))
    horizon = _greyed(clear["horizon"], 0.5) * [part * min(bright, 1.0) for part in tint]
    black = (0.0, 0.0, 0.0)
    return Conditions(
        light=Light(light.direction, black, tuple(_greyed(soft, 0.35) * tint)),
        zenith=horizon * (0.86, 0.88, 0.92),
        horizon=horizon,
        glow=black,
        clouds=0.4,
        shade=0.85,
        noise=clear["noise"] * noisier,
        direct=False,
        lamps=max(clear["lamps"], 0.3) if "lamps" in clear else 0.0,
        **grey,
    )


def _greyed(colour: Colour, share: float) -> Floats:
    grey = 0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2]
    return np.asarray(grey + share * (np.asarray(colour) - grey))


def column(colour: Colour) -> Singles:
    """Return a colour as (3, 1) float32, to go with planes of (3, N)."""
    return np.array(colour, np.float32)[:, None]


def _towards_sun(directions: Singles, given: Conditions) -> Singles:
    """Return the cosine of the angle between unit directions (3, N) and the sun, at least 0."""
    sun = np.array(given.light.direction, np.float32)
    return np.asarray(np.clip(dot(directions, sun), 0, 1))


def _sky_colour(directions: Singles, given: Conditions) -> Singles:
    """Return the clear sky in unit directions (3, N); below the horizon as at the horizon."""
    share = np.sqrt(np.clip(directions[2], 0.0, 1.0))
    horizon = column(given.horizon)
    colour: Singles = horizon + (column(given.zenith) - horizon) * share
    if max(given.glow) > 0.0:
        near = _towards_sun(directions, given)
        near = near * near
        near = near * near
        colour += column(given.glow) * (near * near)
    return colour


def _haze(colour: Singles, distance: Singles, view: Singles, given: Conditions) -> Singles:
    """Turn colours (3, N) into those seen from metres (N,) off in unit directions (3, N)."""
    left = np.exp(distance * np.float32(-given.haze_per_m))
    air = column(given.horizon)
    if max(given.glow) > 0.0:
        near = _towards_sun(view, given)
        air = air + column(given.glow) * (np.float32(0.5) * near * near)
    colour -= air
    colour *= left
    colour += air
    return colour


# The order of points by their material, so that each, and all land, is one slice.
RANKS = {
    **{"ground": Material.GROUND, "apron": Material.APRON, "roofs": Material.ROOF},
    **{"trunks": Material.TRUNK, "leaves": Material.CANOPY, "walls": Material.WALL},
}


def spans_of(counts: Sequence[int]) -> Spans:
    """Return the slices of points of each rank, and of all land, from their counts."""
    ends = np.cumsum(counts).tolist()
    spans = {name: slice(*at) for name, at in zip(RANKS, pairwise((0, *ends)), strict=False)}
    return spans | {"country": slice(ends[1]), "land": slice(ends[2])}


class Points(NamedTuple):
    """N points where rays of one camera meet surfaces."""

    xyz: Singles  # (3, N): metres of the world's local frame
    normal: Singles  # (3, N): unit, on the side that is seen
    view: Singles  # (3, N): unit direction from the camera
    distance: Singles  # (N,): metres from the camera
    dither: Singles  # (N,): in [0, 1), another one for each pixel
    sun: Singles  # (N,): cosine of the angle between normal and sun, 0 in shadow
    footprint: Singles  # (N,): size of the pixel across the ray, metres
    owner: NDArray[np.int32]  # (N,)

    def part(self, which: slice) -> Points:
        """Return some of the points."""
        parts: list[Any] = [values[..., which] for values in self]
        return Points(*parts)

    def facing(self) -> Singles:
        """Return the cosine of the angle between surface and line of sight, (N,)."""
        return np.asarray(-dot(self.view, self.normal))


def dot(a: Any, b: Any) -> Any:
    """Return products of vectors (3, N) summed in a fixed order, as a BLAS kernel would not."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


class _Texture:
    """A square image (n, n, 1 to 4), mirrored beyond its sides, and its halvings; north is up."""

    def __init__(self, side_m: float, image: NDArray[np.uint8]) -> None:
        levels = [image]
        while len(levels[-1]) > _LEAST_SIDE:
            odd = len(levels[-1]) % 2
            even = np.pad(levels[-1], ((0, odd), (0, odd), (0, 0)), mode="edge")
            rows = (even[0::2].astype(np.uint16) + even[1::2]) >> 1
            levels.append(((rows[:, 0::2] + rows[:, 1::2]) >> 1).astype(np.uint8))
        self._twice_m = np.float32(2 * side_m)
        self._per_m = np.float32(1.0 / (side_m / len(image)))
        # By level: size, and first texel.
        self._sizes = np.array([len(level) for level in levels], np.int32)
        self._starts = np.cumsum(self._sizes**2, dtype=np.int32) - self._sizes**2
        self._texels = np.concatenate([one.view(f"u{one.shape[2]}").ravel() for one in levels])

    def add_to(self, lanes: Singles, xy: Singles, size_m: Singles, dither: Singles) -> Singles:
        """Add the first lanes of the colour, 0 to 1, at points of the square to lanes (L, N)."""
        level = noise.floor_log2(size_m * (1.0 + dither) * self._per_m)
        np.minimum(np.maximum(level, 0, out=level), len(self._sizes) - 1, out=level)
        size = self._sizes.take(level)
        wide = size.astype(np.float32)
        # Halves of the side, so that 0 and 1 are a mirror image apart from their middle.
        place = np.stack([0.5 - xy[1] / self._twice_m, xy[0] / self._twice_m])
        place -= np.floor(place)
        place -= 0.5
        np.subtract(0.5, np.abs(place, out=place), out=place)
        place *= wide * 2
        place -= 0.5
        np.clip(place, 0.0, wide - np.float32(1.01), out=place)
        cell = place.astype(np.int32)
        place -= cell.astype(np.float32)
        first = self._starts.take(level) + cell[0] * size + cell[1]
        part = np.empty(lanes.shape, np.float32)
        for row, share_y in ((first, 1.0 - place[0]), (first + size, place[0])):
            texel = row.astype(np.int64)
            for right, share_x in ((0, 1.0 - place[1]), (1, place[1])):
                colour = self._texels[right:].take(texel).view(np.uint8)
                part[:] = colour.reshape(-1, self._texels.itemsize).T[: len(lanes)]
                part *= share_x * share_y * np.float32(1 / 255)
                lanes += part
        return lanes


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


class Shader:
    """Colours of the surfaces of one world."""

    def __init__(self, world: World) -> None:
        self._side, dsm = world.region.side_m, world.dsm
        border = np.concatenate([dsm[0], dsm[-1], dsm[:, 0], dsm[:, -1]])
        self._far_level_m = float(np.median(border))
        self._ground, self._top = (_Texture(self._side, m) for m in (world.ground, world.top))
        gsd, around = self._side / len(dsm), np.zeros((*dsm.shape, 2), np.uint8)
        around[..., 0] = np.rint(255.0 * _openness(dsm, gsd))
        around[..., 1] = np.rint(255.0 * np.clip(_lamp_light(world, gsd), 0.0, 1.0))
        self._around = _Texture(self._side, around)
        self._walls = world.walls
        self._leaves = (world.leaves / 255.0).astype(np.float32)
        billow = noise.octaves(0, _CLOUD_STREAM, 1024, {24: 7, 8: 5, 3: 4}) // 16 + 128
        self._clouds = _Texture(_CLOUDS_M, billow[..., None].astype(np.uint8))

    def horizon(self, view: Singles, origin: Floats, given: Conditions) -> Singles:
        """Return what is seen in unit directions (3, N) past the mesh: sky, and land at one level.

        The land is the region, mirrored on without end.
        """
        colour = np.empty_like(view)
        above, below = np.flatnonzero(view[2] >= 0.0), np.flatnonzero(view[2] < 0.0)
        colour[:, above] = self._sky(view[:, above], given)
        down = view[:, below]
        distance = np.float32(max(origin[2] - self._far_level_m, 1.0)) / np.maximum(-down[2], 1e-4)
        xy = [np.float32(origin[k]) + distance * down[k] for k in (0, 1)]
        coarse = np.full(len(distance), self._side / 40.0, np.float32)
        land = np.zeros_like(down)
        self._top.add_to(land, np.stack(xy), coarse, np.full_like(coarse, 0.5))
        if given.snow > 0.0:
            land += (column(_SNOW) - land) * np.float32(0.75 * given.snow)
        sun = column(given.light.sun) * np.float32(given.light.direction[2])
        colour[:, below] = _haze(land * (column(given.light.sky) + sun), distance, down, given)
        return colour

    def _sky(self, view: Singles, given: Conditions) -> Singles:
        colour = _sky_colour(view, given)
        lit = column(given.horizon) * np.float32(1.04) + column(given.light.sun) * np.float32(0.05)
        far = np.float32(1.0) / (np.maximum(view[2], 0.0) + np.float32(0.14))
        fine = np.zeros_like(far) + np.float32(0.01)
        xy = view[:2] * far + np.float32(_CLOUDS_M / 2)
        thick = self._clouds.add_to(np.zeros_like(xy[:1]), xy, fine, fine)[0]
        thick = np.clip((thick - np.float32(0.42)) * 4.0, 0.0, 1.0)
        thick *= np.clip(view[2] * 30.0, 0.0, 1.0) * np.float32(given.clouds)
        colour += (lit - colour) * thick
        if given.direct:
            colour += (_towards_sun(view, given) > _DISC_COSINE) * np.float32(1.0)
        return colour

    def colour(self, points: Points, spans: Spans, given: Conditions) -> Singles:
        """Return what a camera sees of points, (3, N)."""
        # Albedo, how much is mirrored, and of that as water.
        paint = np.zeros((5, len(points.distance)), np.float32)
        land, leaves, walls = (spans[name] for name in ("land", "leaves", "walls"))
        self._paint_land(paint[:, land], points.part(land), spans["ground"].stop)
        paint[:3, leaves] = self._paint_leaves(points.part(leaves))
        paint[:3, spans["trunks"]] = column(_TRUNK)
        height, glow = self._paint_walls(paint[:4, walls], points.part(walls))
        if given.snow > 0.0:
            _lay_snow(paint, points, spans, given.snow)
        if given.wet > 0.0:
            _make_wet(paint, points, spans, given.wet)
        colour = self._light(points, height, spans, given)
        colour *= paint[:3]
        _mirror_sky(colour, paint[3:], points, given)
        if given.lamps > 0.0:
            colour[:, walls] += glow * np.float32(given.lamps)
        return _haze(colour, points.distance, points.view, given)

    def _paint_land(self, paint: Singles, land: Points, ground: int) -> None:
        # A pixel that grazes the land covers a long strip of it. Its colour is filtered to the mean
        # of the strip's sides, up to this: a little too sharp along, a little too soft across.
        slant = np.sqrt(np.maximum(land.facing(), np.float32(1.0 / _MOST_SLANT)))
        footprint: Singles = np.divide(land.footprint, slant, dtype=np.float32)
        for image, span in ((self._ground, slice(ground)), (self._top, slice(ground, None))):
            place = land.xyz[:, span], footprint[span], land.dither[span]
            image.add_to(paint[:4, span], *place)
        grain = volume_noise(land.xyz, 0.11, footprint) * np.float32(0.045)
        paint[:3] *= 1.0 + grain * (1.0 - paint[3])
        paint[4] = paint[3]

    def _paint_leaves(self, leaves: Points) -> Singles:
        large, small = (volume_noise(leaves.xyz, size, leaves.footprint) for size in (0.33, 0.11))
        light = 0.94 + 0.16 * large + 0.14 * small + 0.10 * leaves.normal[2]
        albedo: Singles = self._leaves.take(leaves.owner, axis=0).T * np.maximum(light, 0.25)
        albedo[0] *= 1.0 + 0.05 * large
        return albedo

    def _paint_walls(self, paint: Singles, points: Points) -> tuple[Singles, Singles]:
        """Paint storeys, bays, windows, balconies and doors, filtered to the pixel's size.

        Returns the height (N,) above the floor, and the light (3, N) of windows by lamps.
        """
        wall = self._walls.T.take(points.owner, axis=1)
        x0, y0, cosine, sine, half_u, half_v, base, storey_m, bay_m, style = wall[:10]
        x, y, height = points.xyz[0] - x0, points.xyz[1] - y0, points.xyz[2] - base
        # A wall runs along u or v of its building, on either side.
        out_u = points.normal[0] * cosine + points.normal[1] * sine
        out_v = points.normal[1] * cosine - points.normal[0] * sine
        ends = np.abs(out_u) > np.abs(out_v)
        half = np.where(ends, half_v, half_u)
        u = np.where(ends, y * cosine - x * sine, x * cosine + y * sine) + half
        side = 2 * ends + (np.where(ends, out_u, out_v) > 0)
        width = 2 * half / np.maximum(np.floor(2 * half / bay_m), 1.0)
        bay, storey = np.floor(across := u / width), np.floor(up := height / storey_m)
        across, up = across - bay, up - storey
        slant = points.footprint / np.maximum(points.facing(), np.float32(0.2))
        fuzz_u, fuzz_v = slant / width, points.footprint / storey_m
        # The same for all pixels of a window.
        row, place, level = (at.astype(np.int64) for at in (points.owner * 4 + side, bay, storey))
        number = hash_of(_WINDOW_STREAM, (row << 20) + (place << 10) + level)
        lit, shade, curtain, shop = (uniforms(number, lane) for lane in range(4))
        street = (storey == 0) & (style < _BALCONY) & (shop < 0.6)
        frame = np.where(street, _SHOP[:, None], _WINDOWS.T.take(style.astype(np.int64), axis=1))
        left, right, low, high = frame
        glass = _covered(across, left, right, fuzz_u) * _covered(up, low, high, fuzz_v)
        glass[storey < 0] = 0.0
        fuzzy = np.maximum(slant, np.float32(0.02))
        door = np.clip((_HALF_DOOR_M - np.abs(u - half)) / fuzzy + 0.5, 0.0, 1.0)
        door *= np.clip((_DOOR_M - height) / fuzzy + 0.5, 0.0, 1.0) * (style == _BARN)
        stain = volume_noise(points.xyz * column((1.0, 1.0, 0.15)), 0.5, points.footprint)
        light = 1.0 + np.float32(0.045) * stain
        light -= np.float32(0.16) * _covered(up, 0.0, 0.045, fuzz_v)
        railing = _covered(up, 0.0, 0.34, fuzz_v) * _covered(across, 0.08, 0.92, fuzz_u)
        light += np.float32(0.14) * railing * (style == _BALCONY)
        light *= 1.0 - np.float32(0.22) * (height < _PLINTH_M)
        albedo, pane = wall[10:].reshape(2, 3, -1)
        albedo = albedo * light
        albedo += (np.float32(0.16) - albedo) * (door * np.float32(0.9))
        dim = np.float32(0.6) * shade
        pane = pane * (np.float32(0.65) + dim)
        pane += (np.float32(0.75) - pane) * ((curtain < 0.22) * np.float32(0.35))
        paint[:3], paint[3] = albedo + (pane - albedo) * glass, glass
        strength = (lit < _LIT_SHARE) * (np.float32(0.45) + dim) * glass
        warm = (np.ones_like(curtain), 0.74 + 0.2 * curtain, 0.40 + 0.5 * curtain)
        return height, np.stack(warm) * strength

    def _light(self, points: Points, height: Singles, spans: Spans, given: Conditions) -> Singles:
        ambient = _BOUNCE + (1 - _BOUNCE) * points.normal[2]
        if given.shade > 0.2 or given.lamps > 0.0:
            out = np.float32(1.0) - np.abs(points.normal[2])
            xy = points.xyz[:2] + points.normal[:2] * out
            fine = np.maximum(points.footprint, np.float32(0.5))
            around = np.zeros((2 if given.lamps > 0.0 else 1, len(fine)), np.float32)
            self._around.add_to(around, xy, fine, points.dither)
            ambient *= 1.0 - np.float32(given.shade) * (1.0 - around[0])
        light: Singles = column(given.light.sky) * ambient
        if given.direct:
            points.sun[spans["leaves"]] += np.float32(_THROUGH_LEAVES)
            light += column(given.light.sun) * points.sun
        if given.lamps > 0.0:
            lamps = around[1]
            lamps[spans["roofs"]] *= _LAMPS_ON_ROOFS
            lamps[spans["leaves"]] *= _LAMPS_ON_LEAVES
            lamps[spans["walls"]] *= np.exp(height * np.float32(-1.0 / 6.0))
            light += column(_LAMP) * (lamps * np.float32(given.lamps))
        return light


def _covered(place: Singles, low: Singles | float, high: Singles | float, size: Singles) -> Singles:
    """Share of a pixel of `size` at `place` that lies between `low` and `high` of a cell of 1."""
    half = np.clip(size, 0.02, 1.0) * np.float32(0.5)
    inside = np.minimum(place + half, high) - np.maximum(place - half, low)
    sharp = np.clip(inside / (2 * half), 0.0, 1.0)
    # A pixel of a cell or more sees the mean of all cells.
    coarse = np.clip(size * 2.0 - 0.8, 0.0, 1.0)
    return np.asarray(sharp + (np.subtract(high, low, dtype=np.float32) - sharp) * coarse)


def _lay_snow(paint: Singles, points: Points, spans: Spans, snow: float) -> None:
    patches = volume_noise(points.xyz, 0.6, points.footprint)
    cover = np.float32(0.82) + 0.10 * patches
    cover += 0.08 * volume_noise(points.xyz, 0.15, points.footprint)
    # Cars and brooms clear pavements: grey, and not bright.
    ground = paint[:3, spans["ground"]]
    spread = ground.max(axis=0) - ground.min(axis=0)
    cover[spans["ground"]] -= 0.5 * np.clip(1.4 - spread * 12.0, 0.0, 1.0)
    cover[spans["leaves"]] -= np.float32(0.35)
    np.clip(cover, 0.0, 0.92, out=cover)
    cover *= np.clip((points.normal[2] - np.float32(0.25)) * np.float32(2.2), 0.0, 1.0)
    cover *= 1.0 - paint[4]
    cover *= np.float32(snow)
    white = column(_SNOW) * (1.0 + np.float32(0.03) * patches)
    paint[:3] += (white - paint[:3]) * cover
    paint[3] *= 1.0 - cover


def _make_wet(paint: Singles, points: Points, spans: Spans, wet: float) -> None:
    flat = np.clip((points.normal[2] - np.float32(0.3)) * 2.0, 0.0, 1.0) * np.float32(wet)
    country = points.part(spans["country"])
    dips = volume_noise(country.xyz, 0.9, country.footprint)
    paint[:3] *= 1.0 - np.float32(0.22) * flat * (1.0 - paint[4])
    soaked = np.full_like(flat, 0.25)
    soaked[spans["country"]] += np.clip(dips - np.float32(0.8), 0.0, 1.0)
    soaked[spans["leaves"]] = 0.0
    np.maximum(paint[3], soaked * flat, out=paint[3])


def _mirror_sky(colour: Singles, mirror: Singles, points: Points, given: Conditions) -> None:
    """Add the sky to colours (3, N), given how much they mirror, and of that as water."""
    which = np.flatnonzero(mirror[0] > 0.02)
    xyz, normal, view, (strength, waves) = (
        values.take(which, axis=1) for values in (*points[:3], mirror)
    )
    ripple = volume_noise(xyz, 0.3, points.footprint.take(which))
    normal[:2] += np.float32(0.02) * waves * ripple
    facing = -dot(view, normal)
    away = view + 2.0 * facing * normal
    slant = 1.0 - np.clip(facing, 0.0, 1.0)
    square = slant * slant
    share = _BASE_REFLECTANCE + (1 - _BASE_REFLECTANCE) * square * square * slant
    share *= strength
    seen = _sky_colour(away, given)
    seen *= np.clip(1.0 + 2.0 * away[2], 0.3, 1.0)
    for channel, mirrored in zip(colour, seen, strict=True):
        own = channel.take(which)
        channel[which] = own + (mirrored - own) * share
