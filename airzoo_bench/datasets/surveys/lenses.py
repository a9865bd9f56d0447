"""A camera from what people know of it: pixels, millimetres, or its field of view."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.core.errors import BenchmarkError, CameraError
from airzoo_bench.core.files import read_text
from airzoo_bench.core.validation import nearest, unambiguous_json
from airzoo_bench.geometry.cameras import Cameras

__all__ = [
    "LENS_KEYS",
    "Lens",
    "cameras_of_lenses",
    "focal_of_unknown_size",
    "lens_of",
    "read_camera_file",
]

Lens = tuple[list[list[float]], tuple[float, ...]]
"""A camera's matrix in pixels, and k1 k2 p1 p2 k3."""

_WAYS = (("fx",), ("focal_mm", "sensor_mm"), ("fov_deg",))
_DISTORTION = ("k1", "k2", "p1", "p2", "k3")
LENS_KEYS = ("fx", "fy", "cx", "cy", *_DISTORTION, "focal_mm", "sensor_mm", "fov_deg")
"""What a camera may be told by, in a file or in columns of a table."""
_SIZE = ("width", "height")
_EXPECTED = (
    "one of fx (px); focal_mm and sensor_mm (width of the sensor); fov_deg (across the width)"
)


def read_camera_file(path: Path) -> dict[str, float]:
    """Read a camera from JSON: an object of numbers."""
    text = read_text(path, BenchmarkError, "camera file")
    try:
        values: Any = unambiguous_json(text)
    except ValueError as error:
        raise BenchmarkError(f"not JSON: {error}", where=path, expected=_EXPECTED) from error
    known = [*LENS_KEYS, *_SIZE]
    if not isinstance(values, dict) or not values:
        raise BenchmarkError("is no object with values", where=path, expected=_EXPECTED)
    for key, value in values.items():
        if key not in known:
            raise BenchmarkError(
                f"unknown key {key[:40]!r}{nearest(key, known)}",
                where=path,
                expected=f"some of {', '.join(known)}",
            )
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise BenchmarkError(f"{key} is {str(value)[:40]!r}", where=path, expected="a number")
    return {key: float(value) for key, value in values.items()}


def lens_of(values: Mapping[str, float], size: tuple[int, int], where: object) -> Lens:
    """Return a camera's matrix and distortion."""
    width, height = size
    of_width, of_height = values.get("width", width), values.get("height", height)
    if of_width != width or of_height != height:
        raise CameraError(
            f"the camera is for photos of {of_width:g}x{of_height:g} px, not {width}x{height}",
            where=where,
            fix="give the camera for the photos' own size",
        )
    fx = _focal_px(values, width, where)
    fy = values.get("fy", fx)
    cx, cy = values.get("cx", width / 2), values.get("cy", height / 2)
    distortion = tuple(values.get(key, 0.0) for key in _DISTORTION)
    return [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]], distortion


def cameras_of_lenses(
    lenses: Sequence[Lens], names: Sequence[str], sizes: Mapping[str, tuple[int, int]]
) -> Cameras:
    """Return the cameras of photos, each with its lens."""
    width, height = np.array([sizes[name] for name in names]).T
    matrices, distortion = (np.array([lens[i] for lens in lenses]) for i in (0, 1))
    return Cameras.from_matrices(matrices, width, height, distortion, names=names)


def focal_of_unknown_size(
    values: Sequence[Mapping[str, float]], names: Sequence[str]
) -> dict[str, float]:
    """Return the photos' fx where neither size nor principal point says of which size it is."""
    return {
        name: one["fx"]
        for name, one in zip(names, values, strict=True)
        if "fx" in one and not ({"width", "cx"} & set(one))
    }


def _focal_px(values: Mapping[str, float], width: int, where: object) -> float:
    ways = [way for way in _WAYS if way[0] in values]
    if len(ways) != 1 or not set(ways[0]) <= set(values):
        given = ", ".join(key for key in LENS_KEYS if key in values) or "nothing"
        raise CameraError(
            f"the focal length does not follow from {given}", where=where, expected=_EXPECTED
        )
    way = ways[0][0]
    first = values[way]
    if way == "fx":
        return first
    if way == "fov_deg":
        if not 0.0 < first < 180.0:
            raise CameraError(
                f"fov_deg is {first:g}", where=where, expected="between 0 and 180 degrees"
            )
        return width / 2 / math.tan(math.radians(first) / 2)
    if not values["sensor_mm"] > 0.0:
        raise CameraError(f"sensor_mm is {values['sensor_mm']:g}", where=where, expected="above 0")
    return first / values["sensor_mm"] * width
