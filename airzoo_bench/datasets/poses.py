"""Cameras and poses of photos, from a JSON file or a COLMAP model."""

from __future__ import annotations

import difflib
import re
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import (
    AliasChoices,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
    model_validator,
)
from pydantic.fields import FieldInfo

from airzoo_bench.core.errors import CameraError, counted, first_of
from airzoo_bench.core.files import read_text
from airzoo_bench.core.optional_imports import load_pycolmap
from airzoo_bench.core.validation import unambiguous_json, validation_message
from airzoo_bench.datasets.posed_photos import PosedPhotos, check_centred
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses, check_rotations

__all__ = ["read_poses"]

_JSON_LIMIT_BYTES = 1 << 28
_NEAR_MISS = 0.8

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Row = tuple[Number, Number, Number]
Matrix = tuple[Row, Row, Row]
Distortion = Annotated[tuple[Number, ...], Field(min_length=4, max_length=5)]
_DISTORTION_KEYS = AliasChoices("distortion", "dist_k1k2p1p2")
_CENTRE_KEYS = AliasChoices("center", "center_utm")
_MODEL_KEYS = AliasChoices("model", "camera_model", "distortion_model", "projection_type")
# What K with k1 k2 p1 p2 k3 computes, as COLMAP, OpenSfM and ROS name it.
_MODELS = ("PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV")
_OTHER_NAMES = ("PERSPECTIVE", "BROWN", "BROWN_CONRADY", "PLUMB_BOB", "RADTAN")


