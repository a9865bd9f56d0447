"""Making a region's world from a seed, the same to the last bit on every machine.

Everything random is counted from the seed (`noise`); arithmetic is in integers, or in the float
operations that IEEE 754 rounds alike everywhere (+ - * / and the square root, elementwise). There
are no sums of floats, no matrix products, no sines.

The older mosaic shows the same ground in another season and light, a little off.
"""

from __future__ import annotations

from operator import attrgetter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from airzoo_bench.datasets.mini import layout, world
from airzoo_bench.datasets.mini.city import city_plan
from airzoo_bench.datasets.mini.layout import GRID_M, LOOKS, OLDER, SURVEY, Building, Plan, Raster
from airzoo_bench.datasets.mini.noise import direction, hash_of, octaves
from airzoo_bench.datasets.mini.painting import Canvas, Noise
from airzoo_bench.datasets.mini.rural import rural_plan
from airzoo_bench.datasets.mini.world import Light, Material, Mesh, World
from airzoo_bench.geometry.arrays import Floats

_Indices = NDArray[np.int64]
_Numbers = NDArray[np.int32]
_Rgb = NDArray[np.uint8]

_MAP, _DSM = Raster(2400, 0.25), Raster(1200, 0.5)
# Noise that all paints share, fine, middle and coarse: weights of sizes in pixels.
_NOISE = {1_000: {1: 7, 3: 9}, 2_000: {6: 7, 13: 6, 24: 5}, 3_000: {60: 7, 130: 6, 240: 5}}
_MOSAIC = Raster(2000, 0.3, 0.48, -0.36)  # shifted by 0.6 m
_TREE_STREAM, _LEAF_STREAM = 31, 51
_BLOCK, _ROWS = 512, 100  # triangles and rows worked on at once
# Heights of shadows are in integers, so many to the metre.
_UNITS, _BIAS, _SOFT, _FAR_STEPS = 1024, 200, 512, 512
# Distances of the apron's corners beyond the border, in steps of the grid, to 800 m.
_BEYOND = np.array([0, 2, 5, 10, 18, 30, 45, 65, 90, 120, 160, 205, 255, 325, 400])
# How far walls go below the floor, so that uneven land leaves no gap; not on roofs.
_FOUNDATION_M, _ON_ROOF = 0.8, 4


def build_world(region: str, seed: int) -> World:
    """Make one region of `world.REGIONS`; another seed makes another place of the same kind."""
    lay_out = {"city": city_plan, "rural": rural_plan}[region]
    return world_of_plan(world.REGIONS[region], lay_out(seed))


def world_of_plan(region: world.Region, plan: Plan) -> World:
    """Mesh a plan, paint it and draw its maps."""
    noise = [
        (octaves(plan.seed, stream, _MAP.size, cells) >> 4).astype(np.int16)
        for stream, cells in _NOISE.items()
    ]
    mesh, ground, top, dom = _picture(plan, noise, SURVEY, _MAP, world.SURVEY_SUN)
    older = _picture(plan, noise, OLDER, _MOSAIC, world.OLDER_SUN)[-1]
    dsm = _look_down(mesh, _DSM)[0].astype(np.float32)
    buildings, trees = plan.season_rows(SURVEY)
    size = attrgetter("base_m", "storey_m", "bay_m", "style")
    rows = [(*b.box.frame, b.box.u1, b.box.v1, *size(b), *b.wall, *b.window) for b in buildings]
    walls = np.array(rows)
    walls[:, 10:] /= 255
    leaves = _leaf_colours(plan.seed, trees, SURVEY)
    maps = (ground, top, dsm, dom, _age(older))
    return World(region, plan.seed, mesh, walls.astype(np.float32), leaves, *maps)


# --- maps ---


