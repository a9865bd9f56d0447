"""Cameras and poses of photos out of a table of positions and angles."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from pyproj import CRS

from airzoo_bench.core.errors import BenchmarkError, UsageError, first_of
from airzoo_bench.core.plurals import counted
from airzoo_bench.datasets.poses import PosedPhotos
from airzoo_bench.datasets.surveys.attitude import Convention, attitudes_to_rotations
from airzoo_bench.datasets.surveys.lenses import (
    LENS_KEYS,
    cameras_of_lenses,
    lens_of,
    read_camera_file,
)
from airzoo_bench.datasets.surveys.names import match_names
from airzoo_bench.datasets.surveys.pose_table import PoseTable, read_pose_table
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import describe_crs
from airzoo_bench.geometry.frames import from_lonlat, to_lonlat
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.units import grid_convergence_deg

__all__ = ["AngleSettings", "TablePoses", "read_table_poses"]

_YAW = ("yaw", "pitch", "roll")
_OMEGA = ("omega", "phi", "kappa")
_MOST_OFF_NADIR_DEG = 65.0
_MOST_AWAY = 0.5  # of the photos


@dataclass(frozen=True)
class AngleSettings:
    """What a table of poses may leave open.

    Attributes
    ----------
    convention : Convention or None
        None for what the columns' names say.
    unit : str or None
        None for degrees, unless all look like radians, which is refused.
    north : str or None
        What angles are relative to. None for true north with yaw, and the grid's with kappa.
    """

    convention: Convention | None = None
    unit: Literal["degrees", "radians"] | None = None
    north: Literal["true", "grid"] | None = None


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
    sizes: dict[str, tuple[int, int]],
    crs: CRS,
    stated: CRS | None,
    angles: AngleSettings,
    camera: Path | None,
) -> TablePoses:
    """Read cameras and poses from a table.

    Parameters
    ----------
    path : Path
        See `pose_table.read_pose_table`.
    sizes : dict of str to (width, height)
        The photos that there are.
    crs : CRS
        Projected: that the poses are wanted in.
    stated : CRS or None
        That of easting and northing, as the user says it; where it is None these are refused.
    angles : AngleSettings
    camera : Path or None
        Camera of all photos (`lenses.read_camera_file`), where no columns give it.

    Raises
    ------
    UserError
        The table is not as described, names no photo, or leaves open what an option must settle.
    """
    given = read_pose_table(path)
    found = match_names(given.table.texts("image"), sizes, path)
    notes = [_columns_note(given)]
    rows, unplaced = _rows(given, found)
    names = tuple(found[given.table.texts("image")[row]] for row in rows)
    lonlat, centres = _positions(given, rows, crs, stated)
    convention = _convention(given, angles.convention)
    degrees = _degrees(given, rows, convention, angles.unit)
    north = angles.north or ("grid" if convention == "omega-phi-kappa" else "true")
    convergence = grid_convergence_deg(crs, lonlat) if north == "true" else 0.0
    rotations = attitudes_to_rotations(convention, degrees, convergence_deg=convergence)
    if angles.convention is None:
        _check_down(rotations, degrees, convention, path)
    notes.append(f"angles are read as {convention}, relative to {north} north")
    if unplaced:
        notes.append(f"rows without a position or angles: {first_of(unplaced, len(found))}")
    absent = [name for name in given.table.texts("image") if name not in found]
    if absent:
        notes.append(f"rows whose photo is not there: {first_of(absent, len(given.table))}")
    cameras = _cameras(given, rows, names, sizes, camera)
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


def _angle_columns(given: PoseTable) -> tuple[str, ...]:
    return _OMEGA if given.has(*_OMEGA) else _YAW


def _place_columns(given: PoseTable) -> tuple[str, ...]:
    return ("lon", "lat") if given.has("lon", "lat") else ("x", "y")


def _rows(given: PoseTable, found: dict[str, str]) -> tuple[list[int], list[str]]:
    """Return the rows of photos that are there, and the names of those without a whole pose."""
    names = given.table.texts("image")
    columns = (*_place_columns(given), "height", *_angle_columns(given))
    texts = [given.table.texts(column) for column in columns]
    there = [row for row, name in enumerate(names) if name in found]
    whole = [row for row in there if all(text[row] for text in texts)]
    if not whole:
        raise BenchmarkError("no photo has a whole pose", where=given.table.path)
    return whole, [found[names[row]] for row in sorted(set(there) - set(whole))]


def _numbers(given: PoseTable, column: str, rows: list[int], most: float = math.inf) -> Floats:
    return given.table.numbers(column, -most, most, empty=True)[rows]


def _positions(
    given: PoseTable, rows: list[int], crs: CRS, stated: CRS | None
) -> tuple[Floats, Floats]:
    """Return longitude and latitude, and centres in the CRS."""
    columns = _place_columns(given)
    first, second = (_numbers(given, column, rows) for column in columns)
    height = _numbers(given, "height", rows)
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


def _convention(given: PoseTable, wanted: Convention | None) -> Convention:
    """Return the convention that was asked for, or that the columns' names tell."""
    columns = _angle_columns(given)
    by_name = _named_convention(given)
    if wanted is None and by_name is None:
        raise UsageError(
            "what yaw, pitch and roll mean is not known",
            where=given.table.path,
            expected="columns such as GimbalYawDegree (gimbal), or a table as Metashape or Pix4D "
            "write it",
            fix="--angles gimbal if pitch is -90 where a camera looks straight down, --angles "
            "airframe if it is 0 there; pitch is "
            f"{np.nanmedian(given.table.numbers('pitch', empty=True)):.6g} in the median",
        )
    if wanted is not None and (wanted == "omega-phi-kappa") != (columns == _OMEGA):
        raise UsageError(
            f"--angles {wanted} does not go with the columns {', '.join(columns)}",
            where=given.table.path,
        )
    return wanted or by_name or "gimbal"


