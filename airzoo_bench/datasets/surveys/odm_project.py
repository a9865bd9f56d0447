"""An OpenDroneMap project as a survey: its parts put together, its map and surface found."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, Field
from pyproj import CRS

from airzoo_bench.core.errors import BenchmarkError, counted, first_of
from airzoo_bench.core.files import data_root
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.photos import FoundPhotos
from airzoo_bench.datasets.posed_photos import PosedPhotos
from airzoo_bench.datasets.sources import photo_sizes
from airzoo_bench.datasets.surveys.lenses import cameras_of_lenses
from airzoo_bench.datasets.surveys.names import match_names
from airzoo_bench.datasets.surveys.odm_layout import (
    CLOUDS,
    ORTHOPHOTO,
    STATISTICS,
    SURFACE,
    find_parts,
    find_project,
    odm_json,
    part_crs,
    submodels_of,
)
from airzoo_bench.datasets.surveys.odm_lens import lens_of_camera
from airzoo_bench.datasets.surveys.odm_shots import OdmPart, read_part
from airzoo_bench.datasets.surveys.options import OdmOptions
from airzoo_bench.datasets.surveys.surface import grid_surface
from airzoo_bench.geometry.crs import describe_crs, same_plane
from airzoo_bench.geometry.poses import Poses

__all__ = ["map_of_project", "read_project"]

_Metres = Annotated[float, Field(ge=0, allow_inf_nan=False)]


def read_project(options: OdmOptions, progress: Progress) -> FoundPhotos:
    """Read a project, and grid its clouds where it has no surface model."""
    project = find_project(options.source)
    folders = find_parts(project)
    crs = _crs(folders)
    images = options.images or project / "images"
    sizes = photo_sizes(images, progress)
    parts = [read_part(folder) for folder in folders]
    photos, notes, apart = _joined(parts, sizes, crs)
    left, said = _control_points(project)
    notes += said
    if project != options.source:
        notes.insert(0, f"the project is {project}")
    without = [folder.name for folder in submodels_of(project) if folder not in folders]
    if without and folders != [project]:
        notes.append(f"submodels without shots: {first_of(without)}")
    dom = map_of_project(options)
    dsm = options.dsm
    if dsm is None and (project / SURFACE).is_file():
        dsm = project / SURFACE
    if dsm is None and options.plane_height is None:
        dsm, said = _gridded(options, project, folders, crs)
        notes += said
    cloud = next(filter(Path.is_file, _clouds(project)), None)
    if cloud is not None and options.cloud is None:
        notes.append(f"it serves reconstruction too with the project's own cloud: --cloud {cloud}")
    accuracy = round(max(apart, left), 4) or None
    return FoundPhotos(images, sizes, photos, parts[0].poses_from, dom, dsm, tuple(notes), accuracy)


def _crs(folders: list[Path]) -> CRS:
    every = {folder.name: part_crs(folder) for folder in folders}
    first = next(iter(every.values()))
    if not all(same_plane(first, crs) for crs in every.values()):
        each = "; ".join(f"{name}: {describe_crs(crs)}" for name, crs in every.items())
        raise BenchmarkError(
            f"submodels are in different CRS: {each}",
            where=folders[0].parent,
            fix="make a benchmark of each submodel",
        )
    return first


def map_of_project(options: OdmOptions) -> Path:
    """Return the map that was given, or the project's."""
    if options.dom is not None:
        return options.dom
    project = find_project(options.source)
    path = project / ORTHOPHOTO
    if not path.is_file():
        raise BenchmarkError(
            f"has no {ORTHOPHOTO}", where=project, fix="give --dom, or let OpenDroneMap make it"
        )
    return path


