"""Cameras from pixels, millimetres, a field of view or EXIF, and rotations from three angles.

Angles are in the conventions that tables of poses use:

``gimbal``
    DJI's yaw, pitch, roll of the camera; pitch -90 is nadir (see `geometry.poses`).
``airframe``
    Yaw, pitch, roll of the body, z-y-x in north-east-down, with the camera fixed below it: at 0, 0,
    0 it looks straight down and the top of the photo is north. Metashape and Pix4D write these.
``omega-phi-kappa``
    R = Rx(omega) Ry(phi) Rz(kappa) takes photogrammetric camera axes (x right, y up, z backward) to
    the grid (x east, y north, z up). At 0, 0, 0 the camera looks straight down with north up, and
    kappa turns it counter-clockwise. R is the transpose of M = M(kappa) M(phi) M(omega) in Wolf,
    Dewitt and Wilkinson, Elements of Photogrammetry, 4th edition, 2014, appendix C.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.core.errors import BenchmarkError, CameraError, readable
from airzoo_bench.core.files import read_text
from airzoo_bench.core.validation import nearest
from airzoo_bench.datasets.settings import Convention
from airzoo_bench.formats.photos import open_photo
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import angles_to_rotations

Lens = tuple[Any, Sequence[float]]
"""A camera's matrix in pixels, and the first of k1 k2 p1 p2 k3."""
_DISTORTION = ("k1", "k2", "p1", "p2", "k3")
LENS_KEYS = ("fx", "fy", "cx", "cy", *_DISTORTION, "focal_mm", "sensor_mm", "fov_deg")
"""What a camera may be stated by, in a file or in columns of a table."""
_EXPECTED = (
    "one of fx (px); focal_mm and sensor_mm (width of the sensor); fov_deg (across the width)"
)
_EXIF_IFD, _FOCAL_35MM = 0x8769, 0xA405
_DIAGONAL_MM = math.hypot(36.0, 24.0)
_MOST_RATIO = 1.3  # between two focal lengths of one camera


def read_camera_file(path: Path) -> dict[str, float]:
    """Read a camera from JSON: an object of numbers."""
    text = read_text(path, BenchmarkError, "camera file")
    with readable(path, "no camera as JSON", kind=BenchmarkError, expected=_EXPECTED):
        return {str(key): float(value) for key, value in json.loads(text).items()}


def lens_of(values: Mapping[str, float], size: tuple[int, int], where: object) -> Lens:
    """Return a camera's matrix and distortion."""
    (width, height), known = size, [*LENS_KEYS, "width", "height"]
    strange = next((key for key in values if key not in known), None)
    if strange is not None:
        what = f"the camera has an unknown key {strange[:40]!r}{nearest(strange, known)}"
        raise CameraError(what, where=where, expected=_EXPECTED)
    stated = (values.get("width", float(width)), values.get("height", float(height)))
    if stated != (float(width), float(height)):
        what = f"the camera is for photos of {stated[0]:g}x{stated[1]:g} px, not {width}x{height}"
        raise CameraError(what, where=where, fix="give the camera for the photos' own size")
    fx, ways = values.get("fx", math.nan), [{"fx"}, {"focal_mm", "sensor_mm"}, {"fov_deg"}]
    if values.get("sensor_mm", 0.0) > 0.0:
        fx = values.get("focal_mm", math.nan) / values["sensor_mm"] * width
    if 0.0 < values.get("fov_deg", 0.0) < 180.0:
        fx = width / 2 / math.tan(math.radians(values["fov_deg"]) / 2)
    if not fx > 0.0 or values.keys() & set().union(*ways) not in ways:
        given = ", ".join(f"{key} {values[key]:g}" for key in LENS_KEYS if key in values)
        what = f"the focal length does not follow from {given or 'nothing'}"
        raise CameraError(what, where=where, expected=_EXPECTED)
    fy, cx, cy = values.get("fy", fx), values.get("cx", width / 2), values.get("cy", height / 2)
    distortion = tuple(values.get(key, 0.0) for key in _DISTORTION)
    return [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]], distortion


