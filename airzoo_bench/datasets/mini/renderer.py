"""Photos of a world with the depth of every pixel.

Embree, by Open3D, finds the triangle that a ray meets, in single precision. The distance is then
that to the triangle's plane in double precision: exact for the ray as given, and the same wherever
Embree's own rounding would have put it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFilter

from airzoo_bench.core.optional_imports import load_open3d
from airzoo_bench.datasets.mini.noise import Singles, gaussians, hash64, seed_of, uniforms
from airzoo_bench.datasets.mini.shading import Shader
from airzoo_bench.datasets.mini.surfaces import Points, dot
from airzoo_bench.datasets.mini.weather import Conditions, column, conditions, haze, sky_with_clouds
from airzoo_bench.datasets.mini.world import Material, Mesh, World
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.cameras import Cameras, back_project
from airzoo_bench.geometry.poses import Poses

_Indices = NDArray[np.int64]

RENDERER_VERSION = 2
"""To be raised with every change that changes photos, so that older ones are rendered again."""
_MISSED = -1
# How many pixels are worked on at once: as many as a processor's cache holds.
_BLOCK_PIXELS = 1 << 16

# A ray that grazes a triangle within Embree's rounding of its edge may meet the plane far off the
# triangle; beyond this (m, and share of the distance) Embree's own distance is the better one.
_TRUST_M, _TRUST_SHARE = 0.02, 1e-4
# How far shadow rays start above their surface: above single precision at 1.5 km (0.1 mm).
_LIFT_M = 0.02
# A pixel next to another surface is its centre and, by a third, what lies a third of a pixel
# towards that surface: the mean of three rays in a row, the one away from the edge being taken to
# see what the centre sees.
_THIRD = 1 / 3
_DITHER_SEED = 0xD17

# Light is kept as 16-bit integers, so that a photo of 48 megapixels stays small.
_STORED_ONE, _STORED_MOST = np.float32(16384.0), np.float32(3.99)

_BLUR = np.float32(0.09)
# How much darker corners are than the middle.
_VIGNETTE = np.float32(0.12)
_SHOULDER = np.float32(0.88)
_DROPS = {"rain": 420, "snow": 520}


class Frame(NamedTuple):
    """A photo and its depth."""

    rgb: NDArray[np.uint8]  # (H, W, 3)
    # (H, W): along the optical axis, metres; 0 where there is no surface
    depth: NDArray[np.float32]


def default_camera(width: int = 640, height: int = 480, field_deg: float = 62.0) -> Cameras:
    """Return a pinhole of a horizontal field of view, its principal point in the middle."""
    focal = width / 2 / np.tan(np.radians(field_deg) / 2)
    K = [[[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]]]
    return Cameras.from_matrices(K, width, height)


class Raycaster:
    """A mesh that rays can be cast at, on one thread (frames are spread over processes).

    Attributes
    ----------
    normal : (3, T) float64
        Of the mesh's triangles, unit; 0 where a triangle has no area.
    """

    def __init__(self, mesh: Mesh) -> None:
        open3d = load_open3d()
        self._tensor: Any = open3d.core.Tensor.from_numpy
        self._scene: Any = open3d.t.geometry.RaycastingScene(nthreads=1)
        self._scene.add_triangles(
            self._tensor(np.ascontiguousarray(mesh.vertices, np.float32)),
            self._tensor(np.ascontiguousarray(mesh.triangles, np.uint32)),
        )
        a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
        normal = np.cross(b - a, c - a)
        length = np.sqrt((normal * normal).sum(axis=1))
        unit = normal / np.where(length > 0.0, length, 1.0)[:, None]
        self.normal = np.ascontiguousarray(unit.T)
        # Of three corners each has its own rounding; their middle keeps the plane from tilting.
        self._offset = (unit * (a + b + c)).sum(axis=1) / 3.0

    def trace(self, origin: Floats, directions: Floats) -> tuple[_Indices, Floats]:
        """Cast rays from one point (3,), or each from its own (3, N), in directions (3, N)."""
        rays = np.empty((directions.shape[1], 6), np.float32)
        rays[:, :3] = origin.T
        # Embree does not say what a NaN does; any ray will do, its answer is not used.
        rays[:, 3:] = np.nan_to_num(directions, nan=1.0).T
        answer = self._scene.cast_rays(self._tensor(rays), nthreads=1)
        triangle = answer["primitive_ids"].numpy().astype(np.int64)
        missed = (triangle >= len(self._offset)) | np.isnan(directions[0])
        triangle[missed] = _MISSED
        rough = answer["t_hit"].numpy().astype(np.float64)
        slope, height = np.zeros(len(triangle)), self._offset.take(triangle)
        for axis in range(3):
            component = self.normal[axis].take(triangle)
            slope += component * directions[axis]
            height -= component * origin[axis]
        with np.errstate(divide="ignore", invalid="ignore"):
            distance: Floats = height / slope
            off = ~(np.abs(distance - rough) <= _TRUST_M + _TRUST_SHARE * rough)
        np.copyto(distance, rough, where=off)
        distance[missed] = 0.0
        return triangle, distance

    def occluded(self, points: Floats, normals: Floats, direction: Floats) -> Bools:
        """Return which points (3, N), lifted off their surface, are occluded."""
        rays = np.empty((points.shape[1], 6), np.float32)
        np.add(points, normals * _LIFT_M, out=rays[:, :3].T, casting="same_kind")
        rays[:, 3:] = direction
        blocked: Bools = self._scene.test_occlusions(self._tensor(rays), nthreads=1).numpy()
        return blocked


class _View(NamedTuple):
    """A camera at its place in the world's local frame, in its conditions."""

    camera: Cameras
    centre: Floats
    rotation: Floats
    given: Conditions

    def directions(self, pixel: _Indices, off: Floats | float = 0.0) -> Floats:
        """Return rays (3, N) of depth 1, `off` the pixels' centres; NaN where the lens has none."""
        row, column = np.divmod(pixel, int(self.camera.width[0]))
        places = np.stack([column, row]) + (0.5 + np.asarray(off))
        unit = back_project(self.camera, places.T[None])[0]
        x, y = (unit[:, :2] / unit[:, 2:]).T
        axes = self.rotation.T.tolist()
        return np.stack([x * right + y * down + forward for right, down, forward in axes])


