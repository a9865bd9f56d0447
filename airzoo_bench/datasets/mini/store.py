"""Worlds kept on disk, so that each is built once.

::

    <root>/mini-worlds/<region>-<seed>/
        dom.tif, dsm.tif, satellite.tif   georeferenced, for other programs
        world.npz                         all arrays of the world
        checksums.json                    which world it is, and SHA-256 of the others

A folder appears whole or not at all; a later fault shows in its checksums, and it is made again.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rasterio import Affine
from rasterio.io import MemoryFile

from airzoo_bench.core.files import (
    atomic_folder,
    canonical_json,
    only_writer,
    sha256_of,
    write_npz,
)
from airzoo_bench.datasets.mini.model import CRS, Region, World
from airzoo_bench.datasets.mini.noise import hash_of, is_keyed

FORMAT = 3
"""To be raised when the files change, or the world that a seed gives: older ones are made again."""

_INDEX = "checksums.json"
_RASTERS = ("dom", "dsm", "satellite")
_FILES = ("world.npz", *(f"{name}.tif" for name in _RASTERS))
_NODATA = -9999.0
_PAUSE_S = 0.2


def world_folder(root: Path, region: Region, seed: int) -> Path:
    """Return where below a data root a world is kept."""
    # A key stands in no name; the number tells worlds of different keys apart.
    number = hash_of(seed, 0)[0] if is_keyed(seed) else seed
    return root / "mini-worlds" / f"{region.name}-{number}"


def ensure_world(region: Region, seed: int, root: Path, build: Callable[[str, int], World]) -> Path:
    """Return the folder of a sound world, built now where it was not yet, or was damaged."""
    folder = world_folder(root, region, seed)
    if not _is_sound(folder, region, seed):
        with sole_maker(folder):
            if not _is_sound(folder, region, seed):  # another may have made it meanwhile
                save_world(folder, build(region.name, seed))
    return folder


def save_world(folder: Path, world: World) -> None:
    """Write a world to its folder, in place of a damaged one; the same world, the same bytes."""
    with atomic_folder(folder, replace=True, mark=_INDEX) as staged:
        for name in _RASTERS:
            write_raster(staged / f"{name}.tif", getattr(world, name), world.region)
        write_npz(staged / "world.npz", world.arrays)
        files = {name: sha256_of(staged / name) for name in _FILES}
        index = {**_identity(world.region, world.seed), "files": files}
        (staged / _INDEX).write_text(canonical_json(index) + "\n", "utf-8")


def world_key(folder: Path) -> str:
    """Return the SHA-256 of all that a world's photos depend on."""
    return sha256_of(folder / _INDEX)


def world_region(folder: Path) -> Region:
    """Return the region of a stored world."""
    return Region(**json.loads((folder / _INDEX).read_bytes())["region"])


def load_world(folder: Path) -> World:
    """Load a world that `ensure_world` found sound."""
    index = json.loads((folder / _INDEX).read_bytes())
    with np.load(folder / "world.npz", allow_pickle=False) as arrays:
        return World.of_arrays(Region(**index["region"]), index["seed"], arrays)


def write_raster(path: Path, pixels: NDArray[Any], region: Region) -> None:
    """Write a region's raster as GeoTIFF with its place in `CRS`: the same pixels, the same bytes.

    It is of heights (H, W) float32, NaN where there is none, or of colours (H, W, 3) uint8.
    """
    if pixels.ndim == 2:
        bands = np.where(np.isnan(pixels), np.float32(_NODATA), pixels)[None]
        profile: dict[str, Any] = {"nodata": _NODATA}
    else:
        bands, profile = np.moveaxis(pixels, -1, 0), {"photometric": "RGB"}
    count, height, width = bands.shape
    step_x, step_y = region.side_m / width, region.side_m / height
    place = Affine(step_x, 0.0, region.west, 0.0, -step_y, region.north)
    profile |= {"crs": CRS, "transform": place, "interleave": "pixel"}
    profile |= {"driver": "GTiff", "dtype": pixels.dtype.name}
    # By way of memory: GDAL only logs a full disk, Python raises.
    with MemoryFile() as memory:
        with memory.open(count=count, height=height, width=width, **profile) as dataset:
            dataset.write(bands)
        path.write_bytes(memory.getbuffer())


def _identity(region: Region, seed: int) -> dict[str, Any]:
    return {"format": FORMAT, "region": asdict(region), "seed": seed}


def _is_sound(folder: Path, region: Region, seed: int) -> bool:
    try:
        index = json.loads((folder / _INDEX).read_bytes())
        files = {name: sha256_of(folder / name) for name in _FILES}
    except (OSError, ValueError):
        return False
    return bool(index == {**_identity(region, seed), "files": files})


@contextmanager
def sole_maker(folder: Path) -> Iterator[None]:
    """Wait until no other process makes a folder, and hold it, so that it is made once."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        while True:
            try:
                stack.enter_context(only_writer(folder))
                break
            except BlockingIOError:
                time.sleep(_PAUSE_S)
        yield
