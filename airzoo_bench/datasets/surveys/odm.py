"""An OpenDroneMap project, or one split into submodels, as a dataset of `prepare`.

What the files hold was measured by reprojection in a project of three submodels. World of
``opensfm/reconstruction.json``: metres about ``reference_lla.json``, to be taken to the projected
CRS by ``opensfm/geocoords_transformation.txt``. Newer versions move that file to
``reconstruction.topocentric.json`` and put one in the projected CRS, less the offset of
``odm_georeferencing/coords.txt``, in its place (read in their source, not measured).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, Field, TypeAdapter, ValidationError
from pyproj import CRS
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

from airzoo_bench.core.errors import BenchmarkError, CameraError, UserError, counted, first_of
from airzoo_bench.core.files import data_root, read_text
from airzoo_bench.core.progress import Progress
from airzoo_bench.core.registry import Option
from airzoo_bench.datasets.about import about_of
from airzoo_bench.datasets.content import photo_sizes
from airzoo_bench.datasets.lenses import Lens, cameras_of_lenses
from airzoo_bench.datasets.scenes import NativeScene, PosedPhotos
from airzoo_bench.datasets.surveys.surface import grid_surface
from airzoo_bench.datasets.surveys.survey import FoundPhotos, Survey, SurveyOptions, posed_scene
from airzoo_bench.datasets.tables import match_names
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import describe_crs, horizontal_crs, same_plane
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import open_info

__all__ = ["ODM", "OdmOptions"]

_ORTHOPHOTO = Path("odm_orthophoto/odm_orthophoto.tif")
_SURFACE = Path("odm_dem/dsm.tif")
_CLOUDS = tuple(Path(f"odm_georeferencing/odm_georeferenced_model.{s}") for s in ("laz", "las"))
_TOPOCENTRIC = Path("opensfm/reconstruction.topocentric.json")
_RECONSTRUCTION = Path("opensfm/reconstruction.json")
_TRANSFORMATION = Path("opensfm/geocoords_transformation.txt")
_COORDS = Path("odm_georeferencing/coords.txt")
_PROJ = Path("odm_georeferencing/proj.txt")
_SHOTS = Path("odm_report/shots.geojson")
_STATISTICS = Path("odm_report/stats.json")
_CAMERAS = (Path("cameras.json"), Path("opensfm/camera_models.json"))
_EVERY = (_RECONSTRUCTION, _TOPOCENTRIC, _TRANSFORMATION, _COORDS, _PROJ, _SHOTS, *_CAMERAS)
_LIMIT_BYTES = 1 << 30
_SAME_CENTRE_M = 0.1  # between two files of one project
_LENS_KEYS: Mapping[str, tuple[str, ...]] = {
    "perspective": ("focal", "k1", "k2"),
    "simple_radial": ("focal_x", "focal_y", "c_x", "c_y", "k1"),
    "radial": ("focal_x", "focal_y", "c_x", "c_y", "k1", "k2"),
    "brown": ("focal_x", "focal_y", "c_x", "c_y", "k1", "k2", "p1", "p2", "k3"),
}

_Number = Annotated[float, Field(allow_inf_nan=False)]
_Row = tuple[_Number, _Number, _Number]
_Cameras = dict[str, dict[str, Any]]


@dataclass(frozen=True, kw_only=True)
class OdmOptions(SurveyOptions):
    """What may be asked of an OpenDroneMap project."""

    source: Annotated[Path, Option("source", "The project's folder.")]
    surface_cell: Annotated[
        float | None,
        Option(
            "surface-cell",
            "Side in metres of the cells that the cloud is gridded by, where there is no surface "
            "model (default: what holds four points).",
            least=0.01,
        ),
    ] = None


class OdmProjects(Survey[OdmOptions]):
    """Photos, poses and map of a project."""

    about = about_of("odm")
    options = OdmOptions

    def map_of(self, options: OdmOptions) -> Path | None:
        """Return the map that was given, or the project's."""
        if options.dom is not None:
            return options.dom
        project = _find_project(options.source)
        path = project / _ORTHOPHOTO
        if not path.is_file():
            raise BenchmarkError(
                f"has no {_ORTHOPHOTO}",
                where=project,
                fix="give --dom, or let OpenDroneMap make it",
            )
        return path

    def read(self, options: OdmOptions, scene: str, progress: Progress) -> NativeScene:
        """Read a project, and grid its clouds where it has no surface model."""
        project = _find_project(options.source)
        folders = _find_parts(project)
        crs = _same_crs(folders)
        images = options.images or project / "images"
        sizes = photo_sizes(images, progress)
        parts = [_read_part(folder) for folder in folders]
        photos, notes, apart = _joined(parts, sizes, crs)
        if project != options.source:
            notes.insert(0, f"the project is {project}")
        left = _control_points(project, notes)
        without = [folder.name for folder in _submodels(project) if folder not in folders]
        if without and folders != [project]:
            notes.append(f"submodels without shots: {first_of(without)}")
        dsm = options.dsm
        if dsm is None and (project / _SURFACE).is_file():
            dsm = project / _SURFACE
        if dsm is None and options.plane_height is None:
            dsm = _gridded(options.surface_cell, project, folders, crs, notes)
        cloud = next(iter(_clouds([project])), None)
        if cloud is not None and options.cloud is None:
            notes.append(f"it serves reconstruction too with its own cloud: --cloud {cloud}")
        accuracy = round(max(apart, left), 4) or None
        dom, poses_from = self.map_of(options), parts[0].poses_from
        found = FoundPhotos(images, sizes, photos, poses_from, dom, dsm, tuple(notes), accuracy)
        return posed_scene(options, scene, found, progress)


