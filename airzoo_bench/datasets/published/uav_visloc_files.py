"""The files of UAV-VisLoc: where a flight's photos, table and map are."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.errors import BenchmarkError, RasterError, UsageError, first_of
from airzoo_bench.core.ids import PHOTO_SUFFIXES
from airzoo_bench.datasets.joined_maps import Bounds, MapTile, join_maps, map_tile
from airzoo_bench.datasets.native_tables import read_table
from airzoo_bench.geometry.rasters import pixel_to_world

__all__ = [
    "FlightMap",
    "drone_photos",
    "flight_files",
    "flight_folders",
    "flight_map",
    "flight_table",
    "found_root",
]

FLIGHTS = tuple(f"{number:02d}" for number in range(1, 12))
_LAYOUT = "NN/drone/NN_0001.JPG ..., NN/NN.csv and NN/satelliteNN.tif of flights 01 to 11"
_RANGE_TABLE = r"satellite_ ?coordinates_range\.csv"
_RANGE_COLUMNS = ("mapname", "LT_lat_map", "LT_lon_map", "RB_lat_map", "RB_lon_map")
_NOT_UNPACKED = (".zip", ".rar", ".7z", ".tar", ".gz", ".part", ".crdownload", ".aria2", ".tmp")
_OFF_TABLE_PX = 1.0
_OTHER_MAP_SHARE = 0.1


@dataclass(frozen=True)
class FlightMap:
    """A flight's map, and sentences about it."""

    path: Path
    notes: tuple[str, ...]


def found_root(source: Path) -> Path:
    """Return the folder with the flights: the source, or the only folder in it that has some.

    Raises
    ------
    UserError
        There is none or more than one; what was found is shown.
    """
    if not source.is_dir():
        raise UsageError(
            "no such folder" if not source.exists() else "a file, not a folder",
            where=source,
            expected=f"the folder of UAV-VisLoc: {_LAYOUT}",
            fix="unpack the archive" if source.is_file() else None,
        )
    if _numbered(source):
        return source
    folders = [path for path in sorted(source.iterdir()) if path.is_dir()]
    below = [path for path in folders if os.access(path, os.R_OK | os.X_OK) and _numbered(path)]
    if len(below) == 1:
        return below[0]
    raise BenchmarkError(
        f"several folders hold flights: {first_of(folder.name for folder in below)}"
        if below
        else f"holds no flight of UAV-VisLoc, but {_listed(source)}",
        where=source,
        expected=_LAYOUT,
        fix="name one of them" if below else _unpack(source),
    )


def flight_folders(root: Path) -> dict[str, Path]:
    """Return the folders of the flights that are there, by flight, in order.

    Raises
    ------
    BenchmarkError
        Two folders are of one flight.
    """
    found: dict[str, Path] = {}
    for flight, folder in _numbered(root):
        if flight in found:
            raise BenchmarkError(
                f"two folders are of flight {flight}: {found[flight].name}, {folder.name}",
                where=root,
                fix="keep one of them",
            )
        found[flight] = folder
    return found


def _numbered(root: Path) -> list[tuple[str, Path]]:
    entries = [
        (f"{int(path.name):02d}", path)
        for path in root.iterdir()
        if re.fullmatch(r"[0-9]{1,2}", path.name) and path.is_dir()
    ]
    return sorted(entry for entry in entries if entry[0] in FLIGHTS)


def flight_files(source: Path, flight: str) -> list[Path]:
    """Return what a flight is read from; a virtual map that was written next to it is not."""
    root = found_root(source)
    folder = flight_folders(root)[flight]
    own = [path for path in folder.iterdir() if path.is_dir() or path.suffix.lower() != ".vrt"]
    return sorted([*own, *_range_tables(root)])


def flight_table(folder: Path, flight: str) -> Path:
    """Return a flight's table ``NN.csv``; see `_only` for errors."""
    return _only(folder, rf"0?{int(flight)}\.csv", f"{flight}.csv")


