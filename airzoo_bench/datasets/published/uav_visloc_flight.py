"""A flight of UAV-VisLoc as a scene: cameras and poses from position, height and heading."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from airzoo_bench.benchmark.images import photo_size
from airzoo_bench.core.errors import BenchmarkError, UsageError, counted, first_of
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.native_tables import NativeTable, read_table
from airzoo_bench.datasets.published.options import Heading, UavVisLocOptions
from airzoo_bench.datasets.published.uav_visloc_layout import (
    drone_photos,
    flight_folders,
    flight_table,
    found_root,
)
from airzoo_bench.datasets.published.uav_visloc_map import flight_map
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import from_lonlat, grid_convergence_deg
from airzoo_bench.geometry.poses import Poses, angles_to_rotations
from airzoo_bench.geometry.rasters import gsd_m, open_info

__all__ = ["read_flight"]

_COLUMNS = ("filename", "lat", "lon", "height")
_HEADINGS = ("Phi1", "Phi2", "Phi", "Yaw", "Heading")  # what a heading may be called
_WITHOUT_HEADING = "07"  # whose table as published has no column of a heading
# Phi of each flight by the table in UAV-VisLoc's README.
_FLIGHT_PHI = dict(
    zip(
        (f"{number:02d}" for number in range(1, 12)),
        (165.0, 5.0, -40.0, 170.0, 100.0, -15.0, -1.5, 100.0, -50.0, 170.0, 90.0),
        strict=True,
    )
)
_SEA_LEVEL_SPREAD_M = 100.0
_FLIGHT_TABLE, _LEAVE_OUT = "flight-table", "leave-out"


@dataclass(frozen=True, eq=False)
class _Rows:
    """A flight's table: a row a photo."""

    names: tuple[str, ...]
    lonlat: Floats
    height: Floats
    phi: Floats

    def take(self, rows: Bools) -> _Rows:
        names = tuple(name for name, kept in zip(self.names, rows.tolist(), strict=True) if kept)
        return _Rows(names, self.lonlat[rows], self.height[rows], self.phi[rows])


def read_flight(options: UavVisLocOptions, flight: str, progress: Progress) -> NativeScene:
    """Read a flight of UAV-VisLoc."""
    root = found_root(options.source)
    folders = flight_folders(root)
    folder = folders[flight]
    images, there = drone_photos(folder)
    path = flight_table(folder, flight)
    rows, notes = _with_headings(_read_rows(path, there, flight, options), flight, options)
    plane, plane_notes = _plane_height(rows.height, flight, options, path)
    dom = flight_map(root, folder, flight, options.joined_maps)
    crs = _utm_zone(rows.lonlat)
    map_notes = _small_map(dom.path, float(np.median(rows.height)) - plane, options)
    if root != options.source and flight == next(iter(folders)):
        notes = (f"the flights are those of {root}", *notes)
    every = (*notes, *plane_notes, *dom.notes, *map_notes)
    return NativeScene(
        scene=flight,
        images=images,
        names=rows.names,
        cameras=_cameras(images, rows.names, options, progress),
        poses=_poses(rows, crs, options.heading),
        crs=crs,
        dom=dom.path,
        plane_height_m=plane,
        unposed=tuple(sorted(set(there.values()) - set(rows.names))),
        notes=tuple(f"flight {flight}: {note}" for note in every),
    )


def _read_rows(
    path: Path, there: Mapping[str, str], flight: str, options: UavVisLocOptions
) -> _Rows:
    column = options.heading_column
    optional = (column,) if flight == _WITHOUT_HEADING else ()
    table = read_table(path, (*_COLUMNS, column), optional, synonyms={column: _HEADINGS})
    if not len(table):
        raise BenchmarkError("has no rows", where=path, expected="a row a photo")
    table.require_unique("filename")
    names = _names(table, there)
    lonlat = np.stack([table.numbers("lon", -180, 180), table.numbers("lat", -80, 84)], axis=1)
    headed = column in table.columns
    phi = table.numbers(column, -360, 360, empty=True) if headed else np.full(len(table), np.nan)
    return _Rows(names, lonlat, table.numbers("height", -500, 20_000), phi)


def _names(table: NativeTable, there: Mapping[str, str]) -> tuple[str, ...]:
    """Return the photos' names as they are on disk."""
    listed = table.texts("filename")
    missing = [name for name in listed if name.casefold() not in there]
    if missing:
        raise BenchmarkError(
            f"photos of it are not in the folder drone: {first_of(missing, len(listed))}",
            where=table.path,
            expected="every photo of the table",
            fix="download or unpack the flight again; remove rows only to leave photos out",
        )
    return tuple(there[name.casefold()] for name in listed)


def _with_headings(
    rows: _Rows, flight: str, options: UavVisLocOptions
) -> tuple[_Rows, tuple[str, ...]]:
    """Give photos without a heading the one that was chosen, or leave them out."""
    without = np.isnan(rows.phi)
    if not without.any():
        return rows, ()
    count = f"{int(without.sum()):,} of {counted(len(without), 'photo')} have no heading"
    if options.missing_heading == _LEAVE_OUT:
        if without.all():
            raise BenchmarkError(
                f"flight {flight}: {count}",
                where=f"--missing-heading {_LEAVE_OUT}",
                expected="photos with a heading",
                fix="leave the flight out (--keep-going), or choose --missing-heading "
                f"{_FLIGHT_TABLE} or degrees",
            )
        return rows.take(~without), (f"{count} and were left out",)
    taken = options.missing_heading == _FLIGHT_TABLE
    phi = _FLIGHT_PHI[flight] if taken else _degrees(options.missing_heading)
    source = "the flight's Phi in UAV-VisLoc's table" if taken else "--missing-heading"
    filled = np.where(without, phi, rows.phi)
    return (
        _Rows(rows.names, rows.lonlat, rows.height, filled),
        (f"{count}; they got {phi:g} degrees ({source})",),
    )


