"""What a world of AirZoo-Mini is made of: a mesh, its colours, and the rasters of its map.

All geometry is in metres of a local frame: x east, y north, z up, with the origin at the south-west
corner of the region and heights as in the surface model. Rasters have their first row in the north.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats

__all__ = ["CRS", "REGIONS", "Buildings", "Material", "Mesh", "Region", "World"]

CRS = "EPSG:4547"


@dataclass(frozen=True)
class Region:
    """Where a region of the world lies.

    Attributes
    ----------
    name : str
    west, south : float
        Its south-west corner in `CRS`.
    side_m : float
        It is a square.
    """

    name: str
    west: float
    south: float
    side_m: float

    @property
    def north(self) -> float:
        """The northing of its northern border."""
        return self.south + self.side_m


REGIONS = {
    region.name: region
    for region in (
        Region("city", 401_000.0, 3_120_000.0, 600.0),
        Region("rural", 409_000.0, 3_128_000.0, 600.0),
    )
}


class Material(IntEnum):
    """What a triangle is made of, which says where its colour comes from."""

    GROUND = 0  # land and water inside the region: `World.ground_albedo`
    ROOF = 1  # `World.top_albedo`
    WALL = 2  # `World.buildings`, by owner
    CANOPY = 3  # `World.tree_colours`, by owner
    TRUNK = 4
    APRON = 5  # land beyond the region: `World.top_albedo`, mirrored at the border


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles of a world, counter-clockwise as seen from outside.

    Attributes
    ----------
    vertices : (V, 3) float64
        Metres of the local frame.
    triangles : (T, 3) int32
        Rows of `vertices`.
    material : (T,) uint8
        See `Material`.
    owner : (T,) int32
        The building of a roof or wall, the tree of a canopy or trunk; -1 for land.
    """

    vertices: Floats
    triangles: NDArray[np.int32]
    material: NDArray[np.uint8]
    owner: NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Buildings:
    """How the walls of B buildings look.

    Attributes
    ----------
    wall_colour, window_colour : (B, 3) uint8
        Albedo.
    base_m : (B,) float64
        Height of the floor, from which storeys are counted.
    storey_m, bay_m : (B,) float64
        Height of a storey and width of a window's bay.
    style : (B,) uint8
        0 single windows, 1 bands of windows, 2 balconies, 3 no windows but a door (a barn).
    """

    wall_colour: NDArray[np.uint8]
    window_colour: NDArray[np.uint8]
    base_m: Floats
    storey_m: Floats
    bay_m: Floats
    style: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class World:
    """One region: geometry, colours without light, and the rasters of its map.

    Attributes
    ----------
    region : Region
    seed : int
    mesh : Mesh
    buildings : Buildings
    tree_colours : (trees, 3) uint8
        Albedo of canopies.
    ground_albedo, top_albedo : (2400, 2400, 3) uint8
        Without light, at 0.25 m: the land alone; and all that is seen from above.
    water : (2400, 2400) bool
        Where the land is water, which mirrors the sky.
    dsm : (1200, 1200) float32
        Heights of what is seen from above at the pixel centres, at 0.5 m.
    dom : (2400, 2400, 3) uint8
        The orthophoto at 0.25 m: `top_albedo` in the sun of the survey, with its shadows.
    satellite : (2000, 2000, 3) uint8
        The older mosaic at 0.3 m: another season and sun, changed roofs, blurred, shifted slightly.
    """

    region: Region
    seed: int
    mesh: Mesh
    buildings: Buildings
    tree_colours: NDArray[np.uint8]
    ground_albedo: NDArray[np.uint8]
    top_albedo: NDArray[np.uint8]
    water: NDArray[np.bool_]
    dsm: NDArray[np.float32]
    dom: NDArray[np.uint8]
    satellite: NDArray[np.uint8]