class _Lenient(BaseModel):
    """Accepts keys of other tools, but no misspelt key of ours and no two names of one key."""

    model_config = ConfigDict(frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _no_near_misses(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        known = [_aliases(name, field) for name, field in cls.model_fields.items()]
        for names in known:
            given = [name for name in names if name in data]
            if len(given) > 1:
                raise ValueError(f"{' and '.join(given)} are two names of one thing: keep one")
        every = [name for names in known for name in names]
        for key in data:
            near = difflib.get_close_matches(str(key), every, n=1, cutoff=_NEAR_MISS)
            if near and key not in every:
                raise ValueError(f"unknown key {str(key)[:80]!r} (did you mean {near[0]!r}?)")
        return data


def _aliases(name: str, field: FieldInfo) -> list[str]:
    alias = field.validation_alias
    if isinstance(alias, AliasChoices):
        return [str(choice) for choice in alias.choices]
    return [str(alias or name)]


class _Lens(_Lenient):
    K: Matrix | None = None
    distortion: Distortion | None = Field(default=None, validation_alias=_DISTORTION_KEYS)
    model: str | None = Field(default=None, validation_alias=_MODEL_KEYS)

    @field_validator("model")
    @classmethod
    def _computed(cls, name: str | None) -> str | None:
        if name is not None and name.upper() not in (*_MODELS, *_OTHER_NAMES):
            raise ValueError(f"it is none of {', '.join(_MODELS)}: undistort the photos")
        return name


class _Image(_Lens):
    rotation: Matrix = Field(validation_alias="R_w2c")
    centre: Row = Field(validation_alias=_CENTRE_KEYS)


class _File(_Lens):
    crs: str | None = None
    images: Annotated[dict[str, _Image], Field(min_length=1)]


def read_poses(path: Path, sizes: dict[str, tuple[int, int]]) -> PosedPhotos:
    """Read cameras and poses."""
    try:
        photos = _from_colmap(path, sizes) if path.is_dir() else _from_json(path, sizes)
    except CameraError as error:
        raise error if str(path) in str(error.where) else error.inside(path) from error
    check_centred(photos, path)
    return photos


def _from_json(path: Path, sizes: dict[str, tuple[int, int]]) -> PosedPhotos:
    text = read_text(path, CameraError, "pose file", _JSON_LIMIT_BYTES)
    try:
        file = _File.model_validate_json(text)
    except ValidationError as error:
        raise CameraError(
            validation_message(error, _File),
            where=path,
            expected="JSON with crs, K, distortion and images: {name: {R_w2c, center}}",
            fix="see docs/benchmark-folder.md",
        ) from error
    try:
        unambiguous_json(text)
    except ValueError as error:
        raise CameraError(str(error), where=path, expected="each photo once") from error
    names = _shared(path, list(file.images), sizes)
    images = [file.images[name] for name in names]
    cameras = _cameras(
        names,
        [
            _given(image.K or file.K, "K", name, path)
            for image, name in zip(images, names, strict=True)
        ],
        [image.distortion or file.distortion or (0.0,) * 5 for image in images],
        sizes,
    )
    rotations = np.array([image.rotation for image in images])
    centres = np.array([image.centre for image in images])
    rotations = check_rotations(rotations, names, where=path)
    poses = Poses.from_centres(rotations, centres, names)
    return PosedPhotos(tuple(names), cameras, poses, file.crs)


def _given(value: Matrix | None, key: str, name: str, path: Path) -> Matrix:
    if value is None:
        raise CameraError(
            f"no camera matrix for {name}",
            where=path,
            expected=f"'{key}' for the image, or one for all at the top of the file",
            fix="see docs/benchmark-folder.md",
        )
    return value


def _from_colmap(path: Path, sizes: dict[str, tuple[int, int]]) -> PosedPhotos:
    pycolmap = load_pycolmap()

    try:
        model = pycolmap.Reconstruction(str(path))
    # What pybind11 makes of C++ exceptions over damaged files, absurd counts among it.
    except (RuntimeError, ValueError, LookupError, OSError, MemoryError) as error:
        first = (str(error) or type(error).__name__).splitlines()[0]
        what = re.sub(r"^\[\S+:\d+\] ", "", first)  # without pycolmap's own line
        raise CameraError(
            f"not a COLMAP model: {what}",
            where=path,
            expected="a folder with cameras, images and points3D as .bin or .txt",
            fix="name the folder with these files (such as sparse/0), or export the model again",
        ) from error
    posed = [image for image in model.images.values() if image.has_pose]
    images = {image.name: image for image in posed}
    if len(images) < len(posed):
        raise CameraError("names an image twice", where=path, expected="each image once")
    names = _shared(path, list(images), sizes)
    cameras = [model.cameras[images[name].camera_id] for name in names]
    lenses = [_brown(camera, path) for camera in cameras]
    _check_model_sizes(cameras, names, sizes, path)
    from_world = [images[name].cam_from_world() for name in names]
    return PosedPhotos(
        tuple(names),
        _cameras(names, [camera.calibration_matrix() for camera in cameras], lenses, sizes),
        Poses.from_translations(
            np.array([pose.rotation.matrix() for pose in from_world]),
            np.array([pose.translation for pose in from_world]),
            names,
        ),
        None,
    )


def _brown(camera: Any, path: Path) -> tuple[float, ...]:
    params = [float(p) for p in camera.params]
    match camera.model.name:
        case "SIMPLE_PINHOLE" | "PINHOLE":
            return (0.0,) * 5
        case "SIMPLE_RADIAL":
            return (params[3], 0.0, 0.0, 0.0, 0.0)
        case "RADIAL":
            return (params[3], params[4], 0.0, 0.0, 0.0)
        case "OPENCV":
            return (*params[4:8], 0.0)
        case model:
            raise CameraError(
                f"camera model {model} is not supported",
                where=path,
                expected=" or ".join(_MODELS),
                fix="undistort the photos (colmap image_undistorter) and use that model",
            )


def _check_model_sizes(
    cameras: list[Any], names: list[str], sizes: dict[str, tuple[int, int]], path: Path
) -> None:
    differ = [
        f"{name} is {sizes[name][0]}x{sizes[name][1]}, its camera {camera.width}x{camera.height}"
        for name, camera in zip(names, cameras, strict=True)
        if (camera.width, camera.height) != sizes[name]
    ]
    if differ:
        raise CameraError(
            f"cameras of another image size: {first_of(differ, len(names))}",
            where=path,
            fix="use the photos that the model was made from",
        )


def _cameras(
    names: list[str],
    matrices: list[Any],
    distortion: list[tuple[float, ...]],
    sizes: dict[str, tuple[int, int]],
) -> Cameras:
    padded = np.zeros((len(names), 5))
    for row, values in zip(padded, distortion, strict=True):
        row[: len(values)] = values
    width, height = np.array([sizes[name] for name in names]).T
    return Cameras.from_matrices(np.array(matrices, np.float64), width, height, padded, names=names)


def _shared(path: Path, posed: list[str], sizes: dict[str, tuple[int, int]]) -> list[str]:
    names = sorted(set(posed) & set(sizes))
    if not posed:
        raise CameraError("has no image with a pose", where=path, fix="register images first")
    if not names:
        raise CameraError(
            f"none of its {counted(len(posed), 'image')} is among {counted(len(sizes), 'photo')}",
            where=path,
            expected=f"names such as {next(iter(sorted(sizes)))}",
            fix=f"it has names such as {posed[0]!r}; rename one or the other",
        )
    return names