class Renderer:
    """Takes photos of a world, one at a time on one thread."""

    def __init__(self, world: World) -> None:
        self._mesh = world.mesh
        self._caster = Raycaster(world.mesh)
        self._shader = Shader(world, self._caster.normal)
        self._keys = _surface_keys(world.mesh, self._caster.normal)
        border = [world.dsm[0], world.dsm[-1], world.dsm[:, 0], world.dsm[:, -1]]
        self._far_level_m = float(np.median(np.concatenate(border)))
        self._corner = np.array([world.region.west, world.region.south, 0.0])

    def render(self, camera: Cameras, pose: Poses, weather: str, time: str, seed: int) -> Frame:
        """Take a photo with one camera at one pose."""
        width, height = int(camera.width[0]), int(camera.height[0])
        centre = pose.centres[0] - self._corner
        view = _View(camera, centre, pose.rotation[0], conditions(weather, time))
        light = np.empty((3, height, width), np.uint16)
        depth = np.empty((height, width), np.float32)
        triangle = np.empty((height, width), np.int32)
        for rows in _row_blocks(width, height):
            pixel = np.arange(rows.start * width, rows.stop * width)
            seen, far, hit = self._look(view, view.directions(pixel), pixel)
            light[:, rows] = _to_stored(seen).reshape(3, -1, width)
            depth[rows] = far.reshape(-1, width)
            triangle[rows] = hit.reshape(-1, width)
        self._smooth_edges(light.reshape(3, -1), triangle, view)
        return Frame(_take_photo(light, view.rotation, view.given, seed), depth)

    def _smooth_edges(
        self, light: NDArray[np.uint16], triangle: NDArray[np.int32], view: _View
    ) -> None:
        """Blend pixels where surfaces meet, by the share of the other surface."""
        edge, towards = edge_pixels(triangle, self._keys)
        for start in range(0, len(edge), _BLOCK_PIXELS):
            part = slice(start, start + _BLOCK_PIXELS)
            pixel = edge[part]
            rays = view.directions(pixel, towards[:, part] * _THIRD)
            nearby = _from_stored(_to_stored(self._look(view, rays, pixel)[0]))
            own = _from_stored(light[:, pixel])
            light[:, pixel] = _to_stored(own + (nearby - own) * np.float32(_THIRD))

    def _look(self, view: _View, rays: Floats, pixel: _Indices) -> tuple[Singles, Floats, _Indices]:
        """Return the light along the rays of N pixels, their depths and triangles."""
        triangle, depth = self._caster.trace(view.centre, rays)
        light = np.zeros((3, len(depth)), np.float32)
        hit = np.flatnonzero(triangle != _MISSED)
        free = np.flatnonzero((triangle == _MISSED) & ~np.isnan(rays[0]))
        if len(hit):
            some = rays.take(hit, axis=1)
            light[:, hit] = self._surface(view, some, depth[hit], pixel[hit], triangle[hit])
        if len(free):
            light[:, free] = self._horizon(view, rays.take(free, axis=1))
        return light, depth, triangle

    def _surface(
        self, view: _View, rays: Floats, depth: Floats, pixel: _Indices, triangle: _Indices
    ) -> Singles:
        xyz = rays * depth + view.centre[:, None]
        normal = self._caster.normal.take(triangle, axis=1)
        length = np.sqrt(dot(rays, rays))
        np.negative(normal, out=normal, where=dot(normal, rays) > 0.0)
        distance = (depth * length).astype(np.float32)
        points = Points(
            xyz=xyz.astype(np.float32),
            normal=normal.astype(np.float32),
            view=(rays / length).astype(np.float32),
            distance=distance,
            footprint=distance * np.float32(1.0 / float(view.camera.focal[0].mean())),
            dither=uniforms(hash64(pixel.astype(np.uint64), _DITHER_SEED)),
            material=self._mesh.material.take(triangle),
            owner=self._mesh.owner.take(triangle),
            triangle=triangle,
        )
        lit = np.zeros(len(depth), np.float32)
        if view.given.direct:
            sun = np.array(view.given.light.direction)
            cosine: Floats = dot(normal, sun[:, None])
            facing = np.flatnonzero(cosine > 0.0)
            places, up = xyz.take(facing, axis=1), normal.take(facing, axis=1)
            lit[facing] = np.where(self._caster.occluded(places, up, sun), 0.0, cosine[facing])
        return self._shader.colour(points, lit, view.given)

    def _horizon(self, view: _View, rays: Floats) -> Singles:
        """Return sky, and below the horizon the land that goes on where the mesh ends."""
        given, unit = view.given, (rays / np.sqrt(dot(rays, rays))).astype(np.float32)
        light = np.empty_like(unit)
        above, below = np.flatnonzero(unit[2] >= 0.0), np.flatnonzero(unit[2] < 0.0)
        light[:, above] = sky_with_clouds(unit[:, above], given)
        down = unit[:, below]
        land, distance = self._shader.far_land(down, view.centre, self._far_level_m, given)
        sun = column(given.light.sun) * np.float32(given.light.direction[2])
        light[:, below] = haze(land * (column(given.light.sky) + sun), distance, down, given)
        return light


