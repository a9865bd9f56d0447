"""Worlds kept on disk, so that each is built once.

::

    <root>/mini-worlds/<region>-<seed>/
        dom.tif, dsm.tif, satellite.tif   georeferenced, for other programs as well
        <array>.npy                       the mesh, and colours without light
        checksums.json                    which world it is, and SHA-256 of the others

A folder appears whole or not at all (`files.atomic_folder`); what goes wrong afterwards, its
checksums tell, and it is made again.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from operator import attrgetter
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError
from rasterio import Affine
from rasterio.io import MemoryFile

from airzoo_bench.core.errors import BenchmarkError, UsageError, UserError, first_of
from airzoo_bench.core.files import (
    DATA_VARIABLE,
    atomic_folder,
    canonical_json,
    check_new_folder,
    sha256_of,
)
from airzoo_bench.core.validation import Strict
from airzoo_bench.datasets.mini.noise import hash_of, is_keyed
from airzoo_bench.datasets.mini.world.model import CRS, Buildings, Mesh, Region, World
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.rasters import read_rgb

FORMAT = 2
"""To be raised when the files change, or the world that a seed gives: older ones are made again."""

_INDEX = "checksums.json"
_NODATA = -9999.0
_RASTERS = ("dom", "dsm", "satellite")
_PARTS: dict[str, type[Any]] = {"mesh": Mesh, "buildings": Buildings}
_LOOSE = ("tree_colours", "ground_albedo", "top_albedo", "water")
_ARRAYS = (
    *_LOOSE,
    *(f"{part}.{f.name}" for part, kind in _PARTS.items() for f in dataclasses.fields(kind)),
)
_FILES = sorted((*(f"{name}.npy" for name in _ARRAYS), *(f"{name}.tif" for name in _RASTERS)))
# Smaller arrays are read, since to map one takes longer; and an empty one cannot be mapped.
_MAPPED_BYTES = 1 << 20
_FIX = f"choose a folder you may write to, on a disk with room, set by {DATA_VARIABLE}"


class _Index(Strict):
    format: int
    region: Region
    seed: int
    files: dict[str, str]


def world_folder(root: Path, region: Region, seed: int) -> Path:
    """Return where below a data root a world is kept."""
    # A key stands in no name; the number tells worlds of different keys apart.
    number = hash_of(seed, 0)[0] if is_keyed(seed) else seed
    return root / "mini-worlds" / f"{region.name}-{number}"


def ensure_world(
    region: Region,
    seed: int,
    root: Path,
    build: Callable[[str, int], World],
    note: Callable[[str], None],
) -> Path:
    """Return the folder of a sound world, built now where it was not yet, or was damaged."""
    folder = world_folder(root, region, seed)
    if _damage(folder, region, seed):
        with _sole_maker(folder):
            damage = _damage(folder, region, seed)  # another may have made it meanwhile
            if damage:
                check_new_folder(folder, replace=True, mark=_INDEX)
                if folder.exists():
                    note(f"{folder}: {damage}; it is made again")
                save_world(folder, build(region.name, seed))
    return folder


def save_world(folder: Path, world: World) -> None:
    """Write a world to its folder, in place of a damaged one; the same world, the same bytes."""
    try:
        with atomic_folder(folder, replace=True, mark=_INDEX) as staged:
            for name in _RASTERS:
                write_raster(staged / f"{name}.tif", getattr(world, name), world.region)
            for name in _ARRAYS:
                np.save(staged / f"{name}.npy", attrgetter(name)(world), allow_pickle=False)
            files = {name: sha256_of(staged / name) for name in _FILES}
            index = _Index(format=FORMAT, region=world.region, seed=world.seed, files=files)
            (staged / _INDEX).write_text(canonical_json(index.model_dump()) + "\n", "utf-8")
    except UserError as fault:
        raise UsageError(fault.what, where=folder, fix=_FIX) from fault


def load_world(folder: Path) -> World:
    """Load a world; its larger arrays are mapped, not read."""
    index = _read_index(folder)
    arrays: dict[str, Any] = {name: _read_array(folder / f"{name}.npy") for name in _ARRAYS}
    parts = {
        part: kind(**{f.name: arrays[f"{part}.{f.name}"] for f in dataclasses.fields(kind)})
        for part, kind in _PARTS.items()
    }
    return World(
        region=index.region,
        seed=index.seed,
        dsm=HeightField.read(folder / "dsm.tif").heights.astype(np.float32, copy=False),
        dom=read_rgb(folder / "dom.tif"),
        satellite=read_rgb(folder / "satellite.tif"),
        **{name: arrays[name] for name in _LOOSE},
        **parts,
    )


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


def _read_index(folder: Path) -> _Index:
    """Read which world a folder holds, and hold every file to its checksum."""
    try:
        index = _Index.model_validate_json((folder / _INDEX).read_bytes())
    except FileNotFoundError as error:
        raise _damaged(folder, f"no world is kept here: it has no {_INDEX}") from error
    except (OSError, ValidationError) as error:
        raise _damaged(folder, f"{_INDEX} cannot be read") from error
    if index.format != FORMAT or sorted(index.files) != _FILES:
        raise _damaged(folder, "the world is of another format")
    bad = []
    for name, digest in index.files.items():
        with suppress(OSError):
            if sha256_of(folder / name) == digest:
                continue
        bad.append(name)
    if bad:
        raise _damaged(folder, f"files missing or changed: {first_of(bad, len(_FILES))}")
    return index


def _damaged(folder: Path, what: str) -> BenchmarkError:
    return BenchmarkError(what, where=folder, fix="remove the folder: it is made again when asked")


def _damage(folder: Path, region: Region, seed: int) -> str:
    """Say what is wrong with a kept world; nothing where it is sound."""
    try:
        index = _read_index(folder)
    except BenchmarkError as fault:
        return fault.what
    return "" if (index.region, index.seed) == (region, seed) else "another region or seed"


def _read_array(path: Path) -> NDArray[Any]:
    large = path.stat().st_size >= _MAPPED_BYTES
    return np.asarray(np.load(path, mmap_mode="r" if large else None, allow_pickle=False))


@contextmanager
def _sole_maker(folder: Path) -> Iterator[None]:
    """Hold the lock of a world, so that processes at once build it once."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        stream = (folder.parent / f".lock-{folder.name}").open("ab")
    except OSError as error:
        reason = f"cannot be written: {error.strerror or error}"
        raise UsageError(reason, where=folder.parent, fix=_FIX) from error
    with stream:  # closing the file gives the lock back
        with suppress(OSError):
            _wait_for(stream)
        yield


if sys.platform == "win32":
    import msvcrt

    def _wait_for(stream: IO[bytes]) -> None:
        msvcrt.locking(stream.fileno(), msvcrt.LK_LOCK, 1)

else:
    import fcntl

    def _wait_for(stream: IO[bytes]) -> None:
        fcntl.flock(stream, fcntl.LOCK_EX)
