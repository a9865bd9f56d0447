"""Photos of a world with the depth of every pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError
from airzoo_bench.datasets.mini.rendering.scene import Rays, Scene
from airzoo_bench.datasets.mini.rendering.sensor import (
    BLOCK_PIXELS,
    from_stored,
    row_blocks,
    take_photo,
    to_stored,
)
from airzoo_bench.datasets.mini.rendering.weather import Conditions, conditions
from airzoo_bench.datasets.mini.world.model import Material, Mesh, World
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras, back_project
from airzoo_bench.geometry.poses import Poses

__all__ = ["RENDERER_VERSION", "Frame", "Renderer", "check_size", "default_camera"]

RENDERER_VERSION = 2
"""To be raised with every change that changes photos, so that older ones are rendered again."""

# The largest photo; rendering it takes some 1.8 GB.
_MOST_PIXELS = 64_000_000

# Rays through the pixels are kept from one frame to the next where they are no more than this.
_KEPT_RAYS = 1 << 21

# A pixel next to another surface is its centre and, by a third, what lies a third of a pixel
# towards that surface: the mean of three rays in a row, the one away from the edge being taken to
# see what the centre sees.
_THIRD = 1 / 3

_LAND = (Material.GROUND, Material.APRON)
_BUILT = (Material.ROOF, Material.WALL)


@dataclass(frozen=True, eq=False)
class Frame:
    """A photo and what it is of."""

    rgb: NDArray[np.uint8]  # (H, W, 3)
    # (H, W): along the optical axis, metres; 0 where there is no surface
    depth: NDArray[np.float32]


def default_camera(width: int = 640, height: int = 480, field_deg: float = 62.0) -> Cameras:
    """Return a pinhole of a horizontal field of view, its principal point in the middle."""
    focal = width / 2 / np.tan(np.radians(field_deg) / 2)
    K = [[[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]]]
    return Cameras.from_matrices(K, width, height)


def check_size(camera: Cameras) -> tuple[int, int]:
    """Return width and height of a camera's photos, refusing those that would not fit memory."""
    width, height = int(camera.width[0]), int(camera.height[0])
    if width * height > _MOST_PIXELS:
        raise UsageError(
            f"a photo of {width} x {height} pixels would not fit memory",
            where="resolution",
            expected=f"at most {_MOST_PIXELS:,} pixels, such as 8000 x 6000",
            fix="ask for a smaller photo",
        )
    return width, height


