"""Worlds kept on disk, so that each is built once.

::

    <root>/mini-worlds/<region>-<seed>/
        dom.tif, dsm.tif, satellite.tif   georeferenced, for other programs as well
        <array>.npy                       the mesh, and colours without light
        checksums.json                    which world it is, sizes and SHA-256 of the others

A folder appears whole or not at all (`files.atomic_folder`); what goes wrong afterwards, its
checksums tell, and it is made again.
"""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from airzoo_bench.benchmark.folder import DATA_VARIABLE
from airzoo_bench.core.errors import BenchmarkError, UsageError, UserError, first_of
from airzoo_bench.core.files import atomic_folder, canonical_json, sha256_of
from airzoo_bench.core.settings import Strict
from airzoo_bench.core.temporaries import temporary_folder
from airzoo_bench.mini.georaster import read_colours, read_heights, write_raster
from airzoo_bench.mini.lock import locked
from airzoo_bench.mini.world import Buildings, Mesh, Region, World

__all__ = ["FORMAT", "cached_world", "ensure_world", "load_world", "save_world", "world_folder"]

FORMAT = 1
"""To be raised when the files change, or the world that a seed gives: older ones are made again."""

_INDEX = "checksums.json"
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
_MEND = f"choose a folder you may write to, on a disk with room, set by {DATA_VARIABLE}"


class _File(Strict):
    bytes: int
    sha256: str


class _Place(Strict):
    name: str
    west: float
    south: float
    side_m: float


class _Index(Strict):
    format: int
    region: _Place
    seed: int
    files: dict[str, _File]


def world_folder(root: Path, region: Region, seed: int) -> Path:
    """Return where below a data root a world is kept."""
    return root / "mini-worlds" / f"{region.name}-{seed}"


def cached_world(
    region: Region,
    seed: int,
    root: Path,
    build: Callable[[str, int], World],
    note: Callable[[str], None],
) -> World:
    """Load a world, built now where it was not yet, or was damaged.

    Parameters
    ----------
    region : Region
    seed : int
    root : Path
        The data root.
    build : callable
        Takes the region's name and the seed.
    note : callable
        Takes a sentence for the user, about a world that is made again.

    Raises
    ------
    UsageError
        See `ensure_world`.
    """
    return load_world(ensure_world(region, seed, root, build, note))


def ensure_world(
    region: Region,
    seed: int,
    root: Path,
    build: Callable[[str, int], World],
    note: Callable[[str], None],
) -> Path:
    """Return the folder of a sound world, built now where it was not yet, or was damaged.

    Of processes that do so at once one builds the world, and the others wait for it.

    The parameters are those of `cached_world`.

    Raises
    ------
    UsageError
        The folder cannot be written, or holds something else, or the disk is full. The first two
        are found before the world is built.
    """
    folder = world_folder(root, region, seed)
    if _damage(folder, region, seed) is None:
        return folder
    _check_ours(folder)
    with _sole_maker(folder):
        damage = _damage(folder, region, seed)  # another may have made it meanwhile
        if damage is not None:
            if folder.exists():
                note(f"{damage}; it is made again")
            save_world(folder, build(region.name, seed))
    return folder


def save_world(folder: Path, world: World) -> None:
    """Write a world to its folder, in place of a damaged one.

    The same world gives the same bytes.

    Raises
    ------
    UsageError
        The folder cannot be written, is something else than a world, or the disk is full; nothing
        half made is left.
    """
    _clear(folder)
    try:
        with atomic_folder(folder) as temporary:
            _write_files(temporary, world)
            index = _index_of(temporary, world.region, world.seed)
            text = canonical_json(index.model_dump()) + "\n"
            (temporary / _INDEX).write_text(text, encoding="utf-8")
    except UserError as fault:
        raise UsageError(fault.what, where=folder, mend=_MEND) from fault


def load_world(folder: Path) -> World:
    """Load a world; its larger arrays are mapped, not read.

    Raises
    ------
    BenchmarkError
        It is not there, of another format, or a file was changed or is missing.
    """
    index = _read_index(folder)
    _verify(folder, index)
    arrays: dict[str, Any] = {name: _read_array(folder / f"{name}.npy") for name in _ARRAYS}
    parts = {
        part: kind(**{f.name: arrays[f"{part}.{f.name}"] for f in dataclasses.fields(kind)})
        for part, kind in _PARTS.items()
    }
    return World(
        region=Region(**index.region.model_dump()),
        seed=index.seed,
        dsm=read_heights(folder / "dsm.tif"),
        dom=read_colours(folder / "dom.tif"),
        satellite=read_colours(folder / "satellite.tif"),
        **{name: arrays[name] for name in _LOOSE},
        **parts,
    )


