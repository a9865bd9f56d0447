"""A table of poses as a dataset, as Metashape, Pix4D, DJI Terra and people write it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from pyproj import CRS

from airzoo_bench.core.errors import BenchmarkError, UsageError, counted, first_of
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.about import load_about
from airzoo_bench.datasets.cameras import attitudes_to_rotations, read_camera_file, stated_cameras
from airzoo_bench.datasets.content import photo_sizes
from airzoo_bench.datasets.scenes import NativeScene, PosedPhotos
from airzoo_bench.datasets.settings import Convention, PoseTableOptions
from airzoo_bench.datasets.surveys.survey import Survey, map_crs, posed_scene, stated_crs
from airzoo_bench.datasets.tables import Table, match_names, plain, read_native_text, read_table
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import describe_crs, from_lonlat, grid_convergence_deg, to_lonlat
from airzoo_bench.geometry.poses import Poses

# What programs call a column, see `tables.plain`.
_POSE: Mapping[str, tuple[str, ...]] = {
    "lat": ("lat", "latitude", "gpslatitude"),
    "lon": ("lon", "lng", "longitude", "gpslongitude", "gpslongtitude"),
    "x": ("x", "easting", "east", "e", "x/easting", "x/longitude"),
    "y": ("y", "northing", "north", "n", "y/northing", "y/latitude"),
    "height": (
        *("height", "altitude", "alt", "z", "z/altitude", "elevation", "ellipsoidalheight"),
        *("ellipsoidheight", "gpsaltitude", "absolutealtitude"),
    ),
    "yaw": ("yaw", "gimbalyaw", "gimbalyawdegree"),
    "pitch": ("pitch", "gimbalpitch", "gimbalpitchdegree"),
    "roll": ("roll", "gimbalroll", "gimbalrolldegree"),
    "omega": ("omega",),
    "phi": ("phi",),
    "kappa": ("kappa",),
}
_IMAGE = ("image", "imagename", "label", "name", "filename", "file", "photo", "sourcefile")
_YAW, _OMEGA = ("yaw", "pitch", "roll"), ("omega", "phi", "kappa")
_MOST_OFF_NADIR_DEG, _OBLIQUE_DEG = 65.0, -20.0
_EXPECTED = (
    "columns such as image, latitude, longitude, height, yaw, pitch, roll; or image, easting, "
    "northing, height, omega, phi, kappa, in metres and degrees"
)


class _PoseTables(Survey[PoseTableOptions]):
    """Photos with their poses in a table."""

    about = load_about("poses")
    options = PoseTableOptions
    needs = ("images", "dom", "camera")
    needs_ground = True

    def read(self, options: PoseTableOptions, scene: str, progress: Progress) -> NativeScene:
        images, path = options.images or Path(), options.source
        sizes = photo_sizes(images, progress)
        table, notes = _read(path)
        found = match_names(table.texts("image"), sizes, path)
        rows = _whole_rows(table, found, notes)
        names = [found[table.texts("image")[row]] for row in rows]
        crs = stated_crs(options) or map_crs(options.dsm, options.dom)
        lonlat, centres = _positions(table, rows, crs, stated=options.crs is not None)
        rotations = _rotations(
            table, rows, options.angles, grid_convergence_deg(crs, lonlat), notes
        )
        camera = options.camera or Path()
        values = dict.fromkeys(names, read_camera_file(camera))
        cameras = stated_cameras(values, sizes, images, camera)
        poses = Poses.from_centres(rotations, centres, names)
        photos = PosedPhotos(tuple(names), cameras, poses, crs.to_string())
        photos = photos.take(np.argsort(np.array(names)).tolist())
        return posed_scene(options, scene, images, sizes, photos, path, progress, notes=notes)


def _read(path: Path) -> tuple[Table, list[str]]:
    """Read the table; estimated poses go before given ones, and a note says so."""
    head = read_native_text(path).splitlines()[:20]
    there = {plain(name) for line in head for name in re.split(r"[,;\t]|\s+", line)}
    # Metashape writes what was given, and what it found under the same names with this ending.
    found = {ours: tuple(f"{name}est" for name in names) for ours, names in _POSE.items()}
    has = {ours for ours, names in found.items() if there & set(names)}
    estimated = "height" in has and ({"x", "y"} <= has or {"lat", "lon"} <= has)
    columns = {**(found if estimated else _POSE), "image": _IMAGE}
    table = read_table(path, columns, optional=set(columns), blanks=True)
    if not table.has("image", "height", *_place_columns(table), *_angle_columns(table)):
        what = f"its columns are {', '.join(table.names)[:300]!r}, which name no pose"
        raise BenchmarkError(what, where=path, expected=_EXPECTED)
    table.require_unique("image")
    what = "poses that the program found" if estimated else "poses"
    used = [name for ours, name in table.header.items() if ours in _POSE]
    return table, [f"{what} are from the columns {', '.join(used)}"]


def _whole_rows(table: Table, found: Mapping[str, str], notes: list[str]) -> list[int]:
    """Return the rows of photos that are there with a whole pose, and note the others."""
    names = table.texts("image")
    columns = [*_place_columns(table), "height", *_angle_columns(table)]
    texts = [table.texts(column) for column in columns]
    whole = [
        row for row, name in enumerate(names) if name in found and all(text[row] for text in texts)
    ]
    if not whole:
        raise BenchmarkError("no photo has a whole pose", where=table.path)
    if len(whole) < len(table):
        listed = first_of(sorted({*names} - {names[row] for row in whole}), len(table))
        notes.append(f"rows without a photo, a position or angles: {listed}")
    return whole


def _place_columns(table: Table) -> tuple[str, str]:
    return ("lon", "lat") if table.has("lon", "lat") else ("x", "y")


def _angle_columns(table: Table) -> tuple[str, ...]:
    return _OMEGA if table.has(*_OMEGA) else _YAW


def _positions(
    table: Table, rows: Sequence[int], crs: CRS, *, stated: bool
) -> tuple[Floats, Floats]:
    """Return longitude and latitude, and centres in the CRS."""
    columns = _place_columns(table)
    pair = np.stack([table.numbers(column, empty=True)[rows] for column in columns], axis=-1)
    on_earth = bool((np.abs(pair) <= (180.0, 90.0)).all())
    # Metashape writes X/Longitude, and then X_est, for metres as for degrees.
    names_lon = any("lon" in name.casefold() for name in table.names)
    lonlat = xy = np.full_like(pair, np.nan)
    if on_earth and (columns == ("lon", "lat") or names_lon):
        lonlat, xy = pair, from_lonlat(crs, pair)
    elif columns == ("x", "y") and stated:
        lonlat, xy = to_lonlat(crs, pair), pair
    if not np.isfinite(np.column_stack((xy, lonlat))).all():
        header = " and ".join(table.header[column] for column in columns)
        raise UsageError(
            f"the columns {header} hold {pair[0, 0]:.10g} and {pair[0, 1]:.10g}, whose CRS is not "
            f"known, or are beyond {describe_crs(crs)}",
            where=table.path,
            expected="degrees, at most 180 and 90 in size, or eastings and northings of --crs",
            fix="look whether they are the wrong way round; name the columns easting and northing, "
            "and give --crs",
        )
    return lonlat, np.column_stack((xy, table.numbers("height", empty=True)[rows]))


def _rotations(
    table: Table,
    rows: Sequence[int],
    wanted: Convention | None,
    convergence_deg: Floats,
    notes: list[str],
) -> Floats:
    """Return the rotations of some rows, and note how they were read."""
    convention, photogrammetric = _convention(table, wanted), table.has(*_OMEGA)
    columns = _angle_columns(table)
    angles = np.column_stack([table.numbers(c, -360, 360, empty=True)[rows] for c in columns])
    heading = angles[:, 2] if photogrammetric else angles[:, 0]
    off = np.abs(angles[:, 1]).max() > 0.5 if convention == "gimbal" else np.abs(heading).max() > 1
    if np.abs(angles).max() <= 2.0 * math.pi and off:
        what = f"{', '.join(table.header[column] for column in columns)} look like radians"
        raise BenchmarkError(what, where=table.path, fix="multiply them by 57.29578")
    north = "the grid's" if photogrammetric else "true"
    notes.append(f"angles are read as {convention}, relative to {north} north")
    convergence = 0.0 if photogrammetric else convergence_deg
    rotations = attitudes_to_rotations(convention, angles, convergence_deg=convergence)
    if wanted is None:
        _check_down(table, rotations, float(np.median(angles[:, 1])), convention)
    return rotations


def _convention(table: Table, wanted: Convention | None) -> Convention:
    """Return the convention that was asked for, or that the columns' names tell."""
    by_name: Convention | None = None
    if table.has(*_OMEGA):
        by_name = "omega-phi-kappa"
    elif "gimbal" in table.header["yaw"].casefold():
        by_name = "gimbal"
    elif plain(table.header["image"]) in ("label", "imagename"):
        by_name = "airframe"
    found = wanted or by_name
    if found is None or (found == "omega-phi-kappa") != table.has(*_OMEGA):
        raise UsageError(
            f"what {', '.join(_angle_columns(table))} mean is not known",
            where=table.path,
            expected="columns such as GimbalYawDegree, or a table of Metashape or Pix4D",
            fix="--angles gimbal if pitch is -90 where a camera looks straight down, --angles "
            "airframe if it is 0 there",
        )
    return found


def _check_down(table: Table, rotations: Floats, pitch: float, convention: str) -> None:
    """Refuse a convention known by names only that turns most cameras away from the ground.

    Gimbal angles of photos straight down, read as airframe, look back at the horizon; oblique ones
    look at the ground either way.
    """
    away = -rotations[:, 2, 2] < math.cos(math.radians(_MOST_OFF_NADIR_DEG))
    if away.mean() > 0.5 or (convention == "airframe" and pitch < _OBLIQUE_DEG):
        what = f"read as {convention}, {int(away.sum())} of {counted(len(away), 'camera')} look "
        what += f"away from the ground; pitch is {pitch:.6g}"
        expected = "gimbal pitch is -90 straight down, airframe pitch 0"
        fix = "name the convention with --angles gimbal, airframe or omega-phi-kappa"
        raise UsageError(what, where=table.path, expected=expected, fix=fix)


POSES = _PoseTables()