def _degrees(text: str) -> float:
    value = _number(text)
    if not abs(value) <= 360.0:
        raise UsageError(
            f"{text[:40]!r} is no heading",
            where="--missing-heading",
            expected=f"{_FLIGHT_TABLE}, {_LEAVE_OUT}, or degrees from -360 to 360",
        )
    return value


def _plane_height(
    heights: Floats, flight: str, options: UavVisLocOptions, path: Path
) -> tuple[float, tuple[str, ...]]:
    """Return the height of the ground in the datum of the flight's heights."""
    notes: tuple[str, ...] = ()
    low, middle, high = np.percentile(heights, (5, 50, 95)).tolist()
    given = _plane_heights(options.plane_height or ())
    plane = given.get(flight, given.get("", 0.0))
    if not given.keys() & {flight, ""} and high - low > _SEA_LEVEL_SPREAD_M:
        plane = round(middle - options.height_above_ground, 1)
        notes = (
            f"heights vary from {low:.0f} to {high:.0f} m (5th to 95th percentile), so that they "
            f"are likely above sea level: the ground was put at {plane:g} m, "
            f"{options.height_above_ground:g} m below their median; if you know better, say "
            f"--plane-height {flight}=METRES",
        )
    below = int((heights <= plane).sum())
    if below:
        raise BenchmarkError(
            f"{below:,} of {counted(len(heights), 'photo')} were taken at or below the ground: the "
            f"lowest at {heights.min():g} m, the ground is at {plane:g} m",
            where=path,
            expected="heights above the ground",
            fix=f"give the height of the ground: --plane-height {flight}=METRES",
        )
    return plane, notes


def _small_map(path: Path, above: float, options: UavVisLocOptions) -> tuple[str, ...]:
    """Warn of a map that few photos can have a corner on, as that of flight 07."""
    info = open_info(path)
    width, height = np.array((info.width, info.height)) * gsd_m(info)
    tangents = np.tan(np.radians((options.fov_across / 2, options.fov_along / 2)))
    across, along = 2.0 * above * tangents
    if min(width, height) >= along:
        return ()
    return (
        f"its map is {width:.0f} x {height:.0f} m, and a photo sees {across:.0f} x {along:.0f} m: "
        "photos of which no corner lies on the map are no queries; if the photos were taken lower, "
        "say --plane-height; a flight without any query is left out by --keep-going",
    )


def _plane_heights(given: Sequence[str]) -> dict[str, float]:
    """Return heights of the ground by flight; under an empty name that of all others."""
    heights: dict[str, float] = {}
    for text in given:
        flight, _, metres = text.rpartition("=")
        flight = flight.strip().zfill(2) if flight.strip() else ""
        value = _number(metres)
        if not abs(value) <= 10_000 or (flight and flight not in _FLIGHT_PHI):
            raise UsageError(
                f"{text[:40]!r} is no height of the ground",
                where="--plane-height",
                expected="METRES or FLIGHT=METRES, such as 05=1900, flights being 01 to 11",
            )
        if flight in heights:
            raise UsageError(f"{flight or 'all flights'} given twice", where="--plane-height")
        heights[flight] = value
    return heights


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _cameras(
    images: Path, names: tuple[str, ...], options: UavVisLocOptions, progress: Progress
) -> Cameras:
    """Return pinholes whose width sees `fov_across` and whose height `fov_along`."""
    shown = progress(names, "photos", len(names))
    sizes = np.array([photo_size(images / name) for name in shown], dtype=np.int64)
    tangents = np.tan(np.radians((options.fov_across / 2, options.fov_along / 2)))
    return Cameras(
        width=sizes[:, 0],
        height=sizes[:, 1],
        focal=sizes / (2.0 * tangents),
        principal_point=sizes / 2.0,
        distortion=np.zeros((len(names), 5)),
    )


def _poses(rows: _Rows, crs: str, heading: Heading) -> Poses:
    """Return cameras that look straight down, the top of the photo towards the heading."""
    yaw = {
        "compass": rows.phi,
        "east-north-positive": 90.0 - rows.phi,
        "counter-clockwise": -rows.phi,
    }[heading]
    convergence = grid_convergence_deg(crs, rows.lonlat)
    rotation = angles_to_rotations(yaw, -90.0, 0.0, convergence_deg=convergence)
    xy = from_lonlat(crs, rows.lonlat)
    return Poses(rotation=rotation, centres=np.concatenate([xy, rows.height[:, None]], axis=1))


def _utm_zone(lonlat: Floats) -> str:
    lon, lat = np.median(lonlat, axis=0).tolist()
    zone = min(60, int((lon + 180.0) // 6.0) + 1)
    return f"EPSG:{(32600 if lat >= 0 else 32700) + zone}"
