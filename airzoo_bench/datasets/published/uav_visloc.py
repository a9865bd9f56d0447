"""UAV-VisLoc: eleven flights over China, a satellite map of each.

::

    NN/drone/NN_0001.JPG ...    photos of flights 01 to 11
    NN/NN.csv                   filename, lat, lon, height and headings, a row a photo
    NN/satelliteNN.tif          the map; of flight 09 in tiles, satellite09_01-01.tif and so on
    satellite_ coordinates_range.csv
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from airzoo_bench.benchmark.images import photo_size
from airzoo_bench.core.errors import BenchmarkError, RasterError, UsageError, counted, first_of
from airzoo_bench.core.progress import Progress
from airzoo_bench.core.registry import Option
from airzoo_bench.datasets.about import about_of
from airzoo_bench.datasets.content import utm_zone
from airzoo_bench.datasets.dataset import Dataset
from airzoo_bench.datasets.published.maps import Bounds, MapTile, join_maps, map_tile
from airzoo_bench.datasets.published.places import find_home, missing
from airzoo_bench.datasets.scenes import NativeScene
from airzoo_bench.datasets.settings import SourceOptions
from airzoo_bench.datasets.tables import read_table
from airzoo_bench.datasets.truths import BenchmarkProtocols
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import from_lonlat, grid_convergence_deg
from airzoo_bench.geometry.poses import Poses, angles_to_rotations
from airzoo_bench.geometry.rasters import pixel_to_world

__all__ = ["UAV_VISLOC", "UavVisLocOptions"]

_LAYOUT = "NN/drone/NN_0001.JPG ..., NN/NN.csv and NN/satelliteNN.tif of flights 01 to 11"
# Phi of each flight by the table in UAV-VisLoc's README.
_PHI = (165.0, 5.0, -40.0, 170.0, 100.0, -15.0, -1.5, 100.0, -50.0, 170.0, 90.0)
_FLIGHT_PHI = {f"{number:02d}": phi for number, phi in enumerate(_PHI, 1)}
_COLUMNS = ("filename", "lat", "lon", "height")
_WITHOUT_HEADING = "07"  # whose table as published has no column of a heading
_RANGE = ("mapname", "LT_lat_map", "LT_lon_map", "RB_lat_map", "RB_lon_map")
_RANGE_TABLE = r"satellite_ ?coordinates_range\.csv"
_SEA_LEVEL_SPREAD_M = 100.0
_OFF_TABLE_PX, _OTHER_MAP_SHARE = 1.0, 0.1
_FLIGHT_TABLE, _LEAVE_OUT = "flight-table", "leave-out"


@dataclass(frozen=True)
class UavVisLocOptions(SourceOptions):
    """What UAV-VisLoc does not state."""

    heading: Annotated[
        Literal["compass", "east-north-positive", "counter-clockwise"],
        Option(
            "heading",
            "What its angle is: compass, clockwise from north; east-north-positive, as its table "
            "has it; or counter-clockwise from north.",
        ),
    ] = "compass"
    heading_column: Annotated[
        Literal["Phi1", "Phi2"], Option("heading-column", "Which of its two headings is taken.")
    ] = "Phi1"
    missing_heading: Annotated[
        str,
        Option(
            "missing-heading",
            "What photos without a heading get, as all of flight 07: flight-table (the flight's "
            "Phi in UAV-VisLoc's own table) or degrees; or leave-out.",
        ),
    ] = _FLIGHT_TABLE
    fov_across: Annotated[
        float,
        Option(
            "fov-across",
            "Degrees that a photo's width sees, across the heading.",
            least=1,
            most=170,
        ),
    ] = 52.0
    fov_along: Annotated[
        float,
        Option(
            "fov-along", "Degrees that a photo's height sees, along the heading.", least=1, most=170
        ),
    ] = 36.0
    plane_height: Annotated[
        list[str] | None,
        Option(
            "plane-height",
            "Height of the ground in the datum of the photos' heights: METRES, or FLIGHT=METRES, "
            "repeated (default: 0, as for heights above the ground).",
        ),
    ] = None
    height_above_ground: Annotated[
        float,
        Option(
            "height-above-ground",
            "Median height above the ground, in metres, assumed for flights whose heights vary as "
            "heights above sea level do, where --plane-height says nothing.",
            least=1,
            most=10_000,
        ),
    ] = 500.0
    joined_maps: Annotated[
        Path | None,
        Option(
            "joined-maps",
            "Folder for the virtual map over the tiles of flight 09 (default: where they lie).",
        ),
    ] = None
    protocol: Annotated[
        str, Option("protocol", "Retrieval protocol to make the truth for, a name or .toml file.")
    ] = "uav-visloc-retrieval"


class UavVisLoc(Dataset[UavVisLocOptions]):
    """Photos of eleven flights, to be found on a satellite map of each."""

    name = "uav-visloc"
    about = about_of("uav-visloc")
    options = UavVisLocOptions

    def benchmark_protocols(self, options: UavVisLocOptions, root: Path) -> BenchmarkProtocols:
        """Return the retrieval protocol that was asked for."""
        return BenchmarkProtocols.named((options.protocol,), root)

    def scenes(self, options: UavVisLocOptions) -> Mapping[str, Sequence[Path]]:
        """Return the flights whose folders are there, each with its photos, table and map."""
        root = find_home(options.source, lambda folder: bool(_flights(folder)), _LAYOUT)
        ranges = [p for p in root.iterdir() if re.fullmatch(_RANGE_TABLE, p.name, re.IGNORECASE)]
        # A virtual map that was written next to the tiles is none of the files.
        return {
            flight: sorted([p for p in folder.iterdir() if p.suffix.lower() != ".vrt"] + ranges)
            for flight, folder in _flights(root).items()
        }

    def read(self, options: UavVisLocOptions, scene: str, progress: Progress) -> NativeScene:
        """Read a flight: cameras look straight down, photos' tops point along the heading."""
        root = find_home(options.source, lambda folder: bool(_flights(folder)), _LAYOUT)
        folder = _flights(root)[scene]
        table = _only(folder, rf"0?{int(scene)}\.csv", f"{scene}.csv")
        images = _only(folder, "drone", "drone")
        names, lonlat, height, heading, notes = _read_rows(table, images, scene, options)
        plane = _plane_height(height, scene, options, table, notes)
        dom = _flight_map(root, folder, scene, options.joined_maps, notes)
        tangents = np.tan(np.radians((options.fov_across / 2, options.fov_along / 2)))
        shown = progress(names, "photos", len(names))
        sizes = np.array([photo_size(images / name) for name in shown], dtype=np.int64)
        crs = utm_zone(lonlat)
        convergence = grid_convergence_deg(crs, lonlat)
        if root != options.source and scene == next(iter(_flights(root))):
            notes.insert(0, f"the flights are those of {root}")
        return NativeScene(
            scene,
            images,
            names,
            Cameras(
                width=sizes[:, 0],
                height=sizes[:, 1],
                focal=sizes / (2.0 * tangents),
                principal_point=sizes / 2.0,
                distortion=np.zeros((len(names), 5)),
            ),
            Poses(
                rotation=angles_to_rotations(heading, -90.0, 0.0, convergence_deg=convergence),
                centres=np.column_stack([from_lonlat(crs, lonlat), height]),
            ),
            crs,
            dom=dom,
            plane_height_m=plane,
            unposed=tuple(sorted(set(_photos(images).values()) - set(names))),
            notes=tuple(f"flight {scene}: {note}" for note in notes),
            poses_from=table,
        )