def _write_files(folder: Path, world: World) -> None:
    for name in _RASTERS:
        write_raster(folder / f"{name}.tif", getattr(world, name), world.region)
    for name in _ARRAYS:
        np.save(folder / f"{name}.npy", attrgetter(name)(world), allow_pickle=False)


def _index_of(folder: Path, region: Region, seed: int) -> _Index:
    files = {
        name: _File(bytes=(folder / name).stat().st_size, sha256=sha256_of(folder / name))
        for name in _FILES
    }
    place = _Place(**dataclasses.asdict(region))
    return _Index(format=FORMAT, region=place, seed=seed, files=files)


def _read_index(folder: Path) -> _Index:
    try:
        index = _Index.model_validate_json((folder / _INDEX).read_bytes())
    except FileNotFoundError as error:
        raise _damaged(folder, f"no world is kept here: it has no {_INDEX}") from error
    except (OSError, ValidationError) as error:
        raise _damaged(folder, f"{_INDEX} cannot be read") from error
    if index.format != FORMAT or sorted(index.files) != _FILES:
        raise _damaged(folder, "the world is of another format")
    return index


def _verify(folder: Path, index: _Index) -> None:
    """Hold every file to its size and checksum; SHA-256 takes some 0.6 s a gigabyte."""
    names = list(index.files)
    with ThreadPoolExecutor(2) as pool:
        sound = list(pool.map(lambda name: _is_sound(folder / name, index.files[name]), names))
    bad = [name for name, fine in zip(names, sound, strict=True) if not fine]
    if bad:
        raise _damaged(folder, f"files missing or changed: {first_of(bad, len(names))}")


def _is_sound(path: Path, file: _File) -> bool:
    try:
        return path.stat().st_size == file.bytes and sha256_of(path) == file.sha256
    except OSError:
        return False


def _damage(folder: Path, region: Region, seed: int) -> str | None:
    """Say what is wrong with a cached world; None where nothing is."""
    try:
        index = _read_index(folder)
        _verify(folder, index)
    except BenchmarkError as fault:
        return f"{folder}: {fault.what}"
    if (Region(**index.region.model_dump()), index.seed) != (region, seed):
        return f"{folder}: the world of another region or seed"
    return None


def _damaged(folder: Path, what: str) -> BenchmarkError:
    return BenchmarkError(what, where=folder, mend="remove the folder: it is made again when asked")


def _read_array(path: Path) -> NDArray[Any]:
    large = path.stat().st_size >= _MAPPED_BYTES
    return np.asarray(np.load(path, mmap_mode="r" if large else None, allow_pickle=False))


@contextmanager
def _sole_maker(folder: Path) -> Iterator[None]:
    """Hold the lock of a world; a folder that cannot be written is found before the work."""
    with ExitStack() as held:
        try:
            held.enter_context(locked(folder.parent / f".lock-{folder.name}"))
            with tempfile.TemporaryFile(dir=folder.parent):
                pass
        except OSError as error:
            reason = f"cannot be written: {error.strerror or error}"
            raise UsageError(reason, where=folder.parent, mend=_MEND) from error
        yield


def _check_ours(folder: Path) -> None:
    """Refuse to replace what was not made here: a file, or a folder with other content."""
    if not folder.exists() or (folder / _INDEX).is_file():
        return
    if not folder.is_dir() or any(folder.iterdir()):
        raise UsageError(
            "is not a kept world, and so is not replaced",
            where=folder,
            expected=f"a folder with {_INDEX}, or none",
            mend="move it elsewhere, or " + _MEND,
        )


def _clear(folder: Path) -> None:
    """Take a damaged world away."""
    _check_ours(folder)
    try:
        if folder.exists():
            with temporary_folder(folder.parent, folder.name) as away:
                # Moved first: who looks meanwhile finds no world, never half of one.
                folder.replace(away / "old")
    except OSError as error:
        reason = f"cannot be replaced: {error.strerror or error}"
        raise UsageError(reason, where=folder, mend=_MEND) from error
