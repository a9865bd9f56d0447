"""DJI's tables of time stamps, and which photo each of them is of."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.datasets.native_text import read_native_text
from airzoo_bench.datasets.photo_metadata import PhotoPrior
from airzoo_bench.geometry.crs import geodesic_distance_m

__all__ = ["TimeStamp", "photo_time_stamps", "read_time_stamps"]

_SAME_PLACE_M = 5.0  # between a photo's own position and its time stamp's
_PHOTO_NUMBER = re.compile(r"(?<!\d)(\d{4})(?!\d)")
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")
_STAMP_NUMBERS = 13


@dataclass(frozen=True)
class TimeStamp:
    """A line of a table of time stamps: where a photo was taken.

    Attributes
    ----------
    number : int
        Of the photo.
    lat, lon : float
        WGS84, degrees.
    height_m : float
        Above the ellipsoid.
    std_m : tuple of 3 float
        To the east and north, and of the height.
    flag : int
        See `dji_tags.FIXED`.
    """

    number: int
    lat: float
    lon: float
    height_m: float
    std_m: tuple[float, float, float]
    flag: int


def read_time_stamps(path: Path) -> list[TimeStamp]:
    """Read a table of time stamps, its numbers by their order."""
    stamps = []
    for number, line in enumerate(read_native_text(path).splitlines(), 1):
        if not line.strip():
            continue
        values = [float(text) for text in _NUMBER.findall(line)]
        stamp = _stamp(values)
        if stamp is None:
            raise BenchmarkError(
                f"holds {len(values)} numbers: {' '.join(line.split())[:120]!r}",
                where=f"{path}, line {number}",
                expected="photo, time, [week], N, E, V (mm), latitude, longitude, height, three "
                "standard deviations, flag",
                fix="take the file out of the folder, and positions come from the photos",
            )
        stamps.append(stamp)
    counts = Counter(stamp.number for stamp in stamps)
    twice = [str(number) for number, count in counts.items() if count > 1]
    if twice:
        raise BenchmarkError(
            f"several time stamps have one number: {first_of(twice, len(counts))}",
            where=path,
            expected="the table of one flight",
            fix="give each flight a folder of its own, with its table",
        )
    return stamps


def _stamp(values: list[float]) -> TimeStamp | None:
    if len(values) != _STAMP_NUMBERS:
        return None
    number, (lat, lon, height), (north, east, up), flag = (
        values[0],
        values[6:9],
        values[9:12],
        values[12],
    )
    whole = number.is_integer() and flag.is_integer() and 0 <= flag <= 99
    likely = abs(lat) <= 90 and abs(lon) <= 180 and max(north, east, up) < 1e4
    if not (whole and likely and min(north, east, up) >= 0):
        return None
    return TimeStamp(int(number), lat, lon, height, (east, north, up), int(flag))


def photo_time_stamps(
    source: Path, images: Path, metadata: dict[str, PhotoPrior]
) -> tuple[dict[str, TimeStamp], list[str]]:
    """Return each photo's time stamp: that of its number, from the table in its folder."""
    tables = sorted(p for p in source.rglob("*") if p.name.lower().endswith("timestamp.mrk"))
    found: dict[str, TimeStamp] = {}
    for table in tables:
        by_number = {stamp.number: stamp for stamp in read_time_stamps(table)}
        alone = [other for other in tables if other.parent == table.parent] == [table]
        for name in metadata:
            numbers = _PHOTO_NUMBER.findall(PurePosixPath(name).stem)
            ours = (images / name).parent == table.parent
            same = alone or PurePosixPath(name).name.startswith(_flight(table))
            if ours and same and numbers and int(numbers[-1]) in by_number:
                found[name] = by_number[int(numbers[-1])]
    if not tables:
        return {}, []
    _check_stamps(tables, found, metadata)
    return found, [
        f"positions of {len(found)} of {len(metadata)} photos come from "
        f"{first_of([table.name for table in tables], noun='table')} of time stamps, above the "
        "ellipsoid"
    ]


def _flight(table: Path) -> str:
    """Return what names of photos and their table begin with, such as ``100_0001_``."""
    return re.sub(r"timestamp\.mrk$", "", table.name, flags=re.IGNORECASE)


def _check_stamps(
    tables: list[Path], found: dict[str, TimeStamp], metadata: dict[str, PhotoPrior]
) -> None:
    where = tables[0] if len(tables) == 1 else tables[0].parent
    if not found:
        raise BenchmarkError(
            "no photo has the number of a time stamp",
            where=where,
            expected=f"photos such as DJI_..._0001_V.JPG next to {tables[0].name}",
            fix="take the table out of the folder, and positions come from the photos",
        )
    own = {n: p for n, p in metadata.items() if n in found and p.lon is not None}
    stated = np.array([(p.lon, p.lat) for p in own.values()], dtype=np.float64).reshape(-1, 2)
    stamped = np.array([(found[n].lon, found[n].lat) for n in own]).reshape(-1, 2)
    away = geodesic_distance_m(stated, stamped)
    far = [name for name, metres in zip(own, away, strict=True) if metres > _SAME_PLACE_M]
    if far:
        raise BenchmarkError(
            f"time stamps are more than {_SAME_PLACE_M:g} m from the photos of their number: "
            f"{first_of(far, len(own))}",
            where=where,
            expected="the table that belongs to these photos",
            fix="take the table out of the folder, and positions come from the photos",
        )
