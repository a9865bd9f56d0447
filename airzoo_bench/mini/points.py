"""Where rays meet surfaces, as arrays that shading works on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.mini.pixel_noise import Singles

__all__ = ["Points"]

# A pixel that grazes a surface covers a long strip of it. Its colour is filtered to the geometric
# mean of the strip's sides, up to this: a little too sharp along, a little too soft across.
_MOST_SLANT = 4.0


@dataclass(frozen=True, eq=False)
class Points:
    """N points on surfaces, as seen from one camera.

    Attributes
    ----------
    xyz : (3, N) float32
        Metres of the world's local frame.
    normal : (3, N) float32
        Unit, on the side that is seen.
    view : (3, N) float32
        Unit direction from the camera.
    distance : (N,) float32
        Metres from the camera.
    footprint : (N,) float32
        Size of the pixel across the ray, metres.
    dither : (N,) float32
        In [0, 1), another one for each pixel.
    material : (N,) uint8
    owner : (N,) int32
    triangle : (N,) int64
    """

    xyz: Singles
    normal: Singles
    view: Singles
    distance: Singles
    footprint: Singles
    dither: Singles
    material: NDArray[np.uint8]
    owner: NDArray[np.int32]
    triangle: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.distance)

    def take(self, index: NDArray[np.int64]) -> Points:
        """Return the points of these numbers."""
        return Points(
            xyz=self.xyz.take(index, axis=1),
            normal=self.normal.take(index, axis=1),
            view=self.view.take(index, axis=1),
            distance=self.distance.take(index),
            footprint=self.footprint.take(index),
            dither=self.dither.take(index),
            material=self.material.take(index),
            owner=self.owner.take(index),
            triangle=self.triangle.take(index),
        )

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
        least = np.float32(1.0 / _MOST_SLANT)
        shrink = np.sqrt(np.maximum(self.facing(), least))
        return np.divide(self.footprint, shrink, dtype=np.float32)
