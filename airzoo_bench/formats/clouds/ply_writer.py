"""Writing clouds as PLY: binary, float64, the same bytes for the same cloud."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.core.files import atomic_write
from airzoo_bench.formats.clouds.cloud import Cloud

__all__ = ["write_ply"]

_AXES = ("x", "y", "z")
_BANDS = ("red", "green", "blue")
_ROWS = 1 << 18


def write_ply(path: Path, cloud: Cloud) -> None:
    """Write a cloud, whole or not at all.

    Parameters
    ----------
    path : Path
    cloud : Cloud
        Coordinates are kept to the last bit; colours and confidence go along where there are any.

    Raises
    ------
    UserError
        The file cannot be written, or the disk is full.
    """
    layout = _layout(cloud)
    kinds = {"<f8": "double", "<f4": "float", "u1": "uchar"}
    lines = [f"property {kinds[kind]} {name}" for name, kind in layout]
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(cloud)}", *lines]
    with atomic_write(path) as stream:
        stream.write(("\n".join([*head, "end_header"]) + "\n").encode("ascii"))
        for start in range(0, len(cloud), _ROWS):
            stream.write(_rows(cloud, slice(start, start + _ROWS), layout).tobytes())


def _layout(cloud: Cloud) -> list[tuple[str, str]]:
    layout = [(name, "<f8") for name in _AXES]
    if cloud.colours is not None:
        layout += [(name, "u1") for name in _BANDS]
    if cloud.confidence is not None:
        layout.append(("confidence", "<f4"))
    return layout


def _rows(cloud: Cloud, part: slice, layout: list[tuple[str, str]]) -> np.ndarray[Any, Any]:
    points = cloud.points[part]
    rows = np.empty(len(points), dtype=layout)
    for axis, name in enumerate(_AXES):
        rows[name] = points[:, axis]
    if cloud.colours is not None:
        for band, name in enumerate(_BANDS):
            rows[name] = cloud.colours[part, band]
    if cloud.confidence is not None:
        rows["confidence"] = cloud.confidence[part]
    return rows