def _gridded(
    options: OdmOptions, project: Path, folders: list[Path], crs: CRS
) -> tuple[Path, list[str]]:
    """Grid the project's cloud, or else its submodels' clouds."""
    places = ([project], submodels_of(project), folders)
    found = [
        [path for path in (next(filter(Path.is_file, _clouds(f)), None) for f in place) if path]
        for place in places
    ]
    clouds = next((paths for paths in found if paths), None)
    if clouds is None:
        raise BenchmarkError(
            f"has no surface: neither {SURFACE} nor {CLOUDS[0]}",
            where=project,
            fix="give --dsm or --plane-height, or run OpenDroneMap with --dsm",
        )
    made = grid_surface(clouds, crs, data_root() / "surfaces", options.surface_cell)
    notes = [
        f"the surface is the highest point of each {made.cell_m:g} m cell of "
        f"{counted(len(clouds), 'cloud')}, in {made.path}"
    ]
    if made.disagreement_m is not None:
        notes.append(
            f"where clouds of submodels overlap, their heights differ by "
            f"{made.disagreement_m:.2f} m in the median: no truth is better than that"
        )
    return made.path, notes


def _clouds(folder: Path) -> list[Path]:
    return [folder / cloud for cloud in CLOUDS]


def _joined(
    parts: list[OdmPart], sizes: dict[str, tuple[int, int]], crs: CRS
) -> tuple[PosedPhotos, list[str], float]:
    """Put the parts' photos together; one of several parts has the pose of the first."""
    first: dict[str, tuple[OdmPart, int]] = {}
    twice: list[np.ndarray] = []
    for part in parts:
        for row, name in enumerate(part.names):
            if name in first:
                other, place = first[name]
                twice.append(part.poses.centres[row] - other.poses.centres[place])
            else:
                first[name] = part, row
    where = parts[0].poses_from
    meant = match_names(first, sizes, where)
    chosen = sorted((photo, *first[name]) for name, photo in meant.items())
    notes, apart = _overlap_notes(twice, parts)
    absent = [name for name in first if name not in meant]
    if absent:
        notes.append(f"shots whose photo is not there: {first_of(absent, len(first))}")
    names = tuple(photo for photo, _, _ in chosen)
    lenses = [
        lens_of_camera(part.cameras[row], sizes[photo], part.poses_from)
        for photo, part, row in chosen
    ]
    cameras = cameras_of_lenses(lenses, names, sizes)
    poses = Poses.from_centres(
        np.array([part.poses.rotation[row] for _, part, row in chosen]),
        np.array([part.poses.centres[row] for _, part, row in chosen]),
        names,
    )
    return PosedPhotos(names, cameras, poses, crs.to_string()), notes, apart


def _overlap_notes(differences: list[np.ndarray], parts: list[OdmPart]) -> tuple[list[str], float]:
    if len(parts) == 1:
        return [], 0.0
    notes = [f"its {len(parts)} submodels are one scene"]
    if differences:
        away = np.abs(np.array(differences))
        level, up = np.median(np.hypot(away[:, 0], away[:, 1])), np.median(away[:, 2])
        notes.append(
            f"{counted(len(away), 'photo')} of two submodels: their two poses differ by "
            f"{level:.2f} m in plan and {up:.2f} m in height (medians), and the first submodel's "
            "is taken: no truth is better than that"
        )
        return notes, float(np.median(np.linalg.norm(away, axis=1)))
    return notes, 0.0


class _AxisErrors(BaseModel):
    x: _Metres
    y: _Metres
    z: _Metres


class _ControlPoints(BaseModel):
    error: _AxisErrors | None = None


class _Statistics(BaseModel):
    gcp_errors: _ControlPoints = _ControlPoints()


def _control_points(project: Path) -> tuple[float, list[str]]:
    """Return what remains at ground control points in metres, 0 without any, and say it."""
    path = project / STATISTICS
    if not path.is_file():
        return 0.0, []
    errors = odm_json(path, _Statistics).gcp_errors.error
    if errors is None:
        return 0.0, []
    level = math.hypot(errors.x, errors.y)
    return math.hypot(level, errors.z), [
        f"at ground control points {level:.3f} m remain in plan and {errors.z:.3f} m in height "
        "(root mean square): no truth is better than that"
    ]
