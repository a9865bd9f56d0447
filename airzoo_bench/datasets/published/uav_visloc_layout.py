"""The files of UAV-VisLoc: where a flight's photos, table and map are."""

from __future__ import annotations

import os
import re
from pathlib import Path

from airzoo_bench.core.errors import BenchmarkError, UsageError, first_of
from airzoo_bench.core.ids import PHOTO_SUFFIXES

__all__ = [
    "RANGE_TABLE",
    "drone_photos",
    "flight_files",
    "flight_folders",
    "flight_table",
    "found_root",
    "only",
    "range_tables",
]

_FLIGHTS = tuple(f"{number:02d}" for number in range(1, 12))
_LAYOUT = "NN/drone/NN_0001.JPG ..., NN/NN.csv and NN/satelliteNN.tif of flights 01 to 11"
RANGE_TABLE = r"satellite_ ?coordinates_range\.csv"
_NOT_UNPACKED = (".zip", ".rar", ".7z", ".tar", ".gz", ".part", ".crdownload", ".aria2", ".tmp")


def found_root(source: Path) -> Path:
    """Return the folder with the flights: the source, or the only folder in it that has some."""
    if not source.is_dir():
        raise UsageError(
            "no such folder" if not source.exists() else "a file, not a folder",
            where=source,
            expected=f"the folder of UAV-VisLoc: {_LAYOUT}",
            fix="unpack the archive" if source.is_file() else None,
        )
    if _numbered(source):
        return source
    if re.fullmatch(r"[0-9]{1,2}", source.resolve().name) and (source / "drone").is_dir():
        raise BenchmarkError(
            "is the folder of one flight",
            where=source,
            expected=f"the folder above it: {_LAYOUT}",
            fix=f"--source {source.resolve().parent} --scene {source.resolve().name}",
        )
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
    """Return the folders of the flights that are there, by flight, in order."""
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
    return sorted(entry for entry in entries if entry[0] in _FLIGHTS)


def flight_files(source: Path, flight: str) -> list[Path]:
    """Return what a flight is read from; a virtual map that was written next to it is not."""
    root = found_root(source)
    folder = flight_folders(root)[flight]
    own = [path for path in folder.iterdir() if path.is_dir() or path.suffix.lower() != ".vrt"]
    return sorted([*own, *range_tables(root)])


def range_tables(root: Path) -> list[Path]:
    """Return the range tables that are there, with or without the blank in their name."""
    return [path for path in root.iterdir() if re.fullmatch(RANGE_TABLE, path.name, re.IGNORECASE)]


def flight_table(folder: Path, flight: str) -> Path:
    """Return a flight's table ``NN.csv``; see `only` for errors."""
    return only(folder, rf"0?{int(flight)}\.csv", f"{flight}.csv")


def drone_photos(folder: Path) -> tuple[Path, dict[str, str]]:
    """Return the folder of a flight's photos, and their names by their names in lower case."""
    drone = only(folder, "drone", "drone")
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


def only(folder: Path, pattern: str, name: str) -> Path:
    """Return the one entry of a folder that matches, whatever its case."""
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
