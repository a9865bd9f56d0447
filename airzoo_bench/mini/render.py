"""Photos of a world with the depth of every pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras, back_project
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.mini.edges import edge_pixels, surface_keys
from airzoo_bench.mini.scene import Rays, Scene
from airzoo_bench.mini.sensor import BLOCK_PIXELS, from_stored, row_blocks, take_photo, to_stored
from airzoo_bench.mini.weather import Conditions, conditions
from airzoo_bench.mini.world import World

__all__ = [
    "MOST_PIXELS",
    "RENDERER_VERSION",
    "Frame",
    "Renderer",
    "check_size",
    "default_camera",
]

RENDERER_VERSION = 2
"""To be raised with every change that changes photos, so that older ones are rendered again."""

MOST_PIXELS = 64_000_000
"""The largest photo; rendering it takes some 1.8 GB."""

# Rays through the pixels are kept from one frame to the next where they are no more than this.
_KEPT_RAYS = 1 << 21

# A pixel beside another surface is its centre and, by a third, what lies a third of a pixel
# towards that surface: the mean of three rays in a row, the one away from the edge being taken to
# see what the centre sees.
_THIRD = 1 / 3


@dataclass(frozen=True, eq=False)
class Frame:
    """A photo and what it is of.

    Attributes
    ----------
    rgb : (H, W, 3) uint8
    depth : (H, W) float32
        Along the optical axis, metres; 0 where there is no surface.
    """

    rgb: NDArray[np.uint8]
    depth: NDArray[np.float32]


def default_camera(width: int = 640, height: int = 480, field_deg: float = 62.0) -> Cameras:
    """Return a pinhole of a horizontal field of view, its principal point in the middle."""
    focal = width / 2 / np.tan(np.radians(field_deg) / 2)
    K = [[[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]]]
    return Cameras.from_matrices(K, width, height)


def check_size(camera: Cameras) -> tuple[int, int]:
    """Return width and height of a camera's photos, refusing those that would not fit memory.

    Raises
    ------
    UsageError
        More than `MOST_PIXELS`.
    """
    width, height = int(camera.width[0]), int(camera.height[0])
    if width * height > MOST_PIXELS:
        raise UsageError(
            f"a photo of {width} x {height} pixels would not fit memory",
            where="resolution",
            expected=f"at most {MOST_PIXELS:,} pixels, such as 8000 x 6000",
            mend="ask for a smaller photo",
        )
    return width, height


class Renderer:
    """Takes photos of a world, one at a time on one thread.

    Parameters
    ----------
    world : World
    """

    def __init__(self, world: World) -> None:
        self._scene = Scene(world)
        self._keys = surface_keys(world.mesh, self._scene.normal)
        self._corner = np.array([world.region.west, world.region.south, 0.0])
        self._kept: tuple[bytes, Floats] | None = None

    def render(self, camera: Cameras, pose: Poses, weather: str, time: str, seed: int) -> Frame:
        """Take a photo.

        Parameters
        ----------
        camera : Cameras
            One camera.
        pose : Poses
            One pose, in `world.CRS` (easting, northing, height).
        weather, time : str
            See `weather.conditions`; they never change the depth.
        seed : int
            Of the noise and of rain and snow in the air.

        Returns
        -------
        Frame

        Raises
        ------
        UsageError
            More than `MOST_PIXELS`; an unknown weather or time; not one camera and one pose.
        """
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
            rays = view.rays(self._through_pixels(view.camera, rows), rows.start * width)
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
            beside = to_stored(self._scene.look(rays, given)[0])
            own = from_stored(light[:, pixel])
            light[:, pixel] = to_stored(own + (from_stored(beside) - own) * np.float32(_THIRD))

    def _through_pixels(self, camera: Cameras, rows: slice) -> Floats:
        """Return `_View.through` of whole rows, remembered from the frame before."""
        width, height = int(camera.width[0]), int(camera.height[0])
        if width * height > _KEPT_RAYS:
            return _through(camera, np.arange(rows.start * width, rows.stop * width))
        parts = (camera.width, camera.height, camera.focal, camera.principal_point)
        key = b"".join(part.tobytes() for part in (*parts, camera.distortion))
        if self._kept is None or self._kept[0] != key:
            self._kept = (key, _through(camera, np.arange(width * height)))
        return self._kept[1][:, rows.start * width : rows.stop * width]


@dataclass(frozen=True, eq=False)
class _View:
    """A camera at its place in the world's local frame."""

    camera: Cameras
    centre: Floats
    rotation: Floats

    def rays(self, xy: Floats, pixel: NDArray[np.int64] | int) -> Rays:
        """Rays along (x, y, 1) of the camera, of pixels by number or from a first one on."""
        directions = np.empty((3, xy.shape[1]))
        for axis in range(3):
            right, down, forward = self.rotation[:, axis]
            np.multiply(xy[0], right, out=directions[axis])
            directions[axis] += xy[1] * down
            directions[axis] += forward
        number = np.arange(pixel, pixel + xy.shape[1]) if isinstance(pixel, int) else pixel
        angle = 1.0 / float(self.camera.focal[0].mean())
        return Rays(self.centre, directions, number.astype(np.uint64), angle)


def _through(camera: Cameras, pixel: NDArray[np.int64], off: Floats | float = 0.0) -> Floats:
    """Points (2, N) at depth 1 in the camera that pixels look through, `off` their centres."""
    row, column = np.divmod(pixel, int(camera.width[0]))
    places = np.stack([column, row]) + (0.5 + np.asarray(off))
    unit = back_project(camera, places.T[None])[0]
    return np.ascontiguousarray((unit[:, :2] / unit[:, 2:]).T)
