"""Making a region's world from a seed, the same to the last bit on every machine.

Everything random is counted from the seed (`noise`); arithmetic is in integers, or in the float
operations that IEEE 754 rounds alike everywhere (+ - * / and the square root, elementwise). There
are no sums of floats, no matrix products, no sines.

The older mosaic shows the same ground in another season and light, a little off.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.datasets.mini.city import city_plan
from airzoo_bench.datasets.mini.meshes import land_triangles, plan_mesh, season_rows
from airzoo_bench.datasets.mini.noise import hash_of, textures
from airzoo_bench.datasets.mini.painting import Canvas, Noise
from airzoo_bench.datasets.mini.plan import (
    GRID_M,
    LOOKS,
    OLDER,
    SURVEY,
    Building,
    Plan,
    Raster,
    Tree,
    colours,
)
from airzoo_bench.datasets.mini.rural import rural_plan
from airzoo_bench.datasets.mini.world import (
    OLDER_SUN,
    REGIONS,
    SIDE_M,
    SURVEY_SUN,
    Light,
    Material,
    Mesh,
    Region,
    World,
)
from airzoo_bench.geometry.arrays import Floats

_Indices = NDArray[np.int64]
_Rgb = NDArray[np.uint8]

_PLANS = {"city": city_plan, "rural": rural_plan}
_MAP, _DSM = Raster(2400, 0.25), Raster(1200, 0.5)
# The older mosaic is shifted by 0.6 m.
_MOSAIC = Raster(2000, 0.3, 0.48, -0.36)
_TREE_STREAM = 51
_BLOCK, _ROWS = 512, 100  # triangles and rows worked on at once
# Heights of shadows are in integers, so many to the metre.
_UNITS, _BIAS, _SOFT, _FAR_STEPS = 1024, 200, 512, 512


def build_world(region: str, seed: int) -> World:
    """Make one region of `world.REGIONS`; another seed makes another place of the same kind."""
    return world_of_plan(REGIONS[region], _PLANS[region](seed))


def world_of_plan(region: Region, plan: Plan) -> World:
    """Mesh a plan, paint it and draw its maps."""
    noise = textures(plan.seed, _MAP.size)
    mesh, ground, top, dom = _picture(plan, noise, SURVEY, _MAP, SURVEY_SUN)
    older = _picture(plan, noise, OLDER, _MOSAIC, OLDER_SUN)[-1]
    dsm = _look_down(mesh, _DSM)[0].astype(np.float32)
    buildings, trees = season_rows(plan, SURVEY)
    walls = np.array([_wall_row(building) for building in buildings], np.float32)
    leaves = _leaf_colours(plan, trees, SURVEY)
    maps = (ground, top, dsm, dom, _blur(_fade(older)))
    return World(region, plan.seed, mesh, walls, leaves, *maps)


def _wall_row(building: Building) -> tuple[float, ...]:
    """Return what walls look like, see `World.walls`."""
    box, b = building.box, building
    size = (b.base_m, b.storey_m, b.bay_m, b.style)
    return (*box.frame, box.u1, box.v1, *size, *(part / 255 for part in (*b.wall, *b.window)))


def _picture(
    plan: Plan, noise: list[Noise], season: int, raster: Raster, light: Light
) -> tuple[Mesh, _Rgb, _Rgb, _Rgb]:
    """Return the mesh of a season, and land, surface and lit map from above, see `World`."""
    mesh = plan_mesh(plan, season)
    buildings, trees = season_rows(plan, season)
    height, triangle, land = _look_down(mesh, raster)
    # Noise is that of the place, whatever the raster.
    x, y = (np.floor(at / _MAP.pixel_m).astype(np.int64) for at in raster.centres())
    rows, columns = (np.clip(at, 0, _MAP.size - 1) for at in (_MAP.size - 1 - y.ravel(), x.ravel()))
    noise = [part[np.ix_(rows, columns)] for part in noise]
    canvas = Canvas(plan, raster, noise, land, season)
    ground, water = canvas.colours()
    material, owner = mesh.material[triangle], mesh.owner[triangle]
    canvas.paint_roofs(buildings, np.where(material == Material.ROOF, owner, -1))
    top, still_water = canvas.colours()
    leafy = material == Material.CANOPY
    mottle = (noise[0][leafy].astype(np.int32) * 40 + noise[1][leafy].astype(np.int32) * 14) >> 6
    leaves = _leaf_colours(plan, trees, season)[owner[leafy]] + (mottle[:, None] * [8, 8, 6] >> 3)
    top[leafy] = np.clip(leaves, 0, 255)
    lit = _in_light(top, mesh, triangle, height, raster, light)
    still_water &= ~leafy
    ground = np.dstack([ground, water * np.uint8(255)])
    return mesh, ground, np.dstack([top, still_water * np.uint8(255)]), lit


def _look_down(mesh: Mesh, raster: Raster) -> tuple[Floats, NDArray[np.int32], Floats]:
    """Return height and number of the highest triangle at pixel centres, and the land's height."""
    corners = mesh.vertices[mesh.triangles]
    normal = _normals(corners)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = -normal[:, :2] / normal[:, 2:]
    x, y = raster.centres()
    cells = round(SIDE_M / GRID_M)

    def plane(number: NDArray[np.int32] | _Indices, x: Floats, y: Floats) -> Floats:
        rise, first = slope[number], mesh.vertices[mesh.triangles[number, 0]]
        z = first[:, 2] + rise[:, 0] * (x - first[:, 0]) + rise[:, 1] * (y - first[:, 1])
        return np.asarray(z)

    shape = raster.size, raster.size
    triangle, land = np.empty(shape, np.int32), np.empty(shape)
    for rows in (slice(row, row + _ROWS) for row in range(0, raster.size, _ROWS)):
        triangle[rows] = land_triangles(x, y[rows], cells)
        at_x, at_y = np.broadcast_arrays(x, y[rows])
        land[rows] = plane(triangle[rows].ravel(), at_x.ravel(), at_y.ravel()).reshape(at_x.shape)
    highest, height = triangle.ravel(), land.ravel().copy()
    over = np.isin(mesh.material, (Material.ROOF, Material.CANOPY)) & (normal[:, 2] > 1e-9)
    numbers = np.flatnonzero(over)
    for start in range(0, len(numbers), _BLOCK):
        some = numbers[start : start + _BLOCK]
        part = corners[some]
        which, column, row = _pixels_in_boxes(part, raster)
        at_x, at_y = x[0, column], y[row, 0]
        inside = np.ones(at_x.shape, np.bool_)
        for i, j in ((0, 1), (1, 2), (2, 0)):
            (x0, y0), (x1, y1) = (part[:, k, :2].T.take(which, axis=1) for k in (i, j))
            inside &= (x1 - x0) * (at_y - y0) - (y1 - y0) * (at_x - x0) >= -1e-9
        pixel, own = (row * raster.size + column)[inside], some[which[inside]]
        z = plane(own, at_x[inside], at_y[inside])
        np.maximum.at(height, pixel, z)
        best = z == height[pixel]
        highest[pixel[best]] = own[best]
    return height.reshape(shape), triangle, land


