"""Cameras and poses of photos, from a JSON file or a COLMAP model."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
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

from airzoo_bench.core.errors import CameraError, counted, first_of, readable
from airzoo_bench.core.files import read_text
from airzoo_bench.core.optional_imports import load_pycolmap
from airzoo_bench.core.validation import validation_message
from airzoo_bench.datasets.cameras import cameras_of_lenses
from airzoo_bench.datasets.scenes import PosedPhotos, check_centred
from airzoo_bench.geometry.poses import Poses, check_rotations

_JSON_LIMIT_BYTES = 1 << 28
_NEAR_MISS = 0.5  # as "dist" is to "distortion"

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Row = tuple[Number, Number, Number]
Matrix = tuple[Row, Row, Row]
Distortion = Annotated[tuple[Number, ...], Field(min_length=4, max_length=5)]
Sizes = Mapping[str, tuple[int, int]]
_MODEL_KEYS = ("model", "camera_model", "distortion_model", "projection_type")
_UNREAD_KEYS = ("note", "gps_utm")
# What K with k1 k2 p1 p2 k3 computes, as COLMAP names it, with the number of other parameters
# before these; and as OpenSfM and ROS name it.
_MODELS = {"PINHOLE": 4, "SIMPLE_PINHOLE": 3, "SIMPLE_RADIAL": 3, "RADIAL": 3, "OPENCV": 4}
_OTHER_NAMES = ("PERSPECTIVE", "BROWN", "BROWN_CONRADY", "PLUMB_BOB", "RADTAN")


def _field_of(*keys: str, **more: Any) -> Any:
    return Field(validation_alias=AliasChoices(*keys), **more)


class _Lens(BaseModel):
    """A camera; refuses unknown keys, for a lens under another name would be none."""

    model_config = ConfigDict(frozen=True)
    K: Matrix | None = _field_of("K", default=None)
    distortion: Distortion | None = _field_of("distortion", "dist_k1k2p1p2", default=None)
    model: str | None = _field_of(*_MODEL_KEYS, default=None)

    @model_validator(mode="before")
    @classmethod
    def _no_unknown_keys(cls, data: Any) -> Any:
        fields: Any = cls.model_fields.values()
        known = [key for field in fields for key in field.validation_alias.choices]
        for key in data if isinstance(data, dict) else ():
            if key not in (*known, *_UNREAD_KEYS):
                near = difflib.get_close_matches(key, known, n=1, cutoff=_NEAR_MISS)
                hint = f" (did you mean {near[0]!r}?)" if near else ""
                raise ValueError(f"unknown key {key[:80]!r}{hint}")
        return data

    @field_validator("model")
    @classmethod
    def _computed(cls, name: str | None) -> str | None:
        if name is not None and name.upper() not in (*_MODELS, *_OTHER_NAMES):
            raise ValueError(f"it is none of {', '.join(_MODELS)}: undistort the photos")
        return name


class _Image(_Lens):
    rotation: Matrix = _field_of("R_w2c")
    centre: Row = _field_of("center", "center_utm")


class _File(_Lens):
    crs: str | None = _field_of("crs", default=None)
    images: dict[str, _Image] = _field_of("images", min_length=1)


def read_poses(path: Path, sizes: Sizes) -> PosedPhotos:
    """Read cameras and poses of the photos with given sizes."""
    try:
        photos = _from_colmap(path, sizes) if path.is_dir() else _from_json(path, sizes)
    except CameraError as error:
        raise error if str(path) in str(error.where) else error.inside(path) from error
    check_centred(photos, path)
    return photos


def _from_json(path: Path, sizes: Sizes) -> PosedPhotos:
    text = read_text(path, CameraError, "pose file", _JSON_LIMIT_BYTES)
    try:
        file = _File.model_validate_json(text)
    except ValidationError as error:
        raise CameraError(
            validation_message(error, _File),
            where=path,
            expected="JSON with crs, K, distortion and images: {name: {R_w2c, center}}, each once",
            fix="see docs/brighton.md",
        ) from error
    names, absent = _shared(list(file.images), sizes)
    images = [file.images[name] for name in names]
    lacking = [name for name, image in zip(names, images, strict=True) if not (image.K or file.K)]
    if lacking:
        raise CameraError(
            f"no camera matrix for {first_of(lacking, len(names))}",
            expected="'K' for the image, or one for all at the top of the file",
        )
    lenses = [(image.K or file.K, image.distortion or file.distortion or ()) for image in images]
    rotations = check_rotations(np.array([image.rotation for image in images]), names)
    poses = Poses.from_centres(rotations, np.array([image.centre for image in images]), names)
    cameras = cameras_of_lenses(lenses, names, sizes)
    return PosedPhotos(tuple(names), cameras, poses, file.crs or "", absent)


def _from_colmap(path: Path, sizes: Sizes) -> PosedPhotos:
    with readable(
        path,
        "not a COLMAP model",
        kind=CameraError,
        expected="a folder with cameras, images and points3D as .bin or .txt",
        fix="name the folder with these files (such as sparse/0), or export the model again",
    ):
        model = load_pycolmap().Reconstruction(str(path))
    images = {image.name: image for image in model.images.values() if image.has_pose}
    names, absent = _shared(list(images), sizes)
    found = [model.cameras[images[name].camera_id] for name in names]
    for name, camera in zip(names, found, strict=True):
        if (camera.width, camera.height) != sizes[name] or camera.model.name not in _MODELS:
            raise CameraError(
                f"the camera of {name} is {camera.model.name} of {camera.width}x{camera.height} px",
                expected=f"{' or '.join(_MODELS)}, of the size of the photo, "
                f"{sizes[name][0]}x{sizes[name][1]} px",
                fix="use the photos that the model was made from; undistort other lenses (colmap "
                "image_undistorter)",
            )
    lenses = [(one.calibration_matrix(), one.params[_MODELS[one.model.name] :]) for one in found]
    cameras = cameras_of_lenses(lenses, names, sizes)
    from_world = [images[name].cam_from_world() for name in names]
    poses = Poses.from_translations(
        np.array([pose.rotation.matrix() for pose in from_world]),
        np.array([pose.translation for pose in from_world]),
        names,
    )
    return PosedPhotos(tuple(names), cameras, poses, "", absent)


def _shared(posed: Sequence[str], sizes: Sizes) -> tuple[list[str], tuple[str, ...]]:
    names = sorted(set(posed) & set(sizes))
    if not names:
        same = {one.casefold() for one in posed} & {one.casefold() for one in sizes}
        raise CameraError(
            f"none of its {counted(len(posed), 'image')} with a pose is among "
            f"{counted(len(sizes), 'photo')}: it has {first_of(posed)}",
            expected=f"names such as {min(sizes)}" + "; they differ only in case" * bool(same),
        )
    return names, tuple(sorted(set(posed) - set(names)))