def drone_photos(folder: Path) -> tuple[Path, dict[str, str]]:
    """Return the folder of a flight's photos, and their names by their names in lower case.

    Raises
    ------
    BenchmarkError
        It is missing or empty, or two names differ in case only.
    """
    drone = _only(folder, "drone", "drone")
    names: dict[str, str] = {}
    for path in sorted(drone.iterdir() if drone.is_dir() else ()):
        if path.suffix.lower() not in PHOTO_SUFFIXES or path.name.startswith("."):
            continue
        other = names.setdefault(path.name.casefold(), path.name)
        if other != path.name:
            raise BenchmarkError(
                f"two photos differ in case only: {other}, {path.name}",
                where=drone,
                fix="keep one of them",
            )
    if not names:
        raise BenchmarkError(
            f"holds no photo, but {_listed(drone)}" if drone.is_dir() else "is no folder",
            where=drone,
            expected="NN_0001.JPG and so on",
            fix=_unpack(folder),
        )
    return drone, names


def flight_map(root: Path, folder: Path, flight: str, joined: Path | None) -> FlightMap:
    """Find a flight's map; write a virtual one over tiles, or where it has no georeference.

    Parameters
    ----------
    root, folder : Path
        Of all flights, and of this one.
    flight : str
    joined : Path, optional
        Where a virtual map is written; by default into `folder`.

    Raises
    ------
    UserError
        It is missing, tiles do not fit together, neither map nor range table says where it lies,
        or they contradict each other.
    """
    whole = rf"(?:satellite)?0?{int(flight)}"
    tiles = {
        (int(found[1]), int(found[2])): map_tile(path)
        for path in _tifs(folder)
        if (found := re.fullmatch(rf"{whole}_(\d+)-(\d+)", path.stem, re.IGNORECASE))
    }
    wholes = [path for path in _tifs(folder) if re.fullmatch(whole, path.stem, re.IGNORECASE)]
    if not tiles or wholes:
        tiles = {(1, 1): map_tile(_only(folder, rf"{whole}\.tiff?", f"satellite{flight}.tif"))}
    bounds, table = _range_of(root, flight)
    first = tiles[min(tiles)]
    if len(tiles) == 1 and first.transform is not None and first.crs:
        path, notes = first.path, []
    else:
        path = (joined or folder) / f"satellite{flight}.vrt"
        _check_writable(path)
        join_maps(tiles, path, bounds)
        notes = [_joined_note(tiles, path)]
    return FlightMap(path, (*notes, *_range_notes(map_tile(path), bounds, table)))


def _check_writable(path: Path) -> None:
    if path.parent.is_dir() and not path.exists() and not os.access(path.parent, os.W_OK):
        raise UsageError(
            f"{path.name} cannot be written over the map's tiles",
            where=path.parent,
            expected="a folder that can be written to",
            fix="name another folder for it: --joined-maps FOLDER",
        )


def _joined_note(tiles: dict[tuple[int, int], MapTile], path: Path) -> str:
    what = f"the {len(tiles)} tiles of its map" if len(tiles) > 1 else "its map"
    placed = "" if tiles[min(tiles)].transform is not None else ", placed by the range table"
    return f"{path.name} was written over {what}{placed}"


def _tifs(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in (".tif", ".tiff"))


def _range_tables(root: Path) -> list[Path]:
    return [path for path in root.iterdir() if re.fullmatch(_RANGE_TABLE, path.name, re.IGNORECASE)]


