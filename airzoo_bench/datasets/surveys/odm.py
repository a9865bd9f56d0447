"""An OpenDroneMap project, or one split into submodels, as a dataset of `prepare`.

What the files hold was measured by reprojection in a project of three submodels. World of
``opensfm/reconstruction.json``: metres about ``reference_lla.json``, to be taken to the projected
CRS by ``opensfm/geocoords_transformation.txt``. Newer versions move that file to
``reconstruction.topocentric.json`` and put one in the projected CRS, less the offset of
``odm_georeferencing/coords.txt``, in its place (read in their source, not measured).
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

from airzoo_bench.core.errors import BenchmarkError, CameraError, UserError, counted, readable
from airzoo_bench.core.files import read_text
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import load_about
from airzoo_bench.datasets.cameras import Lens, cameras_of_lenses
from airzoo_bench.datasets.content import photo_sizes
from airzoo_bench.datasets.scenes import NativeScene, PosedPhotos
from airzoo_bench.datasets.settings import SurveyOptions
from airzoo_bench.datasets.surveys.survey import Survey, posed_scene
from airzoo_bench.datasets.tables import match_names
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import horizontal_crs
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import open_info

_ORTHOPHOTO = Path("odm_orthophoto/odm_orthophoto.tif")
_SURFACE = Path("odm_dem/dsm.tif")
_CLOUDS = tuple(Path(f"odm_georeferencing/odm_georeferenced_model.{s}") for s in ("laz", "las"))
_TOPOCENTRIC = Path("opensfm/reconstruction.topocentric.json")
_RECONSTRUCTION = Path("opensfm/reconstruction.json")
_TRANSFORMATION = Path("opensfm/geocoords_transformation.txt")
_COORDS = Path("odm_georeferencing/coords.txt")
_PROJ = Path("odm_georeferencing/proj.txt")
_LIMIT_BYTES = 1 << 30
_LENS_KEYS: Mapping[str, tuple[str, ...]] = {
    "perspective": ("focal", "k1", "k2"),
    "simple_radial": ("focal_x", "focal_y", "c_x", "c_y", "k1"),
    "radial": ("focal_x", "focal_y", "c_x", "c_y", "k1", "k2"),
    "brown": ("focal_x", "focal_y", "c_x", "c_y", "k1", "k2", "p1", "p2", "k3"),
}


class _OdmProjects(Survey[SurveyOptions]):
    """Photos, poses and map of a project."""

    about = load_about("odm")
    options = SurveyOptions

    def read(self, options: SurveyOptions, scene: str, progress: Progress) -> NativeScene:
        project, images = options.source, options.images or options.source / "images"
        folders = _parts(project)
        crs, sizes = _crs_of(folders), photo_sizes(images, progress)
        photos, notes, apart = _join_parts([_read_part(f) for f in folders], sizes, crs)
        dom, dsm = options.dom or project / _ORTHOPHOTO, options.dsm
        if dsm is None and (project / _SURFACE).is_file():
            dsm = project / _SURFACE
        lacking = [] if dom.is_file() else [_ORTHOPHOTO]
        lacking += [_SURFACE] * (dsm is None and options.plane_height is None)
        if lacking:
            what = f"has no {' and no '.join(map(str, lacking))}"
            fix = "give --dom, and --dsm or --plane-height; or run OpenDroneMap with --dsm"
            raise BenchmarkError(what, where=project, fix=fix)
        cloud = next((project / path for path in _CLOUDS if (project / path).is_file()), None)
        if cloud is not None and options.cloud is None:
            notes.append(f"it serves reconstruction too with its own cloud: --cloud {cloud}")
        read_from = (images, sizes, photos, folders[0] / _RECONSTRUCTION, progress)
        accuracy = round(apart, 4) or None
        parts: dict[str, Any] = {"dom": dom, "dsm": dsm, "notes": notes}
        return posed_scene(options, scene, *read_from, truth_accuracy_m=accuracy, **parts)


def _parts(project: Path) -> list[Path]:
    """Return the folders with a reconstruction: the project's own, or its submodels' folders."""
    submodels = sorted((project / "submodels").glob("submodel_*"))
    found = [one for one in (project, *submodels) if (one / _RECONSTRUCTION).is_file()]
    if not found:
        expected = f"{_RECONSTRUCTION}, there or in submodels/submodel_*"
        raise BenchmarkError("is no project of OpenDroneMap", where=project, expected=expected)
    return found[:1] if found[0] == project else found


def _crs_of(folders: Sequence[Path]) -> CRS:
    """Return the projected CRS of a project, by the first file that states one."""
    for path in (folder / name for folder in folders for name in (_COORDS, _PROJ)):
        if path.is_file():
            text = _text(path).strip().partition("\n")[0].strip()
            utm = re.fullmatch(r"WGS84 UTM (\d{1,2})([NS])", text)
            if utm:
                return CRS.from_epsg((32600 if utm[2] == "N" else 32700) + int(utm[1]))
            try:
                return horizontal_crs(text)
            except UserError as error:
                raise error.inside(path) from error
    if (folders[0] / _ORTHOPHOTO).is_file():
        return horizontal_crs(open_info(folders[0] / _ORTHOPHOTO).crs)
    expected = f"{_COORDS}, {_PROJ} or {_ORTHOPHOTO}"
    raise BenchmarkError("its files state no CRS", where=folders[0], expected=expected)


def _text(path: Path) -> str:
    return read_text(path, BenchmarkError, "file of OpenDroneMap", _LIMIT_BYTES)


@dataclass(frozen=True, eq=False)
class _Part:
    """The N photos of a project, or a submodel of it: file names, poses, OpenSfM's cameras."""

    path: Path
    names: Sequence[str]
    poses: Poses
    cameras: Sequence[Mapping[str, Any]]


