"""Photos of a world with the depth of every pixel.

Embree, by Open3D, finds the triangle that a ray meets, in single precision. The distance is then
that to the triangle's plane in double precision: exact for the ray as given, and the same wherever
Embree's own rounding would have put it.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFilter

from airzoo_bench.core.optional_imports import load_open3d
from airzoo_bench.datasets.mini.noise import Singles, hash_of, uniforms
from airzoo_bench.datasets.mini.shading import Conditions, Points, Shader, column, conditions, dot
from airzoo_bench.datasets.mini.world import Material, Mesh, World
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses

_Indices = NDArray[np.int64]
_View = tuple[Floats, np.float32, Conditions]
"""Where the camera is, the angle of a pixel, and the conditions."""

RENDERER_VERSION = 3
"""To be raised with every change that changes photos, so that older ones are rendered again."""
_MISSED, _DITHER_STREAM = -1, 73
# How many pixels are worked on at once: as many as a processor's cache holds.
_BLOCK_PIXELS = 1 << 15

# A ray that grazes a triangle within Embree's rounding of its edge may meet the plane far off the
# triangle; beyond this (m, and share of the distance) Embree's own distance is the better one.
_TRUST_M, _TRUST_SHARE = 0.02, 1e-4
# How far shadow rays start above their surface: above single precision at 1.5 km (0.1 mm).
_LIFT_M = 0.02
# Shares of the light of a pixel's neighbours: of all four, and of those of another surface.
_BLUR, _EDGE_BLUR = np.float32(0.08), np.float32(0.08)
_VIGNETTE, _SHOULDER = np.float32(0.12), np.float32(0.88)
_DROPS = {"rain": 420, "snow": 520}


class Frame(NamedTuple):
    """A photo and its depth."""

    rgb: NDArray[np.uint8]  # (H, W, 3)
    # (H, W): along the optical axis, metres; 0 where there is no surface
    depth: NDArray[np.float32]


def default_camera(width: int = 640, height: int = 480) -> Cameras:
    """Return a pinhole of a horizontal field of view of 62 degrees, centred on the image."""
    focal = width / 2 / np.tan(np.radians(62.0) / 2)
    K = [[[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]]]
    return Cameras.from_matrices(K, width, height)


class Raycaster:
    """A mesh that rays can be cast at, on one thread (frames are spread over processes).

    `normal` are unit normals of its triangles, (3, T); 0 where one has no area.
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
        rays[:, 3:] = directions.T
        answer = self._scene.cast_rays(self._tensor(rays), nthreads=1)
        triangle = answer["primitive_ids"].numpy().astype(np.int64)
        missed = triangle >= len(self._offset)
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


