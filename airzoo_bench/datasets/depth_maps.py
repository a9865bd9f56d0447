"""Depth maps in files: ``.tif``, ``.npy``, ``.npz`` or 16-bit ``.png`` of the size of their photo.

Where depths are zero, negative, NaN, infinite or the file's nodata, there is no depth.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import BenchmarkError, UsageError, readable
from airzoo_bench.geometry.rasters import opened

_SUFFIXES = (".tif", ".tiff", ".npy", ".npz", ".png")


def find_depths(folder: Path, images: Sequence[str]) -> tuple[Path | None, ...]:
    """Find the depth map of each photo: its name with another ending, in its own subfolder."""
    stems = [folder / Path(name).with_suffix("") for name in images]
    files = [path for path in sorted(folder.rglob("*")) if path.suffix.lower() in _SUFFIXES]
    there = {path.with_suffix(""): path for path in files}
    found = tuple(there.get(stem) for stem in stems)
    if not any(found) or len(there) < len(files):
        what = "photos have no depth map, or more than one"
        expected = f"one such as {stems[0].name}.tif a photo ({', '.join(_SUFFIXES)})"
        raise UsageError(what, where=folder, expected=expected, fix="name its folder with --depth")
    return found


def read_depth(
    path: Path, width: int, height: int, scale_m: float | None = None
) -> NDArray[np.float32]:
    """Read a depth map in metres, NaN where there is none."""
    nodata = None
    with readable(path, "is no depth map", kind=BenchmarkError, expected=", ".join(_SUFFIXES)):
        if path.suffix.lower() in (".npy", ".npz"):
            stored = np.load(path, allow_pickle=False)
            if path.suffix.lower() == ".npz":
                stored = stored["depth" if "depth" in stored else stored.files[0]]
        else:
            with opened(path) as dataset:
                stored, nodata = dataset.read(), dataset.nodata
    stored = stored.squeeze()
    unknown_unit = stored.dtype.kind in "iu" and not scale_m
    if stored.shape != (height, width) or stored.dtype.itemsize == 1 or unknown_unit:
        raise BenchmarkError(
            f"holds {stored.dtype} of {' x '.join(map(str, stored.shape[::-1]))}",
            where=path,
            expected=f"{width} x {height} depths: metres as float32, or 16-bit whole numbers with "
            "their unit (--depth-scale, such as 0.001 for millimetres)",
        )
    with np.errstate(over="ignore", invalid="ignore"):
        depth = (stored * (1.0 if scale_m is None else scale_m)).astype(np.float32)
        there = (depth > 0.0) & np.isfinite(depth)
    if nodata is not None:
        there &= stored != nodata
    return np.where(there, depth, np.float32(np.nan))
