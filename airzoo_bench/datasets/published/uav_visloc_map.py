"""The map of a flight of UAV-VisLoc: one file or several, with or without a georeference."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.errors import BenchmarkError, RasterError, UsageError
from airzoo_bench.datasets.joined_maps import Bounds, MapTile, join_maps, map_tile
from airzoo_bench.datasets.native_tables import read_table
from airzoo_bench.datasets.published.uav_visloc_layout import RANGE_TABLE, only, range_tables
from airzoo_bench.geometry.rasters import pixel_to_world

__all__ = ["FlightMap", "flight_map"]

_RANGE_COLUMNS = ("mapname", "LT_lat_map", "LT_lon_map", "RB_lat_map", "RB_lon_map")
_OFF_TABLE_PX = 1.0
_OTHER_MAP_SHARE = 0.1


@dataclass(frozen=True)
class FlightMap:
    """A flight's map, and sentences about it."""

    path: Path
    notes: tuple[str, ...]


def flight_map(root: Path, folder: Path, flight: str, joined: Path | None) -> FlightMap:
    """Find a flight's map; write a virtual one over tiles, or where it has no georeference."""
    whole = rf"(?:satellite)?0?{int(flight)}"
    tiles = {
        (int(found[1]), int(found[2])): map_tile(path)
        for path in _tifs(folder)
        if (found := re.fullmatch(rf"{whole}_(\d+)-(\d+)", path.stem, re.IGNORECASE))
    }
    wholes = [path for path in _tifs(folder) if re.fullmatch(whole, path.stem, re.IGNORECASE)]
    if not tiles or wholes:
        tiles = {(1, 1): map_tile(only(folder, rf"{whole}\.tiff?", f"satellite{flight}.tif"))}
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


def _range_of(root: Path, flight: str) -> tuple[Bounds | None, Path | None]:
    """Return left, top, right, bottom of a flight's map by the range table, if it has it."""
    if not range_tables(root):
        return None, None
    path = only(root, RANGE_TABLE, "satellite_ coordinates_range.csv")
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