class Renderer:
    """Takes photos of a world, one at a time on one thread."""

    def __init__(self, world: World) -> None:
        self._mesh, self._caster, self._shader = world.mesh, Raycaster(world.mesh), Shader(world)
        # Each surface has a number, so that edges show where neighbours' numbers differ.
        land = np.isin(world.mesh.material, (Material.GROUND, Material.APRON))
        built = np.isin(world.mesh.material, (Material.ROOF, Material.WALL))
        side = np.where(built, np.rint(self._caster.normal * 20.0), 0.0).astype(np.int64)
        number = hash_of(0, world.mesh.material, world.mesh.owner, *side) >> 33
        self._surfaces = np.append(np.where(land, 0, number), -1).astype(np.int32)
        self._corner = np.array([world.region.west, world.region.south, 0.0])

    def render(self, camera: Cameras, pose: Poses, weather: str, time: str, seed: int) -> Frame:
        """Take a photo with one camera at one pose."""
        width, height = int(camera.width[0]), int(camera.height[0])
        centre, given = pose.centres[0] - self._corner, conditions(weather, time)
        view = centre, np.float32(1.0 / float(camera.focal[0].mean())), given
        (fx, fy), (cx, cy) = camera.focal[0], camera.principal_point[0]
        count, step = height * width, max(_BLOCK_PIXELS // width, 1) * width
        light = np.empty((3, count), np.float32)
        depth, surface = np.empty(count, np.float32), np.empty(count, np.int32)
        for start in range(0, count, step):
            pixel = np.arange(start, min(start + step, count))
            row, across = np.divmod(pixel, width)
            x, y = (across + (0.5 - cx)) / fx, (row + (0.5 - cy)) / fy
            axes = pose.rotation[0].T.tolist()
            rays = np.stack([x * right + y * down + ahead for right, down, ahead in axes])
            triangle, away = self._caster.trace(centre, rays)
            block = slice(start, start + len(pixel))
            depth[block], surface[block] = away, self._surfaces.take(triangle)
            hit, free = (np.flatnonzero((triangle == _MISSED) == past) for past in (False, True))
            if len(hit):
                some = rays.take(hit, axis=1), away[hit], pixel[hit], triangle[hit]
                light[:, block][:, hit] = self._surface(view, *some)
            if len(free):
                beyond = rays.take(free, axis=1)
                unit = (beyond / np.sqrt(dot(beyond, beyond))).astype(np.float32)
                light[:, block][:, free] = self._shader.horizon(unit, centre, given)
        sharp = _blurred(light.reshape(3, height, width), surface.reshape(height, width))
        return Frame(_develop(sharp, pose.rotation[0], given, seed), depth.reshape(height, width))

    def _surface(
        self, camera: _View, rays: Floats, depth: Floats, pixel: _Indices, triangle: _Indices
    ) -> Singles:
        centre, pixel_angle, given = camera
        xyz, normal = rays * depth + centre[:, None], self._caster.normal.take(triangle, axis=1)
        length = np.sqrt(dot(rays, rays))
        np.negative(normal, out=normal, where=dot(normal, rays) > 0.0)
        distance = (depth * length).astype(np.float32)
        at, up, view = (part.astype(np.float32) for part in (xyz, normal, rays / length))
        dither = uniforms(hash_of(_DITHER_STREAM, pixel))
        material, owner = self._mesh.material.take(triangle), self._mesh.owner.take(triangle)
        points = Points(at, up, view, distance, distance * pixel_angle, dither, material, owner)
        lit = np.zeros(len(depth), np.float32)
        if given.direct:
            sun = np.array(given.light.direction)
            cosine: Floats = dot(normal, sun[:, None])
            facing = np.flatnonzero(cosine > 0.0)
            places, lifts = xyz.take(facing, axis=1), normal.take(facing, axis=1)
            lit[facing] = np.where(self._caster.occluded(places, lifts, sun), 0.0, cosine[facing])
        return self._shader.colour(points, lit, given)


def _blurred(light: Singles, surface: NDArray[np.int32]) -> Singles:
    """Spread light (3, H, W) over neighbours, as a lens does, more where surfaces (H, W) meet."""
    result = light.copy()
    for here, there in ((np.s_[:, 1:], np.s_[:, :-1]), (np.s_[1:, :], np.s_[:-1, :])):
        share = _BLUR + _EDGE_BLUR * (surface[here] != surface[there])
        step = (light[:, *there] - light[:, *here]) * share
        result[:, *here] += step
        result[:, *there] -= step
    return result


def _develop(sharp: Singles, rotation: Floats, given: Conditions, seed: int) -> NDArray[np.uint8]:
    """Turn the light (3, H, W) that reaches the lens into an image (H, W, 3)."""
    _, height, width = sharp.shape
    random = np.random.Generator(np.random.PCG64(seed))
    if given.falling:
        share = _drops(width, height, rotation, given.falling, random) * np.float32(1 / 255)
        sharp += (column(given.horizon)[..., None] * np.float32(1.05) - sharp) * share
    half = np.hypot(width, height) / 2
    x, y = (((np.arange(n) + 0.5 - n / 2) / half).astype(np.float32) for n in (width, height))
    square = (y * y)[:, None] + (x * x)[None]
    sharp *= 1 - _VIGNETTE * square * square
    # Highlights bend to white softly.
    over = np.maximum(sharp - _SHOULDER, 0.0)
    levels = (np.minimum(sharp, _SHOULDER) + over / (1 + over / (1 - _SHOULDER))) * 255
    # Shot noise grows with the root of the light; read noise is always there.
    strength = np.sqrt(np.maximum(levels, 4.0) / np.float32(128.0)) * np.float32(given.noise)
    normal = np.resize(np.roll(_grain(), random.integers(len(_grain()))), (4, height, width))
    levels += strength * (np.float32(0.8) * normal[:3] + np.float32(0.6) * normal[3])
    image = np.rint(levels.clip(0.0, 255.0)).astype(np.uint8)
    return np.ascontiguousarray(image.transpose(1, 2, 0))


@cache
def _grain() -> Singles:
    """Return normal numbers that the noise of all photos is cut from, each at another place."""
    return np.random.Generator(np.random.PCG64(0)).standard_normal(1_000_003, np.float32)


def _drops(
    width: int, height: int, rotation: Floats, falling: str, random: np.random.Generator
) -> NDArray[np.uint8]:
    """Return how much of each pixel (H, W) rain or snow in the air covers, in 255ths."""
    image = Image.new("L", (width, height))
    draw, chance = ImageDraw.Draw(image), random.random((6, _DROPS[falling]))
    start = (chance[:2] * 1.2 - 0.1) * [[width], [height]]
    near = chance[2] ** 3
    if falling == "rain":
        # Streaks lie along the way that drops fall as the camera sees it.
        fall = (rotation @ np.array([0.16, 0.05, -1.0]))[:2, None] + (chance[3:5] - 0.5) * 0.12
        ends = np.concatenate([start, start + fall * (0.02 + 0.09 * near) * height]).T
        thick, blur = max(round(height / 500), 1), 0.4
        for line, strength in zip(ends.tolist(), (26 + 60 * chance[5]).tolist(), strict=True):
            draw.line(line, fill=int(strength), width=thick)
    else:
        size, blur = (0.0012 + 0.0055 * near) * height, 0.7
        boxes = np.concatenate([start - size, start + size]).T
        for box, strength in zip(boxes.tolist(), (210 - 120 * near).tolist(), strict=True):
            draw.ellipse(box, fill=int(strength))
    return np.asarray(image.filter(ImageFilter.BoxBlur(blur * height / 480)))
