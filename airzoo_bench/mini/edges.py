"""Where in an image one surface ends and another begins: the pixels worth looking at twice."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.mini.world import Material, Mesh

__all__ = ["edge_pixels", "surface_keys"]

_LAND = (Material.GROUND, Material.APRON)
_BUILT = (Material.ROOF, Material.WALL)


def surface_keys(mesh: Mesh, normal: Floats) -> NDArray[np.int32]:
    """Give each surface of a mesh a number, so that edges show where neighbours' numbers differ.

    All land is one surface, each tree is one, and so is each side of a building.

    Parameters
    ----------
    mesh : Mesh
    normal : (3, T) array
        Of its triangles.

    Returns
    -------
    (T + 1,) int32 array
        By triangle; the last is of rays that meet none.
    """
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
    """Find pixels whose surface is another than that of a pixel beside, above or below.

    Parameters
    ----------
    triangle : (H, W) int32 array
        What each pixel sees, -1 where nothing.
    keys : (T + 1,) int32 array
        See `surface_keys`.

    Returns
    -------
    pixel : (E,) int64 array
        Flat indices.
    towards : (2, E) array
        The step (right, down) of -1, 0 or 1 to where the other surface is; to the right where
        there are others on opposite sides.
    """
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
