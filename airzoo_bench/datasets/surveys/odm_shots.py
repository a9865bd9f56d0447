"""Shots of an OpenDroneMap project: poses in its projected CRS, and cameras.

What the files hold was measured by reprojection in a project of three submodels. World of
``opensfm/reconstruction.json``: metres about ``reference_lla.json``, to be taken to the projected
CRS by ``opensfm/geocoords_transformation.txt``. Newer versions move that file to
``reconstruction.topocentric.json`` and put one in the projected CRS, less the offset of
``odm_georeferencing/coords.txt``, in its place (read in their source, not measured).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

from airzoo_bench.core.errors import BenchmarkError, CameraError, first_of
from airzoo_bench.datasets.surveys.odm_layout import (
    CAMERAS,
    COORDS,
    PROJ,
    RECONSTRUCTION,
    SHOTS,
    TOPOCENTRIC,
    TRANSFORMATION,
    odm_json,
    odm_text,
)
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import Poses

__all__ = ["OdmPart", "read_part"]

_EVERY = (RECONSTRUCTION, TOPOCENTRIC, TRANSFORMATION, COORDS, PROJ, SHOTS, *CAMERAS)
_SAME_CENTRE_M = 0.1  # between two files of one project

Number = Annotated[float, Field(allow_inf_nan=False)]
Row = tuple[Number, Number, Number]
Cameras = dict[str, dict[str, Any]]


class _Lenient(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class _Shot(_Lenient):
    camera: str
    rotation: Row
    translation: Row


class _Reconstruction(_Lenient):
    cameras: Cameras
    shots: dict[str, _Shot]


class _Properties(_Lenient):
    filename: str
    rotation: Row
    translation: Row
    camera: str | None = None


class _Feature(_Lenient):
    properties: _Properties


class _Shots(_Lenient):
    features: list[_Feature]


@dataclass(frozen=True, eq=False)
class OdmPart:
    """What a project, or a submodel of it, says of its N photos.

    Attributes
    ----------
    names : tuple of N str
        File names.
    poses : Poses
        In the part's projected CRS.
    cameras : tuple of N mappings
        OpenSfM's, see `lens_of_camera`.
    poses_from : Path
    """

    names: tuple[str, ...]
    poses: Poses
    cameras: tuple[Mapping[str, Any], ...]
    poses_from: Path


def read_part(folder: Path) -> OdmPart:
    """Read the shots of a project or submodel."""
    found = _from_reconstruction(folder)
    if not (folder / SHOTS).is_file():
        if found is None:
            raise _not_placed(folder)
        return found
    shots = _from_shots(folder)
    if found is None:
        return _with_cameras(folder, shots)
    _check_agreement(folder, found, shots)
    return found


def _not_placed(folder: Path) -> BenchmarkError:
    there = [str(path) for path in _EVERY if (folder / path).is_file()]
    return BenchmarkError(
        f"its shots cannot be placed by {', '.join(there) or 'what is there'}",
        where=folder,
        expected=f"{RECONSTRUCTION} and {TRANSFORMATION}, or {SHOTS}",
    )


def _from_reconstruction(folder: Path) -> OdmPart | None:
    """Read OpenSfM's file; None where it is missing, or nothing says where its world lies."""
    local = TOPOCENTRIC if (folder / TOPOCENTRIC).is_file() else RECONSTRUCTION
    has_offset = local is TOPOCENTRIC and (folder / COORDS).is_file()
    if (folder / TRANSFORMATION).is_file() and (folder / local).is_file():
        path, matrix = folder / local, _matrix(folder / TRANSFORMATION)
    elif has_offset and (folder / RECONSTRUCTION).is_file():
        path, matrix = folder / RECONSTRUCTION, np.eye(4)
        matrix[:2, 3] = _offset(folder / COORDS)
    else:
        return None
    every: dict[str, tuple[_Shot, Mapping[str, Any]]] = {}
    for part in odm_json(path, list[_Reconstruction]):
        for name, shot in part.shots.items():
            if shot.camera in part.cameras:
                every.setdefault(name, (shot, part.cameras[shot.camera]))
    _require_shots(path, every)
    given = [shot for shot, _ in every.values()]
    local_poses = Poses.from_translations(
        _matrices([shot.rotation for shot in given]),
        np.array([shot.translation for shot in given]),
        list(every),
    )
    cameras = tuple(camera for _, camera in every.values())
    return OdmPart(tuple(every), _placed(local_poses, matrix), cameras, path)