class Renderer:
    """Takes photos of a world, one at a time on one thread."""

    def __init__(self, world: World) -> None:
        self._scene = Scene(world)
        self._keys = _surface_keys(world.mesh, self._scene.normal)
        self._corner = np.array([world.region.west, world.region.south, 0.0])
        self._kept: tuple[bytes, Floats] | None = None

    def render(self, camera: Cameras, pose: Poses, weather: str, time: str, seed: int) -> Frame:
        """Take a photo."""
        given = conditions(weather, time)
        if len(camera) != 1 or len(pose) != 1:
            raise UsageError(f"{len(camera)} cameras and {len(pose)} poses", expected="one of each")
        width, height = check_size(camera)
        view = _View(camera, pose.centres[0] - self._corner, pose.rotation[0])
        light, depth = self._shoot(view, width, height, given)
        return Frame(take_photo(light, view.rotation, given, seed), depth)

    def _shoot(
        self, view: _View, width: int, height: int, given: Conditions
    ) -> tuple[NDArray[np.uint16], NDArray[np.float32]]:
        light = np.empty((3, height, width), np.uint16)
        depth = np.empty((height, width), np.float32)
        triangle = np.empty((height, width), np.int32)
        for rows in row_blocks(width, height):
            pixel = np.arange(rows.start * width, rows.stop * width)
            rays = view.rays(self._through_pixels(view.camera, pixel), pixel)
            seen, far, what = self._scene.look(rays, given)
            light[:, rows] = to_stored(seen).reshape(3, -1, width)
            depth[rows] = far.reshape(-1, width)
            triangle[rows] = what.reshape(-1, width)
        self._smooth(light.reshape(3, -1), *edge_pixels(triangle, self._keys), view, given)
        return light, depth

    def _smooth(
        self,
        light: NDArray[np.uint16],
        edge: NDArray[np.int64],
        towards: Floats,
        view: _View,
        given: Conditions,
    ) -> None:
        """Blend pixels where surfaces meet with the other surface, as far as it reaches in."""
        for start in range(0, len(edge), BLOCK_PIXELS):
            part = slice(start, start + BLOCK_PIXELS)
            pixel = edge[part]
            rays = view.rays(_through(view.camera, pixel, towards[:, part] * _THIRD), pixel)
            nearby = to_stored(self._scene.look(rays, given)[0])
            own = from_stored(light[:, pixel])
            light[:, pixel] = to_stored(own + (from_stored(nearby) - own) * np.float32(_THIRD))

    def _through_pixels(self, camera: Cameras, pixel: NDArray[np.int64]) -> Floats:
        """Return `_through` of pixels in a row, remembered from the frame before."""
        count = int(camera.width[0] * camera.height[0])
        if count > _KEPT_RAYS:
            return _through(camera, pixel)
        parts = (camera.width, camera.height, camera.focal, camera.principal_point)
        key = b"".join(part.tobytes() for part in (*parts, camera.distortion))
        if self._kept is None or self._kept[0] != key:
            self._kept = (key, _through(camera, np.arange(count)))
        return self._kept[1][:, pixel[0] : pixel[-1] + 1]


@dataclass(frozen=True, eq=False)
class _View:
    """A camera at its place in the world's local frame."""

    camera: Cameras
    centre: Floats
    rotation: Floats

    def rays(self, xy: Floats, pixel: NDArray[np.int64]) -> Rays:
        """Rays along (x, y, 1) of the camera, of pixels by number."""
        directions = np.empty((3, xy.shape[1]))
        for axis in range(3):
            right, down, forward = self.rotation[:, axis]
            np.multiply(xy[0], right, out=directions[axis])
            directions[axis] += xy[1] * down
            directions[axis] += forward
        angle = 1.0 / float(self.camera.focal[0].mean())
        return Rays(self.centre, directions, pixel.astype(np.uint64), angle)


def _through(camera: Cameras, pixel: NDArray[np.int64], off: Floats | float = 0.0) -> Floats:
    """Points (2, N) at depth 1 in the camera that pixels look through, `off` their centres."""
    row, column = np.divmod(pixel, int(camera.width[0]))
    places = np.stack([column, row]) + (0.5 + np.asarray(off))
    unit = back_project(camera, places.T[None])[0]
    return np.ascontiguousarray((unit[:, :2] / unit[:, 2:]).T)


def _surface_keys(mesh: Mesh, normal: Floats) -> NDArray[np.int32]:
    """Give each surface of a mesh a number, so that edges show where neighbours' numbers differ."""
    land = np.isin(mesh.material, _LAND)
    built = np.isin(mesh.material, _BUILT)
    side = np.where(built, np.rint(normal * 20.0), 0.0).astype(np.int64)
    parts = (np.where(land, 0, mesh.material + 1), np.where(land, 0, mesh.owner), *side)
    key = np.zeros(len(land), np.int64)
    for part, span in zip(parts, (8, 1 << 24, 64, 64, 64), strict=True):
        key = key * span + (part + span // 4)
    _, number = np.unique(key, return_inverse=True)
    return np.append(number, -1).astype(np.int32)


def edge_pixels(
    triangle: NDArray[np.int32], keys: NDArray[np.int32]
) -> tuple[NDArray[np.int64], Floats]:
    """Find pixels whose surface is another than that of a pixel to the side, above or below."""
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