def _find_project(source: Path) -> Path:
    """Return the project's folder: the source, or the one project in it."""
    if source.is_dir() and _find_parts(source):
        return source
    inside = sorted(path for path in source.iterdir() if path.is_dir()) if source.is_dir() else []
    projects = [path for path in inside if _find_parts(path)]
    if len(projects) == 1:
        return projects[0]
    there = [path.name for path in projects or inside]
    raise BenchmarkError(
        f"holds {first_of(there, shown=8, noun='project' if projects else 'folder')}",
        where=source,
        expected=f"one project: {_RECONSTRUCTION} or {_SHOTS}, there or in submodels/*",
        fix="name the project's own folder",
    )


def _find_parts(project: Path) -> list[Path]:
    """Return the folders that hold shots: the project's own, or those of its submodels."""
    submodels = _submodels(project)
    for file in (_RECONSTRUCTION, _SHOTS):
        if (project / file).is_file():
            return [project]
        if any((folder / file).is_file() for folder in submodels):
            files = (_RECONSTRUCTION, _SHOTS)
            return [one for one in submodels if any((one / file).is_file() for file in files)]
    return []


def _submodels(project: Path) -> list[Path]:
    return sorted(path for path in (project / "submodels").glob("submodel_*") if path.is_dir())


def _clouds(folders: Sequence[Path]) -> list[Path]:
    """Return the georeferenced cloud of each folder that has one."""
    found = (next((f / c for c in _CLOUDS if (f / c).is_file()), None) for f in folders)
    return [path for path in found if path is not None]


def _same_crs(folders: Sequence[Path]) -> CRS:
    """Return the projected CRS of a project, which all its files and submodels must state."""
    stated: dict[Path, CRS] = {}
    for folder in folders:
        if (folder / _COORDS).is_file():
            line = _text(folder / _COORDS).strip().partition("\n")[0]
            stated[folder / _COORDS] = _crs_of(line.strip(), folder / _COORDS)
        if (folder / _PROJ).is_file():
            stated[folder / _PROJ] = _crs_of(_text(folder / _PROJ).strip(), folder / _PROJ)
        if (folder / _ORTHOPHOTO).is_file():
            stated[folder / _ORTHOPHOTO] = horizontal_crs(open_info(folder / _ORTHOPHOTO).crs)
    if not stated:
        raise BenchmarkError(
            "states no CRS", where=folders[0], expected=f"one of {_COORDS}, {_PROJ}, {_ORTHOPHOTO}"
        )
    first, *others = stated.values()
    if not all(same_plane(first, other) for other in others):
        each = "; ".join(f"{path}: {describe_crs(found)}" for path, found in stated.items())
        raise BenchmarkError(
            f"its files state different CRS: {each}",
            where=folders[0],
            fix="make a benchmark of each submodel",
        )
    return next((crs for crs in stated.values() if crs.to_epsg() is not None), first)