def _flights(root: Path) -> dict[str, Path]:
    """Return the folders of the flights that are there, by flight, in order."""
    numbered = [
        p for p in sorted(root.iterdir()) if re.fullmatch(r"\d{1,2}", p.name) and p.is_dir()
    ]
    found = {f"{int(path.name):02d}": path for path in numbered}
    if len(found) < len(numbered):
        names = first_of(path.name for path in numbered)
        raise missing(f"two folders are of one flight ({names})", root, _LAYOUT, "keep one of them")
    return {flight: found[flight] for flight in sorted(found) if flight in _FLIGHT_PHI}


def _only(folder: Path, pattern: str, name: str) -> Path:
    """Return the one entry of a folder that matches, whatever its case."""
    found = [p for p in sorted(folder.iterdir()) if re.fullmatch(pattern, p.name, re.IGNORECASE)]
    if len(found) == 1:
        return found[0]
    what = f"two files could be {name}" if found else f"lacks {name}"
    raise missing(what, folder, _LAYOUT)


def _photos(images: Path) -> dict[str, str]:
    """Return the names of a flight's photos by those in lower case."""
    names = [path.name for path in images.iterdir() if path.is_file()]
    return {
        name.casefold(): name for name in names if name.lower().endswith((".jpg", ".jpeg", ".png"))
    }