def _normals(corners: Floats) -> Floats:
    # Not np.cross, whose order of operations is not promised.
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    x = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    y = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    return np.stack([x, y, a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]], 1)


def _pixels_in_boxes(corners: Floats, raster: Raster) -> tuple[_Indices, _Indices, _Indices]:
    """Return pairs of triangle and pixel (column and row) with boxes that meet."""
    north = raster.south + raster.size * raster.pixel_m
    places = np.stack([corners[..., 0] - raster.west, north - corners[..., 1]], -1) / raster.pixel_m
    first = np.maximum(np.ceil(places.min(axis=1) - 0.5), 0).astype(np.int64)
    last = np.minimum(np.floor(places.max(axis=1) - 0.5), raster.size - 1).astype(np.int64)
    wide, tall = np.maximum(last - first + 1, 0).T
    counts = wide * tall
    which = np.repeat(np.arange(len(counts)), counts)
    place = np.arange(len(which)) - (np.cumsum(counts) - counts)[which]
    south, east = np.divmod(place, np.maximum(wide, 1)[which])
    return which, first[which, 0] + east, first[which, 1] + south


def _leaf_colours(plan: Plan, trees: list[Tree], season: int) -> NDArray[np.int32]:
    """Return the albedo of each tree's canopy, (T, 3)."""
    bits = hash_of(plan.seed, _TREE_STREAM, np.arange(len(trees))).tolist()
    tables = {kind: colours(look["colours"]) for kind, look in LOOKS["trees"].items()}
    albedo = np.zeros((len(trees), 3), np.int32)
    for index, (tree, draw) in enumerate(zip(trees, bits, strict=True)):
        table = tables[tree.kind]
        albedo[index] = np.array(table[draw % len(table)]) + ((draw >> 32) % 25 - 12)
    return albedo * 3 // 4 + 14 if season == OLDER else albedo


