"""A world: a mesh, its colours, the rasters of its map, and its light.

All geometry is in metres of a local frame: x east, y north, z up, with the origin at the south-west
corner of the region and heights as in the surface model. Rasters have their first row in the north.

Each world is built once, into ``<root>/mini-worlds/<region>-<seed>/``, which appears whole or not
at all: ``dom.tif``, ``dsm.tif`` and ``satellite.tif`` for other programs, ``world.npz`` with all
arrays, and ``world.json``, which tells worlds apart.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rasterio import Affine

from airzoo_bench.core.files import atomic_folder, canonical_json, only_writer, sha256_of, write_npz
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.rasters import write_geotiff

CRS = "EPSG:4547"
SIDE_M = 600.0
# To be raised when the files change, or the world that a seed gives: older ones are made again.
FORMAT = 5
_INDEX = "world.json"


@dataclass(frozen=True)
class Region:
    """A square part of the world; west and south, in `CRS`, are its corner."""

    name: str
    west: float
    south: float
    side_m: float = SIDE_M


REGIONS = {
    "city": Region("city", 401_000.0, 3_120_000.0),
    "rural": Region("rural", 409_000.0, 3_128_000.0),
}


class Material(IntEnum):
    """The material of a triangle, which decides where its colour comes from."""

    GROUND = 0  # land and water inside the region: `World.ground`
    ROOF = 1  # `World.top`
    WALL = 2  # `World.walls`, by owner
    CANOPY = 3  # `World.leaves`, by owner
    TRUNK = 4
    APRON = 5  # land beyond the region: `World.top`, mirrored at the border


class Mesh(NamedTuple):
    """Triangles of a world, counter-clockwise as seen from outside."""

    vertices: Floats  # (V, 3): metres of the local frame
    triangles: NDArray[np.int32]  # (T, 3): rows of `vertices`
    material: NDArray[np.uint8]  # (T,): see `Material`
    # (T,): the building of a roof or wall, the tree of a canopy or trunk; -1 for land
    owner: NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class World:
    """One region: geometry, colours without light, and the rasters of its map."""

    region: Region
    seed: int
    mesh: Mesh
    # (B, 16): of buildings, their axes (x, y, cosine, sine) and half sizes along these; height of
    # the floor, of a storey, width of a bay, style of windows; albedo of walls and windows, 0 to 1
    walls: NDArray[np.float32]
    leaves: NDArray[np.int32]  # (trees, 3): albedo of canopies
    # (2400, 2400, 4): at 0.25 m, the albedo of the land, and 255 where water mirrors the sky
    ground: NDArray[np.uint8]
    top: NDArray[np.uint8]  # (2400, 2400, 4): of all that is seen from above, likewise
    # (1200, 1200): heights of what is seen from above at pixel centres, at 0.5 m
    dsm: NDArray[np.float32]
    # (2400, 2400, 3): the orthophoto, `top` in the survey's sun, with shadows
    dom: NDArray[np.uint8]
    # (2000, 2000, 3): the older mosaic at 0.3 m: another season, changed roofs, shifted
    satellite: NDArray[np.uint8]

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """All arrays by their names."""
        own = {name: part for name, part in vars(self).items() if isinstance(part, np.ndarray)}
        return own | self.mesh._asdict()


@dataclass(frozen=True)
class Light:
    """Sunlight and skylight.

    A surface of albedo ``a`` and outward unit normal ``n`` shows ``a * (sky + sun * max(0, n .
    direction) * visible)``, where ``visible`` is 1 in the sun and 0 in a cast shadow.
    """

    direction: tuple[float, float, float]  # unit vector to the sun: east, north, up
    sun: tuple[float, ...]  # factors of red, green and blue
    sky: tuple[float, ...]


# Directions are rational: of length 1, and the same on every machine without a sine.
# An early afternoon in summer: sun in the south-south-west, 52 degrees high.
SURVEY_SUN = Light((-6 / 19, -10 / 19, 15 / 19), (0.95, 0.90, 0.78), (0.30, 0.36, 0.46))
# A morning in winter: sun in the south-east, 39 degrees high, a paler light.
OLDER_SUN = Light((6 / 11, -6 / 11, 7 / 11), (1.02, 0.94, 0.80), (0.36, 0.40, 0.47))


def ensure_world(region: Region, seed: int, root: Path, build: Callable[[str, int], World]) -> Path:
    """Return the folder of a world, built now where it was not yet."""
    folder = root / "mini-worlds" / f"{region.name}-{seed}"
    index = folder / _INDEX
    with only_writer(folder.with_name(f".{folder.name}.lock"), wait=True):
        if not index.is_file() or index.read_text("utf-8") != _index_text(region, seed):
            save_world(folder, build(region.name, seed))
    return folder


def save_world(folder: Path, world: World) -> None:
    """Write a world to its folder, in place of an older one; the same world, the same bytes."""
    with atomic_folder(folder, replace=True, mark=_INDEX) as staged:
        for name in ("dom", "dsm", "satellite"):
            write_raster(staged / f"{name}.tif", getattr(world, name), world.region)
        write_npz(staged / "world.npz", world.arrays)
        (staged / _INDEX).write_text(_index_text(world.region, world.seed), "utf-8")


def _index_text(region: Region, seed: int) -> str:
    return canonical_json({"format": FORMAT, "region": asdict(region), "seed": seed}) + "\n"


def read_index(folder: Path) -> tuple[Region, int, str]:
    """Return a stored world's region, its seed, and a digest of all that its photos depend on."""
    index = json.loads((folder / _INDEX).read_bytes())
    return Region(**index["region"]), index["seed"], sha256_of(folder / _INDEX)


def load_world(folder: Path) -> World:
    """Load a stored world."""
    with np.load(folder / "world.npz", allow_pickle=False) as arrays:
        found = dict(arrays)
    mesh = Mesh(*(found.pop(name) for name in Mesh._fields))
    return World(*read_index(folder)[:2], mesh, **found)


def write_raster(path: Path, pixels: NDArray[Any], region: Region) -> None:
    """Write heights (N, N) float32 or colours (N, N, 3) uint8 of a region as GeoTIFF in `CRS`."""
    colours = pixels.ndim == 3
    bands = np.moveaxis(pixels, -1, 0) if colours else pixels[None]
    step = region.side_m / len(pixels)
    place = Affine(step, 0.0, region.west, 0.0, -step, region.south + region.side_m)
    kind: dict[str, Any] = {"photometric": "RGB"} if colours else {"nodata": -9999.0}
    write_geotiff(path, bands, crs=CRS, transform=place, interleave="pixel", **kind)