def _read_part(folder: Path) -> _Part:
    """Read the shots of a project or submodel, and take their world to the projected CRS."""
    path, matrix = folder / _RECONSTRUCTION, np.eye(4)
    has_topocentric = (folder / _TOPOCENTRIC).is_file()
    if (folder / _TRANSFORMATION).is_file():
        path = folder / _TOPOCENTRIC if has_topocentric else path
        matrix = _numbers(folder / _TRANSFORMATION, slice(None), (4, 4))
    elif has_topocentric and (folder / _COORDS).is_file():
        matrix[:2, 3] = _numbers(folder / _COORDS, slice(1, 2), (1, 2))[0]
    else:
        expected = f"{_TRANSFORMATION}; or, of newer versions, {_TOPOCENTRIC} and {_COORDS}"
        what = f"{_RECONSTRUCTION} cannot be placed"
        raise BenchmarkError(what, where=folder, expected=expected)
    every: dict[str, tuple[Any, Mapping[str, Any]]] = {}
    text, expected = _text(path), "photos with a pose, as OpenDroneMap writes it"
    with readable(path, "cannot be read", kind=BenchmarkError, expected=expected):
        for part in json.loads(text):
            for name, shot in part["shots"].items():
                if shot["camera"] in part["cameras"]:
                    every.setdefault(name, (shot, part["cameras"][shot["camera"]]))
        shots = [shot for shot, _ in every.values()]
        rotation = Rotation.from_rotvec([shot["rotation"] for shot in shots]).as_matrix()
        translation = np.array([shot["translation"] for shot in shots], np.float64)
    local = Poses.from_translations(rotation, translation, list(every))
    # The matrix hardly shears: C' = A C + b, and rotations turn by A's polar factor.
    linear, offset = matrix[:3, :3], matrix[:3, 3]
    turn, _ = polar(linear)
    centres = np.einsum("ij,nj->ni", linear, local.centres) + offset
    placed = Poses(rotation=local.rotation @ turn.T, centres=centres)
    return _Part(path, list(every), placed, [camera for _, camera in every.values()])


def _numbers(path: Path, lines: slice, shape: tuple[int, int]) -> Floats:
    text, expected = _text(path), f"{shape[0]} lines of {shape[1]} numbers"
    with readable(path, "holds other numbers", kind=BenchmarkError, expected=expected):
        rows = [line.split()[: shape[1]] for line in text.splitlines()[lines] if line.strip()]
        return np.asarray_chkfinite(rows, np.float64).reshape(shape)


def _lens(camera: Mapping[str, Any], size: tuple[int, int], where: object) -> Lens:
    """Return matrix and distortion of an OpenSfM camera for a photo."""
    kind = str(camera.get("projection_type", "perspective"))
    keys = _LENS_KEYS.get(kind, ())
    if not keys or not all(isinstance(camera.get(key), int | float) for key in keys):
        what = f"its camera is {kind[:40]!r}, with {', '.join(camera)[:200]}"
        fix = "process the project with --camera-lens brown"
        raise CameraError(what, where=where, expected=", ".join(_LENS_KEYS), fix=fix)
    value = {key: float(camera[key]) for key in keys}
    (width, height), longer = size, max(size)
    stated = [camera.get("width", width), camera.get("height", height)]
    scale = longer / max(*stated, 1)
    if any(abs(side * scale - own) > 1.0 for side, own in zip(stated, size, strict=True)):
        what = f"its camera is {stated[0]:g}x{stated[1]:g} px, a photo {width}x{height}"
        fix = "give --images of the photos that the project was made from"
        raise CameraError(what, where=where, fix=fix)
    fx, fy = (longer * value.get(key, value.get("focal", 0.0)) for key in ("focal_x", "focal_y"))
    cx = value.get("c_x", 0.0) * longer + width / 2
    cy = value.get("c_y", 0.0) * longer + height / 2
    distortion = tuple(value.get(key, 0.0) for key in ("k1", "k2", "p1", "p2", "k3"))
    return [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]], distortion


def _join_parts(
    parts: Sequence[_Part], sizes: Mapping[str, tuple[int, int]], crs: CRS
) -> tuple[PosedPhotos, list[str], float]:
    """Put the parts' photos together; one of several parts has the pose of the first.

    Return notes too, and how far poses of one photo in two parts are apart.
    """
    first: dict[str, tuple[_Part, int]] = {}
    differences = []
    for part in parts:
        for row, name in enumerate(part.names):
            other, place = first.setdefault(name, (part, row))
            if other is not part:
                differences.append(part.poses.centres[row] - other.poses.centres[place])
    meant = match_names(first, sizes, parts[0].path)
    chosen = sorted((photo, *first[name]) for name, photo in meant.items())
    notes = [f"its {len(parts)} submodels are one scene"] if len(parts) > 1 else []
    apart = 0.0
    if differences:
        apart = float(np.median(np.linalg.norm(differences, axis=1)))
        notes.append(
            f"{counted(len(differences), 'photo')} of two submodels: their two poses differ by "
            f"{apart:.2f} m (median), and the first submodel's is taken"
        )
    absent = tuple(sorted(first.keys() - meant))
    names = tuple(photo for photo, _, _ in chosen)
    lenses = [_lens(part.cameras[row], sizes[photo], part.path) for photo, part, row in chosen]
    poses = Poses.from_centres(
        np.array([part.poses.rotation[row] for _, part, row in chosen]),
        np.array([part.poses.centres[row] for _, part, row in chosen]),
        names,
    )
    cameras = cameras_of_lenses(lenses, names, sizes)
    return PosedPhotos(names, cameras, poses, crs.to_string(), absent), notes, apart


ODM = _OdmProjects()