def _picture(
    plan: Plan, noise: list[Noise], season: int, raster: Raster, light: Light
) -> tuple[Mesh, _Rgb, _Rgb, _Rgb]:
    """Return the mesh of a season, and land, surface and lit map from above, see `World`."""
    mesh, (buildings, trees) = plan_mesh(plan, season), plan.season_rows(season)
    height, triangle, land = _look_down(mesh, raster)
    # Noise is that of the place, whatever the raster.
    x, y = (np.floor(at / _MAP.pixel_m).astype(np.int64).ravel() for at in raster.centres())
    rows, columns = (np.clip(at, 0, _MAP.size - 1) for at in (_MAP.size - 1 - y, x))
    noise = [part[np.ix_(rows, columns)] for part in noise]
    canvas = Canvas(plan, raster, noise, land, season)
    ground, water = canvas.colours()
    material, owner = mesh.material[triangle], mesh.owner[triangle]
    on_top = np.where(material == Material.ROOF, owner, -1)
    for number, building in enumerate(buildings):
        for decal in building.decals:
            canvas.paint(decal, on_top, number)
    top, still_water = canvas.colours()
    leafy = material == Material.CANOPY
    mottle = (noise[0][leafy].astype(np.int32) * 40 + noise[1][leafy].astype(np.int32) * 14) >> 6
    leaves = _leaf_colours(plan.seed, trees, season)[owner[leafy]]
    top[leafy] = np.clip(leaves + (mottle[:, None] * [8, 8, 6] >> 3), 0, 255)
    lit = _in_light(top, mesh, triangle, height, raster, light)
    ground = np.dstack([ground, water * np.uint8(255)])
    return mesh, ground, np.dstack([top, (still_water & ~leafy) * np.uint8(255)]), lit


def _look_down(mesh: Mesh, raster: Raster) -> tuple[Floats, _Numbers, Floats]:
    """Return height and number of the highest triangle at pixel centres, and the land's height."""
    corners = mesh.vertices[mesh.triangles]
    normal = _normals(corners)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = -normal[:, :2] / normal[:, 2:]

    def plane(number: _Numbers | _Indices, x: Floats, y: Floats) -> Floats:
        rise, first = slope[number], mesh.vertices[mesh.triangles[number, 0]]
        z = first[:, 2] + rise[:, 0] * (x - first[:, 0]) + rise[:, 1] * (y - first[:, 1])
        return np.asarray(z)

    x, y = raster.centres()
    cells = round(np.sqrt((mesh.material == Material.GROUND).sum() / 2))
    shape = raster.size, raster.size
    triangle, land = np.empty(shape, np.int32), np.empty(shape)
    for rows in (slice(row, row + _ROWS) for row in range(0, raster.size, _ROWS)):
        triangle[rows] = _land_triangles(x, y[rows], cells)
        at_x, at_y = np.broadcast_arrays(x, y[rows])
        land[rows] = plane(triangle[rows].ravel(), at_x.ravel(), at_y.ravel()).reshape(at_x.shape)
    highest, height = triangle.ravel(), land.ravel().copy()
    over = np.isin(mesh.material, (Material.ROOF, Material.CANOPY)) & (normal[:, 2] > 1e-9)
    numbers = np.flatnonzero(over)
    for some in (numbers[start : start + _BLOCK] for start in range(0, len(numbers), _BLOCK)):
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


def _leaf_colours(seed: int, trees: list[layout.Tree], season: int) -> _Numbers:
    bits = hash_of(seed, _LEAF_STREAM, np.arange(len(trees))).tolist()
    tables = {kind: layout.colours(look["colours"]) for kind, look in LOOKS["trees"].items()}
    rows = [
        [part + (draw >> 32) % 25 - 12 for part in table[draw % len(table)]]
        for table, draw in zip((tables[tree.kind] for tree in trees), bits, strict=True)
    ]
    albedo = np.array(rows, np.int32)
    return albedo * 3 // 4 + 14 if season == OLDER else albedo