def cameras_of_lenses(
    lenses: Sequence[Lens], names: Sequence[str], sizes: Mapping[str, tuple[int, int]]
) -> Cameras:
    """Return the cameras of photos, each with its lens."""
    width, height = np.array([sizes[name] for name in names]).T
    matrices = np.array([matrix for matrix, _ in lenses], np.float64)
    distortion = np.zeros((len(lenses), len(_DISTORTION)))
    for row, (_, values) in zip(distortion, lenses, strict=True):
        row[: len(values)] = values
    return Cameras.from_matrices(matrices, width, height, distortion, names=names)


def stated_cameras(
    values: Mapping[str, Mapping[str, float]],
    sizes: Mapping[str, tuple[int, int]],
    images: Path,
    where: object,
) -> Cameras:
    """Return the cameras of photos by their stated values; fx is compared with EXIF.

    It is not where the camera states the size of its photos.
    """
    for name, one in values.items():
        if "fx" not in one or {"width", "cx"} & set(one):
            continue
        film, (width, height) = film_focal_px(images / name, sizes[name])[0], sizes[name]
        if film is not None and not are_alike(one["fx"], film):
            what = f"fx is {one['fx']:g} px, and the focal length of 35 mm film makes {film:g} px "
            what += f"in a photo of {width}x{height} px, {name}"
            fix = f'scale fx to the photos; if it is right, add "width": {width} and "height": '
            raise CameraError(what, where=where, fix=f"{fix}{height} to the camera")
    lenses = [lens_of(one, sizes[name], where) for name, one in values.items()]
    return cameras_of_lenses(lenses, list(values), sizes)


def are_alike(first: float, second: float) -> bool:
    """Return whether two focal lengths may belong to one camera."""
    return 1 / _MOST_RATIO < first / second < _MOST_RATIO


def film_focal_px(path: Path, size: tuple[int, int]) -> tuple[float | None, int]:
    """Return the focal length of 35 mm film, of the same diagonal, in pixels and in mm."""
    with open_photo(path) as image:
        focal = image.getexif().get_ifd(_EXIF_IFD).get(_FOCAL_35MM)
    if not isinstance(focal, int) or not 0 < focal < 10_000:
        return None, 0
    return focal / _DIAGONAL_MM * math.hypot(*size), focal


# --- rotations from three angles ---

# Rows of a camera that looks ahead, to those of one fixed below the same body: its right stays, its
# down is the body's tail, its forward the body's down.
_BELOW = np.array([(1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)])


def attitudes_to_rotations(
    convention: Convention, angles_deg: ArrayLike, *, convergence_deg: ArrayLike
) -> Floats:
    """Turn angles (..., 3) into world-to-camera rotations (..., 3, 3)."""
    angles = np.moveaxis(np.asarray(angles_deg, dtype=np.float64), -1, 0)
    if convention != "omega-phi-kappa":
        ahead = angles_to_rotations(*angles, convergence_deg=convergence_deg)
        return ahead if convention == "gimbal" else _BELOW @ ahead
    (so, co), (sp, cp), (sk, ck) = ((np.sin(a), np.cos(a)) for a in np.radians(angles))
    right = (cp * ck, co * sk + so * sp * ck, so * sk - co * sp * ck)
    up = (-cp * sk, co * ck - so * sp * sk, so * ck + co * sp * sk)
    backward = (sp, -so * cp, co * cp)
    down, forward = (tuple(-part for part in axis) for axis in (up, backward))
    rotations = np.moveaxis(np.array((right, down, forward)), (0, 1), (-2, -1))
    return rotations @ grid_to_true_north(convergence_deg)


def grid_to_true_north(convergence_deg: ArrayLike) -> Floats:
    """Return the turn from the grid's axes to true east and north, (..., 3, 3)."""
    turn = np.radians(np.asarray(convergence_deg, dtype=np.float64))
    sine, cosine, zero = np.sin(turn), np.cos(turn), np.zeros_like(turn)
    rows = ((cosine, sine, zero), (-sine, cosine, zero), (zero, zero, np.ones_like(turn)))
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))
