"""Rays against the mesh of a world: which triangle is met, how far, and what lies in shadow.

Embree, by Open3D, finds the triangle in single precision. The distance is then that to the
triangle's plane in double precision: exact for the ray as given, and the same wherever Embree's
own rounding would have put it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.optional_imports import load_open3d
from airzoo_bench.datasets.mini.noise import Singles
from airzoo_bench.datasets.mini.world.model import Mesh
from airzoo_bench.geometry.arrays import Bools, Floats

__all__ = ["MISSED", "Points", "Raycaster"]

MISSED = -1

# A ray that grazes a triangle within Embree's rounding of its edge may meet the plane far off the
# triangle; beyond this (m, and share of the distance) Embree's own distance is the better one.
_TRUST_M = 0.02
_TRUST_SHARE = 1e-4

# How far shadow rays start above their surface: above single precision at 1.5 km (0.1 mm).
_LIFT_M = 0.02

# A pixel that grazes a surface covers a long strip of it. Its colour is filtered to the geometric
# mean of the strip's sides, up to this: a little too sharp along, a little too soft across.
_MOST_SLANT = 4.0


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
        self._count = len(mesh.triangles)
        a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
        normal = np.cross(b - a, c - a)
        length = np.sqrt((normal * normal).sum(axis=1))
        unit = normal / np.where(length > 0.0, length, 1.0)[:, None]
        self.normal = np.ascontiguousarray(unit.T)
        # Of three corners each has its own rounding; their middle keeps the plane from tilting.
        self._offset = (unit * (a + b + c)).sum(axis=1) / 3.0

    def trace(self, origin: Floats, directions: Floats) -> tuple[NDArray[np.int64], Floats]:
        """Cast rays from one point (3,), or each from its own (3, N), in directions (3, N)."""
        rays = np.empty((directions.shape[1], 6), np.float32)
        rays[:, :3] = origin.T
        # Embree does not say what a NaN does; any ray will do, its answer is not used.
        rays[:, 3:] = np.nan_to_num(directions, nan=1.0).T
        answer = self._scene.cast_rays(self._tensor(rays), nthreads=1)
        triangle = answer["primitive_ids"].numpy().astype(np.int64)
        missed = (triangle >= self._count) | np.isnan(directions[0])
        triangle[missed] = MISSED
        rough = answer["t_hit"].numpy().astype(np.float64)
        distance = self._to_planes(origin, directions, triangle)
        with np.errstate(invalid="ignore"):
            off = ~(np.abs(distance - rough) <= _TRUST_M + _TRUST_SHARE * rough)
        np.copyto(distance, rough, where=off)
        distance[missed] = 0.0
        return triangle, distance

    def occluded(self, points: Floats, normals: Floats, direction: Floats) -> Bools:
        """Say from which points (3, N), lifted off their surface, something stands in the way."""
        rays = np.empty((points.shape[1], 6), np.float32)
        np.add(points, normals * _LIFT_M, out=rays[:, :3].T, casting="same_kind")
        rays[:, 3:] = direction
        blocked: Bools = self._scene.test_occlusions(self._tensor(rays), nthreads=1).numpy()
        return blocked

    def _to_planes(self, origin: Floats, directions: Floats, triangle: NDArray[np.int64]) -> Floats:
        slope = np.zeros(len(triangle))
        height = self._offset.take(triangle)
        for axis in range(3):
            component = self.normal[axis].take(triangle)
            slope += component * directions[axis]
            height -= component * origin[axis]
        with np.errstate(divide="ignore", invalid="ignore"):
            distance: Floats = height / slope
        return distance


@dataclass(frozen=True, eq=False)
class Points:
    """N points where rays of one camera meet surfaces."""

    xyz: Singles  # (3, N): metres of the world's local frame
    normal: Singles  # (3, N): unit, on the side that is seen
    view: Singles  # (3, N): unit direction from the camera
    distance: Singles  # (N,): metres from the camera
    footprint: Singles  # (N,): size of the pixel across the ray, metres
    dither: Singles  # (N,): in [0, 1), another one for each pixel
    material: NDArray[np.uint8]  # (N,)
    owner: NDArray[np.int32]  # (N,)
    triangle: NDArray[np.int64]  # (N,)

    def __len__(self) -> int:
        return len(self.distance)

    def take(self, index: NDArray[np.int64]) -> Points:
        """Return the points of these numbers."""
        return Points(*(values.take(index, axis=-1) for values in vars(self).values()))

    def made_of(self, *materials: int) -> NDArray[np.int64]:
        """Return the numbers of the points of some materials."""
        chosen: Any = self.material == materials[0]
        for other in materials[1:]:
            chosen |= self.material == other
        return np.flatnonzero(chosen)

    def facing(self) -> Singles:
        """Return the cosine of the angle between surface and line of sight, (N,)."""
        view, normal = self.view, self.normal
        cosine: Singles = view[0] * normal[0] + view[1] * normal[1] + view[2] * normal[2]
        return -cosine

    def texture_footprint(self) -> Singles:
        """Return the size of the pixel on the surface, (N,) metres."""
        shrink = np.sqrt(np.maximum(self.facing(), np.float32(1.0 / _MOST_SLANT)))
        return np.divide(self.footprint, shrink, dtype=np.float32)