def _in_light(
    albedo: _Rgb, mesh: Mesh, triangle: _Numbers, height: Floats, raster: Raster, light: Light
) -> _Rgb:
    """Return a map (n, n, 3) of albedo in light and shadow, see `world.Light`."""
    x, y, z = _normals(mesh.vertices[mesh.triangles]).T
    along = x * light.direction[0] + y * light.direction[1] + z * light.direction[2]
    cosine = np.maximum(along / np.maximum(np.sqrt(x * x + y * y + z * z), 1e-12), 0.0)
    # What casts a shadow lies towards the sun: in columns, once the map is sheared.
    (east, north, up), size = light.direction, raster.size
    drop = round(_UNITS * raster.pixel_m * up / -north)
    shift = np.floor(np.arange(size) * (east / north) + 0.5).astype(np.int64)
    sheared = np.arange(size)[:, None], np.arange(size) + (shift - shift.min())[:, None]
    low = np.floor(height * _UNITS).astype(np.int32)
    shadow = np.full((size, size + np.ptp(shift)), -(1 << 29), np.int32)
    shadow[sheared] = low
    steps = 1
    while steps <= _FAR_STEPS:
        np.maximum(shadow[:-steps], shadow[steps:] - drop * steps, out=shadow[:-steps])
        steps *= 2
    dark = np.clip((shadow[sheared] - low - _BIAS) * 255 // _SOFT, 0, 255)
    visible = (255 - dark).astype(np.float32)
    sun = cosine.astype(np.float32)[triangle] * (visible / np.float32(255))
    result = np.empty_like(albedo)
    for channel in range(3):
        factor = sun * np.float32(light.sun[channel]) + np.float32(light.sky[channel])
        bright = factor * albedo[..., channel] + np.float32(0.5)
        result[..., channel] = np.minimum(bright, np.float32(255)).astype(np.uint8)
    return result


def _age(picture: _Rgb) -> _Rgb:
    """Fade and blur an older map."""
    bands = (picture.astype(np.int32) * 205 >> 8) + np.array([22, 24, 32], np.int32)
    grey = bands @ np.array([2, 3, 1], np.int32) // 6
    picture = (bands * 13 + grey[..., None] * 3 >> 4).astype(np.uint8)
    for _ in range(2):
        around = np.pad(picture.astype(np.uint16), ((1, 1), (0, 0), (0, 0)), mode="edge")
        picture = ((around[:-2] + around[2:] + around[1:-1] * 2 + 2) >> 2).astype(np.uint8)
        picture = picture.transpose(1, 0, 2)
    return np.ascontiguousarray(picture)


# --- the mesh ---


def plan_mesh(plan: Plan, season: int) -> Mesh:
    """Mesh land, buildings and trees of a season, and the land mirrored beyond the border.

    The land's triangles come first, as `_land_triangles` says.
    """
    buildings, trees = plan.season_rows(season)
    inside = np.arange(plan.heights.shape[0])
    parts = [_mesh_grid(inside, inside, plan.heights, Material.GROUND)]
    for roof, (walls, tops) in LOOKS["roofs"].items():
        owners = [i for i, building in enumerate(buildings) if building.roof == roof]
        corners = np.array([_corners(buildings[i]) for i in owners]).reshape(-1, 10, 3)
        materials = [Material.WALL] * len(walls) + [Material.ROOF] * len(tops)
        parts.append(_copies(corners, walls + tops, materials, np.array(owners, np.int64)))
    parts += _tree_meshes(plan, trees)
    west, east = -_BEYOND[::-1], inside[-1] + _BEYOND
    strips = [(inside, west), (inside, east), (west, inside), (east, inside)]
    strips += [(a, b) for a in (west, east) for b in (west, east)]
    parts += [_mesh_grid(x, y, plan.heights, Material.APRON) for x, y in strips]
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    triangles = [part.triangles + start for part, start in zip(parts, starts, strict=True)]
    vertices, _, *rest = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return Mesh(vertices, np.concatenate(triangles).astype(np.int32), *rest)


def _mesh_grid(columns: _Indices, rows: _Indices, heights: Floats, material: Material) -> Mesh:
    """Mesh land by cells cut from south-west to north-east: lower triangles, then upper ones."""
    last = heights.shape[0] - 1
    mirrored = (last - np.abs(np.abs(index) % (2 * last) - last) for index in (rows, columns))
    x, y = np.meshgrid(columns * GRID_M, rows * GRID_M)
    points = np.stack([x, y, heights[np.ix_(*mirrored)]], -1).reshape(-1, 3)
    wide = len(columns)
    first = (np.arange(len(rows) - 1)[:, None] * wide + np.arange(wide - 1)[None, :]).ravel()
    lower = np.stack([first, first + 1, first + wide + 1], 1)
    upper = np.stack([first, first + wide + 1, first + wide], 1)
    return _copies(points[None], np.concatenate([lower, upper]), material, np.array([-1]))


def _land_triangles(x: Floats, y: Floats, cells: int) -> _Numbers:
    """Return the triangle of the land at points, which broadcast; others are clipped."""
    column, row = (np.clip(np.floor(at / GRID_M), 0, cells - 1).astype(np.int32) for at in (x, y))
    upper = (y - row * GRID_M) > (x - column * GRID_M)
    return row * np.int32(cells) + column + upper * np.int32(cells * cells)


def _copies(vertices: Floats, table: ArrayLike, materials: ArrayLike, owners: _Indices) -> Mesh:
    """Put copies of a form (T triangles of C corners), with vertices (N, C, 3), into one mesh."""
    count, corners = vertices.shape[:2]
    form = np.asarray(table)
    triangles = form[None] + (np.arange(count) * corners)[:, None, None]
    return Mesh(
        vertices.reshape(-1, 3),
        triangles.reshape(-1, 3).astype(np.int32),
        np.tile(np.broadcast_to(materials, len(form)), count).astype(np.uint8),
        np.repeat(owners, len(form)).astype(np.int32),
    )


def _corners(building: Building) -> list[tuple[float, float, float]]:
    (frame, u0, u1, v0, v1, _), eaves, ridge_m = building.box, building.eaves_m, building.ridge_m
    low = building.base_m - (0.0 if building.style == _ON_ROOF else _FOUNDATION_M)
    far = ridge_m if building.roof == "shed" else eaves
    # The slope of hips is that of the sides; a square plan keeps half a metre of ridge.
    end = u1 - (min(v1, u1 - 0.25) if building.roof == "hipped" else 0.0)
    plan = [(u0, v0), (u1, v0), (u1, v1), (u0, v1)]
    levels = (low,) * 4 + (eaves, eaves, far, far) + (ridge_m,) * 2
    places = zip([*plan, *plan, (-end, 0), (end, 0)], levels, strict=True)
    return [(*frame.to_world(u, v), level) for (u, v), level in places]


def _tree_meshes(plan: Plan, trees: list[layout.Tree]) -> list[Mesh]:
    feet = np.array([(tree.x, tree.y, plan.height(tree.x, tree.y)) for tree in trees])
    sizes = np.array([(tree.radius_m, tree.height_m) for tree in trees])
    parts = []
    for kind, look in LOOKS["trees"].items():
        owners = np.array([i for i, tree in enumerate(trees) if tree.kind == kind], np.int64)
        foot, (radius, height) = feet[owners], sizes[owners].T
        half = height * look["half"]
        half = half if look["taper"] else np.minimum(half, 1.1 * radius)
        ball, table = _ball(*look["rings"])
        # A tree keeps its form through the seasons, which is that of its place.
        place = np.rint(foot[:, :2] * 1024).astype(np.int64)
        bits = hash_of(plan.seed, _TREE_STREAM, place[:, :1], place[:, 1:], np.arange(len(ball)))
        bulge = 0.74 + 0.48 * ((bits >> 44).astype(np.float64) / (1 << 20))
        shape = ball * bulge[..., None]
        shape[..., :2] *= 1.0 - look["taper"] * shape[..., 2:]
        scale = np.stack([radius, radius, half], -1)[:, None, :]
        centre = np.column_stack([foot[:, :2], foot[:, 2] + height - half])[:, None, :]
        parts.append(_copies(centre + shape * scale, table, Material.CANOPY, owners))
    low = [LOOKS["trees"][tree.kind]["half"] < 0.5 for tree in trees]
    stems = np.flatnonzero(low)
    foot, (radius, height) = feet[stems], sizes[stems].T
    half, top = 0.1 + 0.05 * radius, foot[:, 2] + 0.62 * height
    corners = [
        np.stack([foot[:, 0] + a * half, foot[:, 1] + b * half, z], -1)
        for z in (foot[:, 2] - 0.4, top)
        for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    return [*parts, _copies(np.stack(corners, 1), LOOKS["roofs"]["flat"][0], Material.TRUNK, stems)]


def _ball(rings: int, around: int) -> tuple[Floats, _Indices]:
    """Return corners and triangles of a ball: rings between poles, every second turned."""
    corners = [(0.0, 0.0, -1.0)]
    triangles = []
    for ring in range(rings):
        height, level = direction(round(128 * (ring + 1) / (rings + 1)))
        for step in range(around):
            x, y = direction(round(256 * (step + ring % 2 / 2) / around))
            corners.append((level * x, level * y, -height))
            low, side = ring * around, (step + 1) % around
            a, b = low + step + 1, low + side + 1
            if ring == 0:
                triangles.append((0, b, a))
            else:
                # Below lie the corners before and after this one, or this one's and the next.
                c, d = ((step - 1) % around, step) if ring % 2 == 0 else (step, side)
                c, d = low - around + c + 1, low - around + d + 1
                triangles += [(c, d, a), (d, b, a)]
            if ring == rings - 1:
                triangles.append((a, b, low + around + 1))
    return np.array([*corners, (0.0, 0.0, 1.0)]), np.array(triangles)