def _read_rows(
    path: Path, images: Path, flight: str, options: UavVisLocOptions
) -> tuple[tuple[str, ...], Floats, Floats, Floats, list[str]]:
    """Return names, longitude and latitude, heights, compass headings, and notes."""
    column = options.heading_column
    columns = {name: (name,) for name in (*_COLUMNS, column)}
    table = read_table(path, columns, (column,) if flight == _WITHOUT_HEADING else ())
    table.require_unique("filename")
    there = _photos(images)
    listed = [name.casefold() for name in table.texts("filename")]
    absent = [name for name in listed if name not in there]
    if absent:
        raise BenchmarkError(
            f"photos of it are not in the folder drone: {first_of(absent, len(listed))}",
            where=path,
            expected="every photo of the table",
            fix="download or unpack the flight again; remove rows only to leave photos out",
        )
    lonlat = np.stack([table.numbers("lon", -180, 180), table.numbers("lat", -80, 84)], axis=1)
    height = table.numbers("height", -500, 20_000)
    phi = np.full(len(table), np.nan)
    if table.has(column):
        phi = table.numbers(column, -360, 360, empty=True)
    kept, phi, notes = _with_headings(phi, flight, options)
    heading = {"compass": phi, "east-north-positive": 90.0 - phi, "counter-clockwise": -phi}
    names = tuple(there[listed[row]] for row in kept)
    return names, lonlat[kept], height[kept], heading[options.heading][kept], notes


def _with_headings(
    phi: Floats, flight: str, options: UavVisLocOptions
) -> tuple[list[int], Floats, list[str]]:
    """Give photos without a heading the one that was chosen, or leave them out."""
    without, chosen = np.isnan(phi), options.missing_heading
    every = list(range(len(phi)))
    if not without.any():
        return every, phi, []
    count = f"{int(without.sum()):,} of {counted(len(phi), 'photo')} have no heading"
    if chosen == _LEAVE_OUT:
        if without.all():
            raise BenchmarkError(
                f"flight {flight}: {count}",
                where=f"--missing-heading {_LEAVE_OUT}",
                expected="photos with a heading",
                fix="leave the flight out (--keep-going), or choose --missing-heading "
                f"{_FLIGHT_TABLE} or degrees",
            )
        return [row for row in every if not without[row]], phi, [f"{count} and were left out"]
    value = _FLIGHT_PHI[flight] if chosen == _FLIGHT_TABLE else _number(chosen)
    if not abs(value) <= 360.0:
        raise UsageError(
            f"{chosen[:40]!r} is no heading",
            where="--missing-heading",
            expected=f"{_FLIGHT_TABLE}, {_LEAVE_OUT}, or degrees from -360 to 360",
        )
    return every, np.where(without, value, phi), [f"{count}; they got {value:g} degrees ({chosen})"]