def _named_convention(given: PoseTable) -> Convention | None:
    if _angle_columns(given) == _OMEGA:
        return "omega-phi-kappa"
    if "gimbal" in given.header["yaw"].casefold():
        return "gimbal"
    title = given.header["image"].casefold()
    return "airframe" if title in ("label", "imagename") else None


def _degrees(given: PoseTable, rows: list[int], convention: Convention, unit: str | None) -> Floats:
    columns = _angle_columns(given)
    values = np.column_stack([_numbers(given, column, rows, 1e4) for column in columns])
    if unit == "radians":
        return np.degrees(values)
    if unit is None and _look_like_radians(values, convention):
        low, high = values.min(), values.max()
        raise BenchmarkError(
            f"all of {', '.join(given.header[c] for c in columns)} are within {low:.4g} and "
            f"{high:.4g}: they look like radians",
            where=given.table.path,
            expected="degrees",
            fix="--angle-unit radians, or --angle-unit degrees if they are",
        )
    return values


def _look_like_radians(values: Floats, convention: Convention) -> bool:
    """Whether angles of a survey in degrees would hardly be so small."""
    if (np.abs(values) > 2.0 * math.pi).any():
        return False
    if convention == "gimbal":
        return bool(np.abs(values[:, 1]).max() > 0.5)  # a camera 0.5 to 6 degrees off the horizon
    heading = values[:, 2] if convention == "omega-phi-kappa" else values[:, 0]
    return bool(np.abs(heading).max() > 1.0)


def _check_down(rotations: Floats, degrees: Floats, convention: str, path: Path) -> None:
    """Refuse what turns most cameras away from the ground, where the convention is by names only.

    Gimbal angles of photos straight down, read as airframe, look back at the horizon.
    """
    away = -rotations[:, 2, 2] < math.cos(math.radians(_MOST_OFF_NADIR_DEG))
    if away.mean() > _MOST_AWAY:
        raise BenchmarkError(
            f"read as {convention}, {counted(int(away.sum()), 'camera')} of {len(away)} look more "
            f"than {_MOST_OFF_NADIR_DEG:g} degrees away from straight down; the second angle is "
            f"{np.median(degrees[:, 1]):.6g} degrees in the median",
            where=path,
            expected="photos of the ground: gimbal pitch is -90 straight down, airframe pitch 0",
            fix="name the convention with --angles gimbal, airframe or omega-phi-kappa",
        )


def _cameras(
    given: PoseTable,
    rows: list[int],
    names: tuple[str, ...],
    sizes: dict[str, tuple[int, int]],
    camera: Path | None,
) -> Cameras:
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
        parts = [_numbers(given, key, rows) for key in columns]
        rowwise = np.column_stack(parts).tolist()
        values = [
            {key: value for key, value in zip(columns, row, strict=True) if not math.isnan(value)}
            for row in rowwise
        ]
    lenses = [lens_of(v, sizes[name], where) for v, name in zip(values, names, strict=True)]
    return cameras_of_lenses(lenses, names, sizes)
