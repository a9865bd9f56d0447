"""Where the files of an OpenDroneMap project are, and what coordinate system they state."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError
from pyproj import CRS

from airzoo_bench.core.errors import BenchmarkError, UserError, first_of
from airzoo_bench.core.files import read_text
from airzoo_bench.geometry.crs import describe_crs, horizontal_crs, same_plane
from airzoo_bench.geometry.rasters import open_info

__all__ = ["find_parts", "find_project", "odm_json", "odm_text", "part_crs", "submodels_of"]

ORTHOPHOTO = Path("odm_orthophoto/odm_orthophoto.tif")
SURFACE = Path("odm_dem/dsm.tif")
CLOUDS = tuple(
    Path("odm_georeferencing", f"odm_georeferenced_model.{suffix}") for suffix in ("laz", "las")
)
TOPOCENTRIC = Path("opensfm/reconstruction.topocentric.json")
RECONSTRUCTION = Path("opensfm/reconstruction.json")
TRANSFORMATION = Path("opensfm/geocoords_transformation.txt")
COORDS = Path("odm_georeferencing/coords.txt")
PROJ = Path("odm_georeferencing/proj.txt")
SHOTS = Path("odm_report/shots.geojson")
STATISTICS = Path("odm_report/stats.json")
CAMERAS = (Path("cameras.json"), Path("opensfm/camera_models.json"))

_LIMIT_BYTES = 1 << 30


def find_project(source: Path) -> Path:
    """Return the project's folder: the source, or the one project in it."""
    if not source.is_dir():
        raise BenchmarkError("no such folder", where=source, expected="an OpenDroneMap project")
    if find_parts(source):
        return source
    inside = [path for path in sorted(source.iterdir()) if path.is_dir() and find_parts(path)]
    if len(inside) == 1:
        return inside[0]
    what = f"holds {first_of([p.name for p in inside], noun='project')}" if inside else "no project"
    found = sorted(path.name for path in source.iterdir())
    raise BenchmarkError(
        f"{what}; there is {first_of(found, shown=8, noun='entry')}",
        where=source,
        expected=f"an OpenDroneMap project: {RECONSTRUCTION} or {SHOTS}, there or in submodels/*",
        fix="name the project's own folder",
    )


def find_parts(project: Path) -> list[Path]:
    """Return the folders that hold shots: the project's own, or those of its submodels."""
    submodels = [folder for folder in submodels_of(project) if _has(folder, RECONSTRUCTION, SHOTS)]
    if _has(project, RECONSTRUCTION):
        return [project]
    if any(_has(folder, RECONSTRUCTION) for folder in submodels):
        return submodels
    return [project] if _has(project, SHOTS) else submodels


def submodels_of(project: Path) -> list[Path]:
    """Return the folders of a project's submodels, by name."""
    return sorted(path for path in (project / "submodels").glob("submodel_*") if path.is_dir())


def _has(folder: Path, *files: Path) -> bool:
    return any((folder / file).is_file() for file in files)


def part_crs(folder: Path) -> CRS:
    """Return the projected CRS of a project or submodel."""
    stated = {}
    if (folder / COORDS).is_file():
        line = odm_text(folder / COORDS).strip().partition("\n")[0]
        stated[COORDS] = _crs_of(line.strip(), folder / COORDS)
    if (folder / PROJ).is_file():
        stated[PROJ] = _crs_of(odm_text(folder / PROJ).strip(), folder / PROJ)
    if (folder / ORTHOPHOTO).is_file():
        stated[ORTHOPHOTO] = horizontal_crs(open_info(folder / ORTHOPHOTO).crs)
    if not stated:
        raise BenchmarkError(
            "states no CRS", where=folder, expected=f"one of {COORDS}, {PROJ}, {ORTHOPHOTO}"
        )
    first, *others = stated.values()
    if not all(same_plane(first, other) for other in others):
        each = "; ".join(f"{path}: {describe_crs(found)}" for path, found in stated.items())
        raise BenchmarkError(f"its files state different CRS: {each}", where=folder)
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


def odm_text(path: Path) -> str:
    """Read a small text file of a project."""
    return read_text(path, BenchmarkError, "file of OpenDroneMap")


def odm_json(path: Path, kind: Any) -> Any:
    """Read a JSON file of a project as `kind`, a type that pydantic knows."""
    text = read_text(path, BenchmarkError, "file of OpenDroneMap", _LIMIT_BYTES)
    try:
        return TypeAdapter(kind).validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise BenchmarkError(
            f"{place or 'the file'}: {first['msg']}",
            where=path,
            expected="as OpenDroneMap writes it",
            fix="copy the project again",
        ) from error
