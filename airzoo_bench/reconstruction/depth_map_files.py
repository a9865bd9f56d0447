"""Depth and point maps with cameras from npz files, as VGGT, DUSt3R and MapAnything give them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import CameraError, PredictionError
from airzoo_bench.formats.arrays import Arrays, check_fields, numbers, open_arrays, texts
from airzoo_bench.formats.clouds.cloud import FileCloud
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.reconstruction.cloud_sources import DepthMaps, PointMaps
from airzoo_bench.reconstruction.image_poses import (
    BYTES_A_CAMERA,
    CAMERA_FIELDS,
    ImagePoses,
    camera_fault,
    check_count,
    field_fault,
    image_poses,
)
from airzoo_bench.reconstruction.maps import FloatMaps
from airzoo_bench.reconstruction.view_plausibility import refuse_other_resolution

__all__ = ["ScenePrediction", "holds_maps", "maps_of", "read_maps"]

_DEPTH = "depth"
_POINTS = ("world_points", "points")
_CONFIDENCE = ("conf", "confidence")
_COLOURS = ("colours", "colors", "image")
_NAMES = "image_names"
_CENTRES = "pixel_centres"
_HALF_A_PIXEL = {"half": 0.0, "integer": 0.5}
_BYTES_A_PIXEL = 96  # depth and surface in double precision, their places, rays and points
_EXPECTED = (
    "depth (N, H, W) or world_points (N, H, W, 3), intrinsics (N, 3, 3), extrinsics (N, 3, 4) or "
    "(N, 4, 4) world-to-camera, image_names (N,), and perhaps conf (N, H, W), colours (N, H, W, "
    "3), pixel_centres ('half' or 'integer')"
)


@dataclass(frozen=True, eq=False)
class ScenePrediction:
    """What a method wrote of a scene.

    Attributes
    ----------
    geometry : FileCloud, DepthMaps or PointMaps
        Depth maps of all views, those without a pose included.
    images : ImagePoses or None
        Of the views themselves, or from a file of cameras.
    notes : tuple of str
        What looks odd and need not be wrong.
    pixel_centres : str or None
        As the file states it: ``half`` or ``integer``; None where it does not. Then they are taken
        to be ``half`` where images are named, ``integer`` where they are not.
    """

    geometry: FileCloud | DepthMaps | PointMaps
    images: ImagePoses | None
    notes: tuple[str, ...] = ()
    pixel_centres: str | None = None

    @property
    def posed_geometry(self) -> FileCloud | DepthMaps | PointMaps:
        """The geometry, without depth maps of views that have no pose: these are nowhere."""
        if not isinstance(self.geometry, DepthMaps) or self.images is None:
            return self.geometry
        found = self.images.found
        return self.geometry if found.all() else self.geometry.take(np.flatnonzero(found))

    @property
    def kind(self) -> str:
        """What it holds: ``cloud``, ``mesh``, ``depth`` or ``points``."""
        if isinstance(self.geometry, FileCloud):
            return "mesh" if self.geometry.kind.endswith("mesh") else "cloud"
        return "depth" if isinstance(self.geometry, DepthMaps) else "points"


def holds_maps(path: Path, limit_bytes: int) -> bool:
    """Whether an npz holds depth maps or point maps (else it is a cloud)."""
    arrays = open_arrays(path, limit_bytes)
    names = arrays.names()
    cloud = "points" in names and not names & {_DEPTH, "world_points", *CAMERA_FIELDS}
    return not cloud or arrays.map("points").ndim == 4


def read_maps(path: Path, limit_bytes: int) -> ScenePrediction:
    """Read depth maps or point maps."""
    return maps_of(open_arrays(path, limit_bytes))


def maps_of(arrays: Arrays) -> ScenePrediction:
    """Take depth maps or point maps from arrays named as `read_maps` says, and as it does."""
    names = arrays.names()
    kinds = [name for name in (_DEPTH, *_POINTS) if name in names]
    if len(kinds) > 1:
        raise field_fault(
            arrays, f"holds {' and '.join(kinds)}, and they could disagree", "one of them"
        )
    cameras_of_depth = tuple(name for name in CAMERA_FIELDS if name != _NAMES)
    needed = (_DEPTH, *cameras_of_depth) if kinds == [_DEPTH] else (kinds[0] if kinds else _DEPTH,)
    maps_name = needed[0]
    allowed = ("protocol", _CENTRES, maps_name, *CAMERA_FIELDS, *_CONFIDENCE, *_COLOURS)
    check_fields(arrays, needed, allowed, _EXPECTED)
    maps = _maps(arrays, maps_name)
    count, height, width = maps.shape[:3]
    stated = _pixel_centres(arrays)
    shift = _HALF_A_PIXEL[stated or ("half" if _NAMES in names else "integer")]
    _hold_work(arrays, count, height * width)
    cameras, notes = _cameras(arrays, (count, height, width), shift)
    images = image_poses(arrays, count) if "extrinsics" in names else None
    confidence = _confidence(arrays, (count, height, width))
    _check_colours(arrays, (count, height, width, 3))
    geometry: DepthMaps | PointMaps = PointMaps(maps, confidence)
    if maps_name == _DEPTH and cameras is not None and images is not None:
        geometry = DepthMaps(maps, cameras, images.poses, confidence)
    return ScenePrediction(geometry, images, notes, stated)


def _maps(arrays: Arrays, name: str) -> FloatMaps:
    values = arrays.map(name)
    if name == _DEPTH and values.ndim == 4 and values.shape[-1] == 1:
        values = values[..., 0]
    shape = (3,) if name in _POINTS else ()
    fits = values.ndim == 3 + len(shape) and values.shape[3:] == shape and 0 not in values.shape
    if name == _DEPTH and values.ndim == 4 and values.shape[1] == 1:
        raise PredictionError(
            f"field 'depth' has shape {values.shape}, with an axis of 1 before the pixels",
            where=arrays.path,
            expected="shape (N, H, W), or (N, H, W, 1)",
            fix="depth[:, 0] (depth.squeeze(1))",
        )
    if values.dtype.kind != "f" or values.dtype.itemsize > 8 or not fits:
        raise PredictionError(
            f"field '{name}' is {values.dtype} of shape {values.shape}",
            where=arrays.path,
            expected=f"floating point of shape ({', '.join(('N', 'H', 'W', *map(str, shape)))})",
            fix=f"{name}.astype(np.float32), in the units of the poses"
            + (
                ": whole numbers are often millimetres, / 1000" if values.dtype.kind in "iu" else ""
            ),
        )
    return values


def _pixel_centres(arrays: Arrays) -> str | None:
    if _CENTRES not in arrays.names():
        return None
    value = arrays.read(_CENTRES)
    stated = str(value.reshape(())) if value.dtype.kind == "U" and value.size == 1 else ""
    if stated not in _HALF_A_PIXEL:
        raise PredictionError(
            f"says {stated[:20]!r}" if stated else "is not one text",
            where=f"{arrays.path}, field '{_CENTRES}'",
            expected="'half' (the centre of the first pixel is (0.5, 0.5) for K) or 'integer' "
            "(it is (0, 0))",
            fix="np.savez(..., pixel_centres='integer') for Depth Anything 3, VGGT, CUT3R, "
            "MapAnything, DUSt3R",
        )
    return stated


def _hold_work(arrays: Arrays, count: int, pixels: int) -> None:
    """Reserve what fusing takes besides the maps: one view at a time, and the poses of all."""
    arrays.budget.hold(arrays.path, f"working on views of {pixels:,} px", pixels * _BYTES_A_PIXEL)
    arrays.budget.hold(arrays.path, f"the cameras of {count:,} views", count * BYTES_A_CAMERA)


def _cameras(
    arrays: Arrays, shape: tuple[int, ...], shift: float
) -> tuple[Cameras | None, tuple[str, ...]]:
    if "intrinsics" not in arrays.names():
        return None, ()
    count, height, width = shape
    matrices = numbers(arrays, "intrinsics", (None, 3, 3)).astype(np.float64)
    check_count(arrays, "intrinsics", len(matrices), count)
    with np.errstate(invalid="ignore"):  # of NaN, which is refused below by its row
        matrices[:, :2, 2] += shift
    names = _labels(arrays, count)
    try:
        cameras = Cameras.from_matrices(matrices, width, height, names=names)
    except CameraError as error:
        raise camera_fault(arrays, "intrinsics", error) from error
    notes = refuse_other_resolution(cameras, names, f"{arrays.path}, field 'intrinsics'")
    return cameras, notes


def _confidence(arrays: Arrays, shape: tuple[int, ...]) -> FloatMaps | None:
    values = _optional(arrays, _CONFIDENCE, shape)
    if values is not None and (values.dtype.kind not in "biuf" or values.dtype.itemsize > 8):
        raise field_fault(arrays, f"the confidence is {values.dtype}", "numbers")
    return values


def _check_colours(arrays: Arrays, shape: tuple[int, ...]) -> None:
    """Refuse colours that are none; no score needs them."""
    values = _optional(arrays, _COLOURS, shape)
    if values is not None and values.dtype != np.uint8:
        raise field_fault(arrays, f"the colours are {values.dtype}", "uint8")


def _optional(
    arrays: Arrays, names: tuple[str, ...], shape: tuple[int, ...]
) -> NDArray[Any] | None:
    given = [name for name in names if name in arrays.names()]
    if not given:
        return None
    if len(given) > 1:
        raise field_fault(arrays, f"holds {' and '.join(given)}", "one of them")
    values = arrays.map(given[0])
    if values.shape != shape:
        raise PredictionError(
            f"field '{given[0]}' has shape {values.shape}",
            where=arrays.path,
            expected=f"{shape}: the size of the maps and of '{given[0]}' must be the same",
            fix=f"write '{given[0]}' at the size of the maps, or leave it out",
        )
    return values


def _labels(arrays: Arrays, count: int) -> list[str] | None:
    if _NAMES not in arrays.names():
        return None
    names = texts(arrays, _NAMES, 1)
    return names.tolist() if len(names) == count else None