def _crs_of(text: str, path: Path) -> CRS:
    utm = re.fullmatch(r"WGS84 UTM (\d{1,2})([NS])", text)
    if utm:
        return CRS.from_epsg((32600 if utm[2] == "N" else 32700) + int(utm[1]))
    try:
        return horizontal_crs(text)
    except UserError as error:
        raise BenchmarkError(
            f"states the CRS {text[:80]!r}",
            where=path,
            expected="such as 'WGS84 UTM 15N', or a PROJ string",
        ) from error


def _text(path: Path) -> str:
    return read_text(path, BenchmarkError, "file of OpenDroneMap")


def _json(path: Path, kind: Any) -> Any:
    """Read a JSON file of a project as `kind`, a type that pydantic knows."""
    text = read_text(path, BenchmarkError, "file of OpenDroneMap", _LIMIT_BYTES)
    try:
        return TypeAdapter(kind).validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        raise BenchmarkError(
            f"{'.'.join(map(str, first['loc'])) or 'the file'}: {first['msg']}",
            where=path,
            expected="as OpenDroneMap writes it",
            fix="copy the project again",
        ) from error


class _Shot(BaseModel):
    camera: str | None = None
    rotation: _Row
    translation: _Row


class _Reconstruction(BaseModel):
    cameras: _Cameras
    shots: dict[str, _Shot]


class _Properties(_Shot):
    filename: str


class _Feature(BaseModel):
    properties: _Properties


class _Shots(BaseModel):
    features: list[_Feature]


@dataclass(frozen=True, eq=False)
class _Part:
    """The N photos of a project, or a submodel of it: file names, poses, OpenSfM's cameras."""

    names: tuple[str, ...]
    poses: Poses
    cameras: tuple[Mapping[str, Any], ...]
    poses_from: Path


def _read_part(folder: Path) -> _Part:
    """Read the shots of a project or submodel, of OpenSfM's file where its world can be placed."""
    shots = folder / _SHOTS
    local = _TOPOCENTRIC if (folder / _TOPOCENTRIC).is_file() else _RECONSTRUCTION
    found = None
    if (folder / _TRANSFORMATION).is_file() and (folder / local).is_file():
        matrix = _numbers(folder / _TRANSFORMATION, slice(None), (4, 4))
        found = _from_reconstruction(folder / local, matrix)
    elif local is _TOPOCENTRIC and all((folder / f).is_file() for f in (_COORDS, _RECONSTRUCTION)):
        matrix = np.eye(4)
        matrix[:2, 3] = _numbers(folder / _COORDS, slice(1, 2), (1, 2))[0]
        found = _from_reconstruction(folder / _RECONSTRUCTION, matrix)
    if found is None and not shots.is_file():
        there = [str(path) for path in _EVERY if (folder / path).is_file()]
        raise BenchmarkError(
            f"its shots cannot be placed by {', '.join(there) or 'what is there'}",
            where=folder,
            expected=f"{_RECONSTRUCTION} and {_TRANSFORMATION}, or {_SHOTS}",
        )
    if found is None:
        return _from_shots(folder)
    if shots.is_file():
        _check_agreement(folder, found, _json(shots, _Shots))
    return found


def _from_reconstruction(path: Path, matrix: Floats) -> _Part:
    """Read OpenSfM's file, and take its world by a matrix to the projected CRS."""
    every: dict[str, tuple[_Shot, Mapping[str, Any]]] = {}
    for part in _json(path, list[_Reconstruction]):
        for name, shot in part.shots.items():
            if shot.camera in part.cameras:
                every.setdefault(name, (shot, part.cameras[shot.camera]))
    rotation, translation = _arrays([shot for shot, _ in every.values()], path)
    local = Poses.from_translations(rotation, translation, list(every))
    # The matrix hardly shears: C' = A C + b, and rotations turn by A's polar factor.
    linear, offset = matrix[:3, :3], matrix[:3, 3]
    turn, _ = polar(linear)
    centres = np.einsum("ij,nj->ni", linear, local.centres) + offset
    placed = Poses(rotation=local.rotation @ turn.T, centres=centres)
    return _Part(tuple(every), placed, tuple(camera for _, camera in every.values()), path)


