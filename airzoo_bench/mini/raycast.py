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

from airzoo_bench.core.open3d_loader import load_open3d
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.mini.world import Mesh

__all__ = ["MISSED", "Planes", "Raycaster"]

MISSED = -1

# A ray that grazes a triangle within Embree's rounding of its edge may meet the plane far off the
# triangle; beyond this (m, and share of the distance) Embree's own distance is the better one.
_TRUST_M = 0.02
_TRUST_SHARE = 1e-4

# How far shadow rays start above their surface: above single precision at 1.5 km (0.1 mm).
_LIFT_M = 0.02


@dataclass(frozen=True, eq=False)
class Planes:
    """Planes of T triangles, n . X = offset.

    Attributes
    ----------
    normal : (3, T) float64
        Unit; 0 where a triangle has no area.
    offset : (T,) float64
    """

    normal: Floats
    offset: Floats

    @classmethod
    def of(cls, mesh: Mesh) -> Planes:
        """Return the planes of a mesh's triangles."""
        a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
        normal = np.cross(b - a, c - a)
        length = np.sqrt((normal * normal).sum(axis=1))
        unit = normal / np.where(length > 0.0, length, 1.0)[:, None]
        # Of three corners each has its own rounding; their middle keeps the plane from tilting.
        offset = (unit * (a + b + c)).sum(axis=1) / 3.0
        return cls(np.ascontiguousarray(unit.T), offset)


class Raycaster:
    """A mesh that rays can be cast at, on one thread (frames are spread over processes).

    Parameters
    ----------
    mesh : Mesh
    """

    def __init__(self, mesh: Mesh) -> None:
        open3d = load_open3d()
        self.planes = Planes.of(mesh)
        self._tensor: Any = open3d.core.Tensor.from_numpy
        self._scene: Any = open3d.t.geometry.RaycastingScene(nthreads=1)
        self._scene.add_triangles(
            self._tensor(np.ascontiguousarray(mesh.vertices, np.float32)),
            self._tensor(np.ascontiguousarray(mesh.triangles, np.uint32)),
        )
        self._count = len(mesh.triangles)

    def trace(self, origin: Floats, directions: Floats) -> tuple[NDArray[np.int64], Floats]:
        """Cast rays.

        Parameters
        ----------
        origin : (3,) or (3, N) array
            Where they start: all in one point, or each in its own.
        directions : (3, N) array
            Of any length, which is the unit of the distance; NaN for rays that there are not.

        Returns
        -------
        triangle : (N,) int64 array
            The first triangle met, `MISSED` where there is none.
        distance : (N,) array
            In lengths of the direction; 0 where nothing is met. With directions whose z in the
            camera is 1, the z-depth.
        """
        answer = self._cast(origin, directions)
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
        """Say from which points (3, N), lifted off their surface, something stands in the way.

        Parameters
        ----------
        points, normals : (3, N) arrays
            Unit normals, towards the side that is seen.
        direction : (3,) array
            The one direction to look in.
        """
        rays = np.empty((points.shape[1], 6), np.float32)
        np.add(points, normals * _LIFT_M, out=rays[:, :3].T, casting="same_kind")
        rays[:, 3:] = direction
        answer = self._scene.test_occlusions(self._tensor(rays), nthreads=1)
        blocked: Bools = answer.numpy()
        return blocked

    def _cast(self, origin: Floats, directions: Floats) -> Any:
        rays = np.empty((directions.shape[1], 6), np.float32)
        rays[:, :3] = origin.T
        rays[:, 3:] = directions.T
        lost = np.isnan(directions[0])
        if lost.any():
            # Embree does not say what a NaN does; any ray will do, its answer is not used.
            rays[lost, 3:] = 1.0
        return self._scene.cast_rays(self._tensor(rays), nthreads=1)

    def _to_planes(self, origin: Floats, directions: Floats, triangle: NDArray[np.int64]) -> Floats:
        normal, offset = self.planes.normal, self.planes.offset
        slope = np.zeros(len(triangle))
        height = offset.take(triangle)
        for axis in range(3):
            component = normal[axis].take(triangle)
            slope += component * directions[axis]
            height -= component * origin[axis]
        with np.errstate(divide="ignore", invalid="ignore"):
            distance: Floats = height / slope
        return distance