def _plane_height(
    heights: Floats, flight: str, options: UavVisLocOptions, path: Path, notes: list[str]
) -> float:
    """Return the height of the ground in the datum of the flight's heights."""
    low, middle, high = np.percentile(heights, (5, 50, 95)).tolist()
    given = _plane_heights(options.plane_height or ())
    plane = given.get(flight, given.get("", 0.0))
    if not given.keys() & {flight, ""} and high - low > _SEA_LEVEL_SPREAD_M:
        plane = round(middle - options.height_above_ground, 1)
        notes.append(
            f"heights vary from {low:.0f} to {high:.0f} m (5th to 95th percentile), so that they "
            f"are likely above sea level: the ground was put at {plane:g} m, "
            f"{options.height_above_ground:g} m below their median; if you know better, say "
            f"--plane-height {flight}=METRES"
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
    return plane


def _plane_heights(given: Sequence[str]) -> dict[str, float]:
    """Return heights of the ground by flight; under an empty name that of all others."""
    heights: dict[str, float] = {}
    for text in given:
        flight, _, metres = text.rpartition("=")
        flight = flight.strip().zfill(2) if flight.strip() else ""
        value = _number(metres)
        if not abs(value) <= 10_000 or flight not in ("", *_FLIGHT_PHI) or flight in heights:
            raise UsageError(
                f"{text[:40]!r} is no height of the ground, or one given twice",
                where="--plane-height",
                expected="METRES or FLIGHT=METRES, such as 05=1900, flights being 01 to 11",
            )
        heights[flight] = value
    return heights


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _flight_map(
    root: Path, folder: Path, flight: str, joined: Path | None, notes: list[str]
) -> Path:
    """Find a flight's map; write a virtual one over tiles, or where it has no georeference."""
    whole = rf"(?:satellite)?0?{int(flight)}"
    tifs = [p for p in sorted(folder.iterdir()) if p.suffix.lower() in (".tif", ".tiff")]
    matches = ((p, re.fullmatch(rf"{whole}_(\d+)-(\d+)", p.stem, re.IGNORECASE)) for p in tifs)
    tiles = {(int(m[1]), int(m[2])): map_tile(path) for path, m in matches if m}
    if not tiles or any(re.fullmatch(whole, path.stem, re.IGNORECASE) for path in tifs):
        tiles = {(1, 1): map_tile(_only(folder, rf"{whole}\.tiff?", f"satellite{flight}.tif"))}
    bounds, first = _range_of(root, flight), tiles[min(tiles)]
    if len(tiles) == 1 and first.transform is not None and first.crs:
        path = first.path
    else:
        path = (joined or folder) / f"satellite{flight}.vrt"
        if path.parent.is_dir() and not path.exists() and not os.access(path.parent, os.W_OK):
            raise UsageError(
                f"{path.name} cannot be written over the map's tiles",
                where=path.parent,
                fix="name another folder for it: --joined-maps FOLDER",
            )
        join_maps(tiles, path, bounds)
        what = f"the {len(tiles)} tiles of its map" if len(tiles) > 1 else "its map"
        placed = "" if first.transform is not None else ", placed by the range table"
        notes.append(f"{path.name} was written over {what}{placed}")
    notes += _range_notes(map_tile(path), bounds)
    return path


def _range_of(root: Path, flight: str) -> Bounds | None:
    """Return left, top, right, bottom of a flight's map by the range table, if it has it."""
    if not any(re.fullmatch(_RANGE_TABLE, path.name, re.IGNORECASE) for path in root.iterdir()):
        return None
    path = _only(root, _RANGE_TABLE, "satellite_ coordinates_range.csv")
    table = read_table(path, {name: (name,) for name in _RANGE})
    stems = [Path(name).stem for name in table.texts("mapname")]
    pattern = rf"(satellite)?0?{int(flight)}"
    rows = [row for row, stem in enumerate(stems) if re.fullmatch(pattern, stem, re.IGNORECASE)]
    limits = {"lat": 90.0, "lon": 180.0}
    columns = [table.numbers(n, -limits[n[3:6]], limits[n[3:6]]) for n in _RANGE[1:]]
    if not rows:
        return None
    top, left, bottom, right = (float(column[rows[0]]) for column in columns)
    if len(rows) > 1 or not (left < right and top > bottom):
        raise BenchmarkError(
            f"more than one row is of flight {flight}"
            if len(rows) > 1
            else "left top is not above and left of right bottom",
            where=f"{path}, line {table.lines[rows[-1]]}",
            expected="a row a map, LT_lat_map > RB_lat_map and LT_lon_map < RB_lon_map",
        )
    return left, top, right, bottom


def _range_notes(tile: MapTile, bounds: Bounds | None) -> list[str]:
    """Compare a map's own bounds with those of the range table, in its pixels."""
    name, transform = tile.path.name, tile.transform
    if bounds is None or transform is None:
        return [f"the bounds of {name} were not compared: there is no row of it in a range table"]
    corners = pixel_to_world(transform, [(0, 0), (tile.width, tile.height)])
    pixel = np.array((transform.a, transform.e) * 2)
    off = float(np.abs((corners.reshape(-1) - bounds) / pixel).max())
    if off <= _OFF_TABLE_PX:
        return []
    listed = ", ".join(f"{value:.6f}" for value in bounds)
    what = f"are up to {off:,.1f} pixels off those of the range table ({listed})"
    if off > _OTHER_MAP_SHARE * min(tile.width, tile.height):
        raise RasterError(
            f"its bounds {what}",
            where=tile.path,
            expected="the map that the range table describes, in degrees",
            fix="download the map again; if it is right, remove its row from the range table",
        )
    return [f"the bounds of {name} {what}, and were taken"]


UAV_VISLOC = UavVisLoc()
