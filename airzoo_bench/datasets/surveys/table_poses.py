"""Cameras and poses of photos out of a table of positions and angles."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pyproj import CRS

from airzoo_bench.core.errors import BenchmarkError, UsageError, first_of
from airzoo_bench.datasets.posed_photos import PosedPhotos
from airzoo_bench.datasets.surveys.dji_tags import check_focal_lengths
from airzoo_bench.datasets.surveys.lenses import (
    LENS_KEYS,
    cameras_of_lenses,
    focal_of_unknown_size,
    lens_of,
    read_camera_file,
)
from airzoo_bench.datasets.surveys.names import match_names
from airzoo_bench.datasets.surveys.pose_table import PoseTable, read_pose_table
from airzoo_bench.datasets.surveys.table_angles import (
    AngleSettings,
    angle_columns,
    table_rotations,
)
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import describe_crs, from_lonlat, grid_convergence_deg, to_lonlat
from airzoo_bench.geometry.poses import Poses

__all__ = ["TablePoses", "read_table_poses"]


@dataclass(frozen=True, eq=False)
class TablePoses:
    """What a table says, and what was assumed to read it.

    Attributes
    ----------
    photos : PosedPhotos
    notes : tuple of str
    """

    photos: PosedPhotos
    notes: tuple[str, ...]


def read_table_poses(
    path: Path,
    images: Path,
    sizes: dict[str, tuple[int, int]],
    crs: CRS,
    stated: CRS | None,
    angles: AngleSettings,
    camera: Path | None,
) -> TablePoses:
    """Read cameras and poses from a table."""
    given = read_pose_table(path)
    found = match_names(given.table.texts("image"), sizes, path)
    notes = [_columns_note(given)]
    rows, unplaced = _rows(given, found)
    names = tuple(found[given.table.texts("image")[row]] for row in rows)
    lonlat, centres = _positions(given, rows, crs, stated)
    rotations, note = table_rotations(given, rows, angles, grid_convergence_deg(crs, lonlat))
    notes.append(note)
    if unplaced:
        notes.append(f"rows without a position or angles: {first_of(unplaced, len(found))}")
    absent = [name for name in given.table.texts("image") if name not in found]
    if absent:
        notes.append(f"rows whose photo is not there: {first_of(absent, len(given.table))}")
    cameras, focal_px = _cameras(given, rows, names, sizes, camera)
    if focal_px:
        notes.append(check_focal_lengths(images, focal_px, sizes, camera or path))
    order = np.argsort(np.array(names))
    posed = PosedPhotos(
        tuple(names[i] for i in order),
        cameras.take(order),
        Poses.from_centres(rotations, centres, names).take(order),
        crs.to_string(),
    )
    return TablePoses(posed, tuple(notes))


def _columns_note(given: PoseTable) -> str:
    pose = [name for key, name in given.header.items() if key not in ("image", *LENS_KEYS)]
    what = "poses that the program found" if given.estimated else "poses"
    return f"{what} are from the columns {', '.join(pose)}"


def _place_columns(given: PoseTable) -> tuple[str, ...]:
    return ("lon", "lat") if given.has("lon", "lat") else ("x", "y")


def _rows(given: PoseTable, found: dict[str, str]) -> tuple[list[int], list[str]]:
    """Return the rows of photos that are there, and the names of those without a whole pose."""
    names = given.table.texts("image")
    columns = (*_place_columns(given), "height", *angle_columns(given))
    texts = [given.table.texts(column) for column in columns]
    there = [row for row, name in enumerate(names) if name in found]
    whole = [row for row in there if all(text[row] for text in texts)]
    if not whole:
        raise BenchmarkError("no photo has a whole pose", where=given.table.path)
    return whole, [found[names[row]] for row in sorted(set(there) - set(whole))]


def _positions(
    given: PoseTable, rows: list[int], crs: CRS, stated: CRS | None
) -> tuple[Floats, Floats]:
    """Return longitude and latitude, and centres in the CRS."""
    columns = _place_columns(given)
    first, second = (given.numbers(column, rows) for column in columns)
    height = given.numbers("height", rows)
    header = [given.header[column] for column in columns]
    small = bool((np.abs(first) <= 180.0).all() and (np.abs(second) <= 90.0).all())
    if columns == ("lon", "lat") or (given.may_be_degrees and small):
        lonlat = np.stack((first, second), axis=-1)
        _check_degrees(given, lonlat, header)
        xy = from_lonlat(crs, lonlat)
    else:
        if stated is None:
            raise UsageError(
                f"the CRS of the columns {' and '.join(header)} is not known",
                where=given.table.path,
                fix=f"give --crs, such as --crs {_code(crs)} if they are in {describe_crs(crs)}, "
                "the map's",
            )
        xy = np.stack((first, second), axis=-1)
        lonlat = to_lonlat(crs, xy)
    beyond = ~np.isfinite(np.column_stack((xy, lonlat))).all(axis=1)
    if beyond.any():
        names = [given.table.texts("image")[rows[i]] for i in np.flatnonzero(beyond)]
        raise BenchmarkError(
            f"positions beyond {describe_crs(crs)}: {first_of(names, len(rows))}",
            where=given.table.path,
        )
    return lonlat, np.column_stack((xy, height))


def _code(crs: CRS) -> str:
    authority = crs.to_authority()
    return ":".join(authority) if authority else repr(crs.name)


def _check_degrees(given: PoseTable, lonlat: Floats, header: list[str]) -> None:
    lon, lat = np.abs(lonlat).T
    if (lon > 180.0).any() or (lat > 90.0).any():
        swapped = (lat <= 180.0).all() and (lon <= 90.0).all()
        raise BenchmarkError(
            f"columns {' and '.join(header)} hold {lonlat[0, 0]:.10g} and {lonlat[0, 1]:.10g}, "
            "which is no longitude and latitude",
            where=given.table.path,
            expected="degrees, at most 180 and 90",
            fix="latitude and longitude seem to be the wrong way round: rename the columns"
            if swapped
            else "name the columns easting and northing, and give --crs, if that is what they are",
        )


def _cameras(
    given: PoseTable,
    rows: list[int],
    names: tuple[str, ...],
    sizes: dict[str, tuple[int, int]],
    camera: Path | None,
) -> tuple[Cameras, dict[str, float]]:
    """Return cameras, and the focal lengths in pixels that do not say of which size of photo."""
    columns = [key for key in LENS_KEYS if given.has(key)]
    if (camera is None) == (not columns):
        raise UsageError(
            f"cameras are given twice: by --camera and the columns {', '.join(columns)}"
            if columns
            else "no camera is given",
            where=given.table.path,
            expected="--camera FILE, or columns such as fx, or focal_mm and sensor_mm, or fov_deg",
        )
    if camera is not None:
        where, of_all = camera, read_camera_file(camera)
        values = [of_all] * len(rows)
    else:
        where = given.table.path
        parts = [given.numbers(key, rows) for key in columns]
        rowwise = np.column_stack(parts).tolist()
        values = [
            {key: value for key, value in zip(columns, row, strict=True) if not math.isnan(value)}
            for row in rowwise
        ]
    lenses = [lens_of(v, sizes[name], where) for v, name in zip(values, names, strict=True)]
    return cameras_of_lenses(lenses, names, sizes), focal_of_unknown_size(values, names)