def _arrays(shots: Sequence[_Shot], path: Path) -> tuple[Floats, Floats]:
    """Return rotations, world to camera, and translations of shots."""
    if not shots:
        raise BenchmarkError("has no shot", where=path, expected="photos with a pose")
    rotation: Floats = Rotation.from_rotvec([shot.rotation for shot in shots]).as_matrix()
    return rotation, np.array([shot.translation for shot in shots])


def _from_shots(folder: Path) -> _Part:
    """Read the report's shots, whose translation is the centre; their cameras stand elsewhere."""
    path = folder / _SHOTS
    shots = {f.properties.filename: f.properties for f in _json(path, _Shots).features}
    poses = Poses.from_centres(*_arrays(list(shots.values()), path), list(shots))
    file = next((folder / p for p in _CAMERAS if (folder / p).is_file()), None)
    if file is None:
        raise CameraError(
            "its shots have a focal length but no lens distortion",
            where=path,
            expected=f"{' or '.join(map(str, _CAMERAS))} next to it",
        )
    # Keys of cameras.json lack the "v2 " that those of shots have.
    known = {key.removeprefix("v2 "): camera for key, camera in _json(file, _Cameras).items()}
    only = next(iter(known.values())) if len(known) == 1 else None
    found = {
        name: only if shot.camera is None else known.get(shot.camera.removeprefix("v2 "))
        for name, shot in shots.items()
    }
    lacking = [name for name, camera in found.items() if camera is None]
    if lacking:
        raise CameraError(
            f"which camera took them is not known: {first_of(lacking, len(found))}",
            where=file,
            expected=f"the camera of each shot in {_SHOTS}",
        )
    cameras = tuple(camera for camera in found.values() if camera is not None)
    return _Part(tuple(shots), poses, cameras, path)


def _check_agreement(folder: Path, found: _Part, shots: _Shots) -> None:
    """Refuse a report of another run than the reconstruction."""
    centres = {f.properties.filename: f.properties.translation for f in shots.features}
    away = [
        math.dist(found.poses.centres[row], centres[name])
        for row, name in enumerate(found.names)
        if name in centres
    ]
    if away and not np.median(away) < _SAME_CENTRE_M:
        raise BenchmarkError(
            f"{found.poses_from.name} and {_SHOTS.name} put the same photos "
            f"{np.median(away):.2f} m apart (median)",
            where=folder,
            expected="files of one run",
            fix=f"remove the older of the two, or {_TRANSFORMATION} if that is left from before",
        )


def _numbers(path: Path, lines: slice, shape: tuple[int, int]) -> Floats:
    rows = [line.split() for line in _text(path).splitlines()[lines] if line.strip()]
    try:
        values = np.array([row[: shape[1]] for row in rows], dtype=np.float64)
    except ValueError:
        values = np.empty(0)
    if values.shape != shape or not np.isfinite(values).all():
        raise BenchmarkError(
            "holds other numbers", where=path, expected=f"{shape[0]} lines of {shape[1]} numbers"
        )
    return values


def _lens(camera: Mapping[str, Any], size: tuple[int, int], where: object) -> Lens:
    """Return matrix and distortion of an OpenSfM camera for a photo."""
    kind = str(camera.get("projection_type", "perspective"))
    keys = _LENS_KEYS.get(kind, ())
    lacking = [key for key in keys if not isinstance(camera.get(key), int | float)]
    if not keys or lacking:
        raise CameraError(
            f"its camera lacks {', '.join(lacking)}" if keys else f"its camera is {kind[:40]!r}",
            where=where,
            expected=f"{', '.join(_LENS_KEYS)}, with their numbers",
            fix="process the project with --camera-lens brown",
        )
    value = {key: float(camera[key]) for key in keys}
    (width, height), longer = size, max(size)
    stated = [camera.get("width", width), camera.get("height", height)]
    scale = longer / max(*stated, 1)
    if any(abs(side * scale - own) > 1.0 for side, own in zip(stated, size, strict=True)):
        raise CameraError(
            f"its camera is {stated[0]:g}x{stated[1]:g} px, a photo {width}x{height}",
            where=where,
            expected="photos of the camera's shape",
            fix="give --images of the photos that the project was made from",
        )
    fx, fy = (longer * value.get(key, value.get("focal", 0.0)) for key in ("focal_x", "focal_y"))
    cx = value.get("c_x", 0.0) * longer + width / 2
    cy = value.get("c_y", 0.0) * longer + height / 2
    distortion = tuple(value.get(key, 0.0) for key in ("k1", "k2", "p1", "p2", "k3"))
    return [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]], distortion


