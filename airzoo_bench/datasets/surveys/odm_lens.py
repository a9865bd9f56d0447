"""Cameras of OpenSfM, as OpenDroneMap writes them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from airzoo_bench.core.errors import CameraError
from airzoo_bench.datasets.surveys.lenses import Lens

__all__ = ["lens_of_camera"]


def lens_of_camera(camera: Mapping[str, Any], size: tuple[int, int], where: object) -> Lens:
    """Return matrix and distortion of an OpenSfM camera for a photo."""
    kind = str(camera.get("projection_type", "perspective"))
    keys = {
        "perspective": ("focal", "k1", "k2"),
        "simple_radial": ("focal_x", "focal_y", "c_x", "c_y", "k1"),
        "radial": ("focal_x", "focal_y", "c_x", "c_y", "k1", "k2"),
        "brown": ("focal_x", "focal_y", "c_x", "c_y", "k1", "k2", "p1", "p2", "k3"),
    }.get(kind)
    if keys is None:
        raise CameraError(
            f"its camera is {kind[:40]!r}",
            where=where,
            expected="perspective, simple_radial, radial or brown",
            fix="process the project with --camera-lens brown",
        )
    value = _numbers(camera, keys, where)
    _check_shape(camera, size, where)
    width, height = size
    longer = max(size)
    fx, fy = (longer * value.get(key, value.get("focal", 0.0)) for key in ("focal_x", "focal_y"))
    cx = value.get("c_x", 0.0) * longer + width / 2
    cy = value.get("c_y", 0.0) * longer + height / 2
    distortion = tuple(value.get(key, 0.0) for key in ("k1", "k2", "p1", "p2", "k3"))
    return [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]], distortion


def _numbers(camera: Mapping[str, Any], keys: tuple[str, ...], where: object) -> dict[str, float]:
    wrong = [key for key in keys if not isinstance(camera.get(key), int | float)]
    if wrong:
        raise CameraError(f"its camera lacks {', '.join(wrong)}", where=where)
    return {key: float(camera[key]) for key in keys}


def _check_shape(camera: Mapping[str, Any], size: tuple[int, int], where: object) -> None:
    if "width" not in camera or "height" not in camera:
        return
    value = _numbers(camera, ("width", "height"), where)
    stated = value["width"], value["height"]
    scale = max(size) / max(*stated, 1.0)
    if any(abs(side * scale - own) > 1.0 for side, own in zip(stated, size, strict=True)):
        raise CameraError(
            f"its camera is {stated[0]:g}x{stated[1]:g} px, a photo {size[0]}x{size[1]}",
            where=where,
            expected="photos of the camera's shape",
            fix="give --images of the photos that the project was made from",
        )