def _matrices(vectors: list[Row]) -> Floats:
    """Turn rotation vectors, world to camera, into matrices."""
    matrices: Floats = Rotation.from_rotvec(np.array(vectors)).as_matrix()
    return matrices


def _placed(poses: Poses, matrix: Floats) -> Poses:
    """Take poses by a matrix that hardly shears, C' = A C + b; rotations by A's polar factor."""
    linear, offset = matrix[:3, :3], matrix[:3, 3]
    turn, _ = polar(linear)
    centres = np.einsum("ij,nj->ni", linear, poses.centres) + offset
    return Poses(rotation=poses.rotation @ turn.T, centres=centres)


def _from_shots(folder: Path) -> OdmPart:
    path = folder / SHOTS
    given = {f.properties.filename: f.properties for f in odm_json(path, _Shots).features}
    _require_shots(path, given)
    poses = Poses.from_centres(
        _matrices([shot.rotation for shot in given.values()]),
        np.array([shot.translation for shot in given.values()]),
        list(given),
    )
    cameras = tuple({"id": shot.camera} for shot in given.values())
    return OdmPart(tuple(given), poses, cameras, path)


def _with_cameras(folder: Path, part: OdmPart) -> OdmPart:
    """Find the cameras of shots that have a camera's name at the most."""
    path = next((folder / p for p in CAMERAS if (folder / p).is_file()), None)
    if path is None:
        raise CameraError(
            "its shots have a focal length but no lens distortion",
            where=part.poses_from,
            expected=f"{' or '.join(map(str, CAMERAS))} next to it",
        )
    # Keys of cameras.json lack the "v2 " that those of shots have.
    known = {key.removeprefix("v2 "): c for key, c in odm_json(path, Cameras).items()}
    only = next(iter(known.values())) if len(known) == 1 else None
    names = [camera["id"] for camera in part.cameras]
    found = [only if name is None else known.get(name.removeprefix("v2 ")) for name in names]
    lacking = [name for name, camera in zip(part.names, found, strict=True) if camera is None]
    if lacking:
        raise CameraError(
            f"which of {len(known)} cameras took them is not known: "
            f"{first_of(lacking, len(part.names))}",
            where=path,
            expected=f"the camera of each shot in {SHOTS}",
        )
    cameras = tuple(camera for camera in found if camera is not None)
    return OdmPart(part.names, part.poses, cameras, part.poses_from)


def _check_agreement(folder: Path, found: OdmPart, shots: OdmPart) -> None:
    place = {name: row for row, name in enumerate(shots.names)}
    pairs = [(row, place[name]) for row, name in enumerate(found.names) if name in place]
    if not pairs:
        return
    ours, theirs = np.array(pairs).T
    away = np.linalg.norm(found.poses.centres[ours] - shots.poses.centres[theirs], axis=1)
    if not np.median(away) < _SAME_CENTRE_M:
        raise BenchmarkError(
            f"{found.poses_from.name} and {SHOTS.name} put the same photos "
            f"{np.median(away):.2f} m apart (median)",
            where=folder,
            expected="files of one run",
            fix=f"remove the older of the two, or {TRANSFORMATION} if that is left from before",
        )


def _require_shots(path: Path, shots: Mapping[str, Any]) -> None:
    if not shots:
        raise BenchmarkError("has no shot", where=path, expected="photos with a pose")


def _matrix(path: Path) -> Floats:
    rows = [line.split() for line in odm_text(path).splitlines() if line.strip()]
    try:
        matrix = np.array(rows, dtype=np.float64)
    except ValueError:
        matrix = np.empty(0)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise BenchmarkError("is no matrix", where=path, expected="4 lines of 4 numbers")
    return matrix


def _offset(path: Path) -> Floats:
    lines = odm_text(path).splitlines()
    parts = lines[1].split() if len(lines) > 1 else []
    try:
        return np.array([float(part) for part in parts[:2]] * (len(parts) >= 2)).reshape(2)
    except ValueError as error:
        raise BenchmarkError(
            f"its second line is {' '.join(parts)[:60]!r}", where=path, expected="east and north"
        ) from error