def _joined(
    parts: Sequence[_Part], sizes: Mapping[str, tuple[int, int]], crs: CRS
) -> tuple[PosedPhotos, list[str], float]:
    """Put the parts' photos together; one of several parts has the pose of the first.

    Return notes too, and how far poses of one photo in two parts are apart.
    """
    first: dict[str, tuple[_Part, int]] = {}
    differences = []
    for part in parts:
        for row, name in enumerate(part.names):
            if name in first:
                other, place = first[name]
                differences.append(part.poses.centres[row] - other.poses.centres[place])
            else:
                first[name] = part, row
    meant = match_names(first, sizes, parts[0].poses_from)
    chosen = sorted((photo, *first[name]) for name, photo in meant.items())
    notes, apart = _overlap_notes(differences, len(parts))
    absent = [name for name in first if name not in meant]
    if absent:
        notes.append(f"shots whose photo is not there: {first_of(absent, len(first))}")
    names = tuple(photo for photo, _, _ in chosen)
    lenses = [
        _lens(part.cameras[row], sizes[photo], part.poses_from) for photo, part, row in chosen
    ]
    poses = Poses.from_centres(
        np.array([part.poses.rotation[row] for _, part, row in chosen]),
        np.array([part.poses.centres[row] for _, part, row in chosen]),
        names,
    )
    cameras = cameras_of_lenses(lenses, names, sizes)
    return PosedPhotos(names, cameras, poses, crs.to_string()), notes, apart


def _overlap_notes(differences: Sequence[Floats], parts: int) -> tuple[list[str], float]:
    notes = [f"its {parts} submodels are one scene"] if parts > 1 else []
    if not differences:
        return notes, 0.0
    away = np.abs(np.array(differences))
    level, up = np.median(np.hypot(away[:, 0], away[:, 1])), np.median(away[:, 2])
    notes.append(
        f"{counted(len(away), 'photo')} of two submodels: their two poses differ by {level:.2f} m "
        f"in plan and {up:.2f} m in height (medians), and the first submodel's is taken: no truth "
        "is better than that"
    )
    return notes, float(np.median(np.linalg.norm(away, axis=1)))


def _gridded(
    cell: float | None, project: Path, folders: Sequence[Path], crs: CRS, notes: list[str]
) -> Path:
    """Grid the project's cloud, or else its submodels' clouds."""
    places = ([project], _submodels(project), folders)
    clouds = next((found for place in places if (found := _clouds(place))), None)
    if clouds is None:
        raise BenchmarkError(
            f"has no surface: neither {_SURFACE} nor {_CLOUDS[0]}",
            where=project,
            fix="give --dsm or --plane-height, or run OpenDroneMap with --dsm",
        )
    made = grid_surface(clouds, crs, data_root() / "surfaces", cell)
    notes.append(
        f"the surface is the highest point of each {made.cell_m:g} m cell of "
        f"{counted(len(clouds), 'cloud')}, in {made.path}"
    )
    if made.disagreement_m is not None:
        notes.append(
            f"where clouds of submodels overlap, their heights differ by "
            f"{made.disagreement_m:.2f} m in the median: no truth is better than that"
        )
    return made.path


class _AxisErrors(BaseModel):
    x: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    y: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    z: Annotated[float, Field(ge=0, allow_inf_nan=False)]


class _ControlPoints(BaseModel):
    error: _AxisErrors | None = None


class _Statistics(BaseModel):
    gcp_errors: _ControlPoints = _ControlPoints()


def _control_points(project: Path, notes: list[str]) -> float:
    """Return what remains at ground control points in metres, 0 without any, and say it."""
    path = project / _STATISTICS
    errors = _json(path, _Statistics).gcp_errors.error if path.is_file() else None
    if errors is None:
        return 0.0
    level = math.hypot(errors.x, errors.y)
    notes.append(
        f"at ground control points {level:.3f} m remain in plan and {errors.z:.3f} m in height "
        "(root mean square): no truth is better than that"
    )
    return math.hypot(level, errors.z)


ODM = OdmProjects()