def _range_of(root: Path, flight: str) -> tuple[Bounds | None, Path | None]:
    """Return left, top, right, bottom of a flight's map by the range table, if it has it."""
    if not _range_tables(root):
        return None, None
    path = _only(root, _RANGE_TABLE, "satellite_ coordinates_range.csv")
    table = read_table(path, _RANGE_COLUMNS)
    rows = [
        row
        for row, name in enumerate(table.texts("mapname"))
        if re.fullmatch(rf"(satellite)?0?{int(flight)}", Path(name).stem, re.IGNORECASE)
    ]
    if len(rows) > 1:
        lines = " and ".join(str(table.lines[row]) for row in rows)
        raise BenchmarkError(
            f"more than one row is of flight {flight}: lines {lines}",
            where=path,
            expected="a row a map",
        )
    limits = {"lat": 90.0, "lon": 180.0}
    tops, lefts, bottoms, rights = (
        table.numbers(name, -limits[name[3:6]], limits[name[3:6]]) for name in _RANGE_COLUMNS[1:]
    )
    if not rows:
        return None, path
    left, top, right, bottom = (float(s[rows[0]]) for s in (lefts, tops, rights, bottoms))
    if not (left < right and top > bottom):
        raise BenchmarkError(
            f"left top {top:g}, {left:g} is not above and left of right bottom {bottom:g}, "
            f"{right:g}",
            where=f"{path}, line {table.lines[rows[0]]}",
            expected="LT_lat_map > RB_lat_map and LT_lon_map < RB_lon_map",
        )
    return (left, top, right, bottom), path


def _range_notes(tile: MapTile, bounds: Bounds | None, table: Path | None) -> list[str]:
    """Compare a map's own bounds with those of the range table, in its pixels."""
    if bounds is None or tile.transform is None:
        where = f"{table.name} has no row of it" if table else "there is no range table"
        return [f"{where}, so that the bounds of {tile.path.name} were not compared with it"]
    (left, top), (right, bottom) = pixel_to_world(
        tile.transform, [(0, 0), (tile.width, tile.height)]
    ).tolist()
    pixel = (tile.transform.a, tile.transform.e, tile.transform.a, tile.transform.e)
    ours = (left, top, right, bottom)
    off = [abs((a - b) / size) for a, b, size in zip(ours, bounds, pixel, strict=True)]
    if max(off) <= _OFF_TABLE_PX:
        return []
    sides = ", ".join(
        f"{side} {own:.6f} (table {listed:.6f})"
        for side, own, listed in zip(("left", "top", "right", "bottom"), ours, bounds, strict=True)
    )
    if max(off) > _OTHER_MAP_SHARE * min(tile.width, tile.height):
        raise RasterError(
            f"its bounds are up to {max(off):,.0f} pixels off those of {table}: {sides}",
            where=tile.path,
            expected="the map that the range table describes, in degrees",
            fix="download the map again; if it is right, remove its row from the range table",
        )
    return [
        f"the bounds of {tile.path.name} are up to {max(off):.1f} pixels off those of the range "
        f"table, and were taken: {sides}"
    ]


def _only(folder: Path, pattern: str, name: str) -> Path:
    """Return the one entry of a folder that matches, whatever its case.

    Raises
    ------
    BenchmarkError
        There is none, or more than one; what is there is shown.
    """
    found = sorted(p for p in folder.iterdir() if re.fullmatch(pattern, p.name, re.IGNORECASE))
    if len(found) == 1:
        return found[0]
    raise BenchmarkError(
        f"two files could be {name}: {first_of(path.name for path in found)}"
        if found
        else f"lacks {name}; it holds {_listed(folder)}",
        where=folder,
        expected=_LAYOUT,
        fix="keep one of them" if found else _unpack(folder),
    )


def _listed(folder: Path) -> str:
    names = sorted(path.name for path in folder.iterdir())
    return first_of(names, shown=5, noun="entry") if names else "nothing"


def _unpack(folder: Path) -> str:
    """Say what to do about files that are not there."""
    packed = [
        path.name
        for place in (folder, folder.parent)
        for path in sorted(place.iterdir())
        if path.suffix.lower() in _NOT_UNPACKED
    ]
    if packed:
        return f"finish the download and unpack {first_of(packed)}"
    return "download or unpack what is missing"