def _in_light(
    albedo: _Rgb,
    mesh: Mesh,
    triangle: NDArray[np.int32],
    height: Floats,
    raster: Raster,
    light: Light,
) -> _Rgb:
    """Return a map (n, n, 3) of albedo in light and shadow, see `world.Light`."""
    x, y, z = _normals(mesh.vertices[mesh.triangles]).T
    along = x * light.direction[0] + y * light.direction[1] + z * light.direction[2]
    cosine = np.maximum(along / np.maximum(np.sqrt(x * x + y * y + z * z), 1e-12), 0.0)
    visible = _sunlit(height, light, raster.pixel_m).astype(np.float32)
    sun, result = (
        cosine.astype(np.float32)[triangle] * (visible / np.float32(255)),
        np.empty_like(albedo),
    )
    for channel in range(3):
        factor = sun * np.float32(light.sun[channel]) + np.float32(light.sky[channel])
        bright = factor * albedo[..., channel] + np.float32(0.5)
        result[..., channel] = np.minimum(bright, np.float32(255)).astype(np.uint8)
    return result


def _sunlit(heights: Floats, light: Light, pixel_m: float) -> _Rgb:
    """Return how much of the sun reaches each pixel of heights (n, n) in metres, 0 to 255."""
    east, north, up = light.direction
    size = len(heights)
    drop = round(_UNITS * pixel_m * up / -north)
    shift = np.floor(np.arange(size) * (east / north) + 0.5).astype(np.int64)
    offsets = (shift - shift.min()).tolist()
    low = np.floor(heights * _UNITS).astype(np.int32)
    shadow = np.full((size, size + max(offsets)), -(1 << 29), np.int32)
    for row, offset in enumerate(offsets):
        shadow[row, offset : offset + size] = low[row]
    steps = 1
    while steps <= _FAR_STEPS:
        np.maximum(shadow[:-steps], shadow[steps:] - drop * steps, out=shadow[:-steps])
        steps *= 2
    back = np.stack([shadow[row, offset : offset + size] for row, offset in enumerate(offsets)])
    dark = np.clip((back - low - _BIAS) * 255 // _SOFT, 0, 255)
    return np.asarray((255 - dark).astype(np.uint8))


def _fade(picture: _Rgb) -> _Rgb:
    """Take contrast and colour away, and add a bluish haze."""
    bands = [
        (picture[..., k].astype(np.int32) * 205 >> 8) + lift for k, lift in enumerate((22, 24, 32))
    ]
    grey = (bands[0] * 2 + bands[1] * 3 + bands[2]) // 6
    return np.stack([(band * 13 + grey * 3) >> 4 for band in bands], -1).astype(np.uint8)


def _blur(picture: _Rgb) -> _Rgb:
    """Blur by 1-2-1 along columns and rows."""
    for _ in range(2):
        around = np.pad(picture.astype(np.uint16), ((1, 1), (0, 0), (0, 0)), mode="edge")
        picture = ((around[:-2] + around[2:] + around[1:-1] * 2 + 2) >> 2).astype(np.uint8)
        picture = picture.transpose(1, 0, 2)
    return np.ascontiguousarray(picture)
