"""Depth maps from anywhere: found by the photo's name, checked for size before they are read.

A depth map is a ``.tif``, ``.npy``, ``.npz`` or 16-bit ``.png`` of the size of its photo. Where
depths are zero, negative, NaN, infinite or the file's nodata, there is no depth.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import (
    BenchmarkError,
    PredictionError,
    RasterError,
    UsageError,
    counted,
    first_of,
)
from airzoo_bench.formats.npz import NpzFile, read_header

__all__ = ["SUFFIXES", "DepthKind", "find_depths", "read_depth"]

SUFFIXES = (".tif", ".tiff", ".npy", ".npz", ".png")
"""Endings of files that are depth maps, in lower case."""

Depths = NDArray[np.float32]

_BYTES_OF_A_DEPTH = 8
_FIELD = "depth"


class DepthKind(StrEnum):
    """What a depth is."""

    Z = "z"
    """Along the optical axis."""
    RAY = "ray"
    """From the camera's centre along the ray of the pixel."""


def find_depths(folder: Path, images: Sequence[str]) -> tuple[Path | None, ...]:
    """Find the depth map of each photo: its name with another ending, in its own subfolder."""
    if not folder.is_dir():
        raise UsageError(
            "no such folder of depth maps",
            where=folder,
            fix="put the depth maps there, or name their folder with --depth",
        )
    there: dict[str, list[Path]] = {}
    for path in sorted(folder.rglob("*")):
        if path.suffix.lower() in SUFFIXES and path.is_file():
            stem = path.relative_to(folder).with_suffix("").as_posix()
            there.setdefault(stem, []).append(path)
    found = [there.get(Path(name).with_suffix("").as_posix(), []) for name in images]
    twice = [paths[1] for paths in found if len(paths) > 1]
    if twice:
        raise BenchmarkError(
            f"photos with more than one depth map: {first_of(twice, len(images))}",
            where=folder,
            fix="keep one of each",
        )
    if not any(found):
        raise BenchmarkError(
            f"holds no depth map of any of {counted(len(images), 'photo')}",
            where=folder,
            expected=f"such as {Path(images[0]).with_suffix('').as_posix()}.tif "
            f"({', '.join(SUFFIXES)})",
        )
    return tuple(paths[0] if paths else None for paths in found)


def read_depth(path: Path, width: int, height: int, scale_m: float | None = None) -> Depths:
    """Read a depth map."""
    readers = {".npy": _read_npy, ".npz": _read_npz}
    stored, nodata = readers.get(path.suffix.lower(), _read_raster)(path, (height, width))
    if stored.dtype.kind in "iu" and scale_m is None:
        raise BenchmarkError(
            f"holds whole numbers ({stored.dtype}) of unknown unit",
            where=path,
            expected="metres as float32, or a scale",
            fix="add --depth-scale, such as 0.001 for millimetres",
        )
    scale = 1.0 if scale_m is None else scale_m
    with np.errstate(over="ignore", invalid="ignore"):
        depth = (stored * scale).astype(np.float32)
        there = (depth > 0.0) & np.isfinite(depth)
    if nodata is not None:
        there &= stored != nodata
    return np.where(there, depth, np.float32(np.nan))


def _read_raster(path: Path, shape: tuple[int, int]) -> tuple[NDArray[Any], float | None]:
    from airzoo_bench.geometry.rasters import opened

    try:
        with opened(path) as dataset:
            if dataset.count != 1:
                raise BenchmarkError(
                    f"has {dataset.count} bands", where=path, expected="one band of depths"
                )
            _check_type(np.dtype(dataset.dtypes[0]), path)
            _check_size((dataset.height, dataset.width), shape, path)
            return dataset.read(1), dataset.nodata
    except RasterError as error:
        raise _damaged(path, error.what) from error


def _read_npy(path: Path, shape: tuple[int, int]) -> tuple[NDArray[Any], None]:
    try:
        with path.open("rb") as stream:
            header, start = read_header(stream), stream.tell()
    except ValueError as error:
        raise _damaged(path, f"is not a .npy file: {str(error)[:200]}") from error
    _check_type(header.dtype, path)
    _check_size(header.shape, shape, path)
    if path.stat().st_size < start + shape[0] * shape[1] * header.dtype.itemsize:
        raise _damaged(path, "ends before its depths do")
    order: Literal["C", "F"] = "F" if header.fortran_order else "C"
    stored = np.memmap(path, header.dtype, "r", start, header.shape, order)
    return stored.reshape(shape), None


def _read_npz(path: Path, shape: tuple[int, int]) -> tuple[NDArray[Any], None]:
    try:
        file = NpzFile(path, limit_bytes=_BYTES_OF_A_DEPTH * shape[0] * shape[1])
        name = _depth_field(file)
        _check_type(file.entries[name].dtype, path)
        _check_size(file.entries[name].shape, shape, path)
        return file.read(name).reshape(shape), None
    except PredictionError as error:
        raise _damaged(path, error.what) from error


def _depth_field(file: NpzFile) -> str:
    names = list(file.entries)
    if _FIELD not in names and len(names) != 1:
        raise BenchmarkError(
            f"has no array {_FIELD!r} among {first_of(names)}",
            where=file.path,
            expected=f"an array {_FIELD!r}, or one array only",
        )
    return _FIELD if _FIELD in names else names[0]


def _check_type(dtype: np.dtype[Any], path: Path) -> None:
    sound = dtype.kind == "f" or (dtype.kind in "iu" and dtype.itemsize > 1)
    if not sound or dtype.itemsize > _BYTES_OF_A_DEPTH:
        raise BenchmarkError(
            f"depths are {dtype}",
            where=path,
            expected="float32 metres, or 16-bit whole numbers with a scale",
            fix="8 bits, and colours, are pictures of depth, not depth",
        )


def _check_size(have: tuple[int, ...], want: tuple[int, int], path: Path) -> None:
    """Refuse a size other than the photo's; axes of length 1 do not count."""
    if tuple(n for n in have if n != 1) != tuple(n for n in want if n != 1):
        size = " x ".join(str(n) for n in reversed(have)) or "0"
        turned = have == want[::-1]
        raise BenchmarkError(
            f"the depth map is {size} px, the camera {want[1]} x {want[0]} px",
            where=path,
            expected="a depth for each pixel of the photo, rows before columns",
            fix="transpose it: rows and columns are swapped"
            if turned
            else "render it at the photo's size, or use the photos that it belongs to",
        )


def _damaged(path: Path, what: str) -> BenchmarkError:
    return BenchmarkError(
        what,
        where=path,
        expected="a depth map: " + ", ".join(SUFFIXES),
        fix="write or copy the file again",
    )