def _surface_keys(mesh: Mesh, normal: Floats) -> NDArray[np.int32]:
    """Give each surface of a mesh a number, so that edges show where neighbours' numbers differ."""
    land = np.isin(mesh.material, (Material.GROUND, Material.APRON))
    built = np.isin(mesh.material, (Material.ROOF, Material.WALL))
    side = np.where(built, np.rint(normal * 20.0), 0.0).astype(np.int64)
    parts = (np.where(land, 0, mesh.material + 1), np.where(land, 0, mesh.owner), *side)
    key = np.zeros(len(land), np.int64)
    for part, span in zip(parts, (8, 1 << 24, 64, 64, 64), strict=True):
        key = key * span + (part + span // 4)
    _, number = np.unique(key, return_inverse=True)
    return np.append(number, -1).astype(np.int32)


def edge_pixels(triangle: NDArray[np.int32], keys: NDArray[np.int32]) -> tuple[_Indices, Floats]:
    """Find pixels with another surface than the pixel to the side, above or below."""
    surface = np.pad(keys.take(triangle), 1, mode="edge")
    middle = surface[1:-1, 1:-1]
    left, right = surface[1:-1, :-2] != middle, surface[1:-1, 2:] != middle
    above, below = surface[:-2, 1:-1] != middle, surface[2:, 1:-1] != middle
    pixel = np.flatnonzero(left | right | above | below)
    across, down = (
        there.ravel()[pixel].astype(np.float64) - back.ravel()[pixel]
        for there, back in ((right, left), (below, above))
    )
    across[(across == 0.0) & (down == 0.0)] = 1.0
    return pixel, np.stack([across, down])


def _row_blocks(width: int, height: int) -> Iterator[slice]:
    """Yield slices of rows of an image, of `_BLOCK_PIXELS` or a little less, at least one row."""
    rows = max(_BLOCK_PIXELS // width, 1)
    for start in range(0, height, rows):
        yield slice(start, min(start + rows, height))


def _to_stored(light: Singles) -> NDArray[np.uint16]:
    """Turn light (1.0 being white) into 16-bit integers."""
    return (np.clip(light, 0.0, _STORED_MOST) * _STORED_ONE).astype(np.uint16)


def _from_stored(stored: NDArray[np.uint16]) -> Singles:
    return stored.astype(np.float32) * (np.float32(1.0) / _STORED_ONE)


def _take_photo(
    light: NDArray[np.uint16], rotation: Floats, given: Conditions, seed: int
) -> NDArray[np.uint8]:
    """Turn the light (3, H, W) that reaches the lens, see `_to_stored`, into an image (H, W, 3)."""
    _, height, width = light.shape
    drops = _drops(width, height, rotation, given.falling, seed) if given.falling else None
    photo = np.empty((height, width, 3), np.uint8)
    half = np.float32(np.hypot(width, height) / 2)
    x = (np.arange(width, dtype=np.float32) + 0.5 - width / 2) / half
    for rows in _row_blocks(width, height):
        sharp = _blurred(light, rows)
        if drops is not None:
            share = drops[rows].astype(np.float32) * np.float32(1.0 / 255.0)
            sharp += (column(given.horizon)[..., None] * np.float32(1.05) - sharp) * share
        y = (np.arange(rows.start, rows.stop, dtype=np.float32) + 0.5 - height / 2) / half
        square = (y * y)[:, None] + (x * x)[None]
        sharp *= (1 - _VIGNETTE * square * square).astype(np.float32)
        # Highlights bend to white softly.
        over = np.maximum(sharp - _SHOULDER, 0.0)
        levels = (np.minimum(sharp, _SHOULDER) + over / (1 + over / (1 - _SHOULDER))) * 255
        # Shot noise grows with the root of the light; read noise is always there.
        pixels = np.arange(rows.start * width, rows.stop * width, dtype=np.uint64)
        normal = gaussians(hash64(pixels, seed)).reshape(4, -1, width)
        strength = np.sqrt(np.maximum(levels, 4.0) / np.float32(128.0)) * np.float32(given.noise)
        levels += strength * (np.float32(0.8) * normal[:3] + np.float32(0.6) * normal[3])
        np.clip(levels, 0.0, 255.0, out=levels)
        photo[rows] = np.rint(levels, out=levels).transpose(1, 2, 0)
    return photo


def _blurred(light: NDArray[np.uint16], rows: slice) -> Singles:
    """Spread each pixel a little over its neighbours, as a lens does."""
    row = np.clip(np.arange(rows.start - 1, rows.stop + 1), 0, light.shape[1] - 1)
    part = _from_stored(light[:, row])
    centre = 1 - 2 * _BLUR
    down = part[:, 1:-1] * centre + (part[:, :-2] + part[:, 2:]) * _BLUR
    across = down * centre
    across[..., 1:] += down[..., :-1] * _BLUR
    across[..., :-1] += down[..., 1:] * _BLUR
    across[..., 0] += down[..., 0] * _BLUR
    across[..., -1] += down[..., -1] * _BLUR
    return across


def _drops(width: int, height: int, rotation: Floats, falling: str, seed: int) -> NDArray[np.uint8]:
    """Return how much of each pixel (H, W) rain or snow in the air covers, in 255ths."""
    image = Image.new("L", (width, height))
    draw, count = ImageDraw.Draw(image), _DROPS[falling]
    hashes = hash64(np.arange(2 * count, dtype=np.uint64), seed_of(seed, falling))
    chance = np.stack([uniforms(hashes, lane) for lane in range(4)]).reshape(8, count)
    start = np.stack([chance[0] * 1.2 - 0.1, chance[1] * 1.2 - 0.1]) * [[width], [height]]
    near = chance[2] ** 3
    if falling == "rain":
        # Streaks lie along the way that drops fall as the camera sees it.
        fall = (rotation @ np.array([0.16, 0.05, -1.0]))[:2]
        length = (0.02 + 0.09 * near) * height
        jitter = np.stack([chance[3] - 0.5, 0.5 - chance[3]]) * 0.12
        ends = np.concatenate([start, start + (fall[:, None] + jitter) * length]).T
        thick, blur = max(round(height / 500), 1), 0.4
        for line, strength in zip(ends.tolist(), (26 + 60 * chance[4]).tolist(), strict=True):
            draw.line(line, fill=int(strength), width=thick)
    else:
        size, blur = (0.0012 + 0.0055 * near) * height, 0.7
        boxes = np.concatenate([start - size, start + size]).T
        for box, strength in zip(boxes.tolist(), (210 - 120 * near).tolist(), strict=True):
            draw.ellipse(box, fill=int(strength))
    return np.asarray(image.filter(ImageFilter.BoxBlur(blur * height / 480)))
