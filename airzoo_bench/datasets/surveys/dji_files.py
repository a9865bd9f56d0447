"""DJI's photos beyond position and angles: RTK quality, lens, and tables of time stamps."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from airzoo_bench.core.errors import BenchmarkError, CameraError, first_of
from airzoo_bench.datasets.lenses import (
    are_alike,
    cameras_of_lenses,
    check_focal_lengths,
    film_focal_px,
    lens_of,
    read_camera_file,
)
from airzoo_bench.datasets.metadata import PhotoPrior, read_dji_texts
from airzoo_bench.datasets.tables import read_native_text
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import geodesic_distance_m
from airzoo_bench.geometry.poses import angles_to_rotations, rotation_angle_deg

__all__ = [
    "FIXED",
    "DjiTags",
    "TimeStamp",
    "photo_cameras",
    "photo_time_stamps",
    "read_tags",
    "read_time_stamps",
    "turned_note",
]

FIXED = (48, 49, 50)
"""RtkFlag of a fixed solution: 50, or its finer 48 and 49."""
_TURNED_DEG = 135.0
_SAME_PLACE_M = 5.0  # between a photo's own position and its time stamp's
_PHOTO_NUMBER = re.compile(r"(?<!\d)(\d{4})(?!\d)")
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")
_STAMP_NUMBERS = 13
_DEWARP = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")


@dataclass(frozen=True)
class DjiTags:
    """What a photo states of its position's quality and its lens.

    `rtk_flag` is one of `FIXED`, 16 for a single point, 34 for a float solution. `std_m` are
    standard deviations to the east and north, and of the height; `lens` is empty where none is
    stated.
    """

    rtk_flag: int | None
    std_m: tuple[float, float, float] | None
    lens: dict[str, float]
    lens_from: str
    flight_yaw_deg: float | None


def read_tags(path: Path, size: tuple[int, int]) -> DjiTags:
    """Read the quality of a photo's position, and its lens."""
    texts = read_dji_texts(path)
    try:
        flag, yaw, *stds = (
            next(iter(_numbers(texts, name, 1)), None)
            for name in ("RtkFlag", "FlightYawDegree", "RtkStdLon", "RtkStdLat", "RtkStdHgt")
        )
        lens = _dewarp(texts, size)
    except BenchmarkError as fault:
        raise fault.inside(path) from fault
    said = "DewarpData" + ", of photos without distortion" * (texts.get("DewarpFlag") == "1")
    film, millimetres = film_focal_px(path, size)
    if lens and film is not None and not are_alike(lens["fx"], film):
        raise BenchmarkError(
            f"DJI's DewarpData has fx = {lens['fx']:g} px, and the focal length of 35 mm film "
            f"makes {film:g} px in a photo of {size[0]}x{size[1]} px",
            where=path,
            expected="a photo of the size that the drone took it in",
            fix="take the original photos, or give the camera with --camera",
        )
    if not lens and film is not None:
        lens = {"fx": film}
        said = f"the focal length of 35 mm film ({millimetres} mm), without distortion"
    known = [std for std in stds if std is not None]
    std_m = (known[0], known[1], known[2]) if len(known) == 3 else None
    return DjiTags(None if flag is None else int(flag), std_m, lens, said, yaw)


def _numbers(texts: Mapping[str, str], name: str, count: int) -> list[float]:
    if not texts.get(name):
        return []
    try:
        values = [float(part) for part in texts[name].split(",")]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise BenchmarkError(
            f"DJI's {name} is {texts[name][:60]!r}", expected=f"{count} numbers, as the drone wrote"
        )
    return values


def _dewarp(texts: Mapping[str, str], size: tuple[int, int]) -> dict[str, float]:
    """Read ``date;fx,fy,cx,cy,k1,k2,p1,p2,k3``; cx, cy count from the middle of the photo."""
    stated = {"DewarpData": texts.get("DewarpData", "").rpartition(";")[2]}
    values = _numbers(stated, "DewarpData", len(_DEWARP))
    if not any(values):
        return {}
    lens = dict(zip(_DEWARP, values, strict=True))
    if (
        not 0.2 * size[0]
        < min(lens["fx"], lens["fy"])
        <= max(lens["fx"], lens["fy"])
        < 20 * size[0]
    ):
        raise BenchmarkError(
            f"DJI's DewarpData has fx, fy = {lens['fx']:g}, {lens['fy']:g} px in a photo "
            f"{size[0]} px wide",
            expected="the focal length in pixels of the photo",
            fix="give the camera with --camera",
        )
    lens["cx"] += size[0] / 2
    lens["cy"] += size[1] / 2
    without = dict.fromkeys(_DEWARP[4:], 0.0) if texts.get("DewarpFlag") == "1" else {}
    return lens | without


def photo_cameras(
    home: Path,
    sizes: Mapping[str, tuple[int, int]],
    tags: Mapping[str, DjiTags],
    given: Path | None,
    fix: str,
) -> tuple[Cameras, list[str]]:
    """Return cameras: of a file, else as the photos state them; and sentences on what states them.

    `fix` says how the file is given.
    """
    names = list(sizes)
    if given is not None:
        of_all = read_camera_file(given)
        lenses = [lens_of(of_all, sizes[name], given) for name in names]
        checked = check_focal_lengths(home, dict.fromkeys(names, of_all), sizes, given)
        return cameras_of_lenses(lenses, names, sizes), [f"cameras are from {given.name}", *checked]
    lacking = [name for name in names if not tags[name].lens]
    if lacking:
        raise CameraError(
            f"photos state no camera: {first_of(lacking, len(names))}",
            where=home,
            expected="DJI's DewarpData, or EXIF FocalLengthIn35mmFilm",
            fix=fix,
        )
    lenses = [lens_of(tags[name].lens, sizes[name], home / name) for name in names]
    said = sorted({tags[name].lens_from for name in names})
    return cameras_of_lenses(lenses, names, sizes), [f"cameras are from {what}" for what in said]


def turned_note(priors: Mapping[str, PhotoPrior], tags: Mapping[str, DjiTags]) -> list[str]:
    """Warn where most photos have gimbal angles that turn them about against the drone's nose."""
    angles = np.array([prior.values[3:] for prior in priors.values()], np.float64)
    yaw, pitch, roll = angles.T
    stated = [tags[name].flight_yaw_deg for name in priors]
    nose = np.array([own if yaw is None else yaw for own, yaw in zip(yaw, stated, strict=True)])
    given = angles_to_rotations(yaw, pitch, roll, convergence_deg=0.0)
    level = angles_to_rotations(nose, pitch, np.zeros_like(roll), convergence_deg=0.0)
    turned = rotation_angle_deg(given, level) > _TURNED_DEG
    if turned.mean() <= 0.5:
        return []
    names = [name for name, is_turned in zip(priors, turned, strict=True) if is_turned]
    return [
        f"WARNING: gimbal angles turn cameras by more than {_TURNED_DEG:g} degrees against the "
        f"drone's nose (FlightYawDegree) and a level horizon: {first_of(names, len(priors))}; "
        "where photos were not taken so, GimbalYawDegree or GimbalRollDegree is 180 degrees off, "
        "and so is the truth: give poses from elsewhere (prepare poses, odm, colmap)"
    ]


@dataclass(frozen=True)
class TimeStamp:
    """A line of a table of time stamps: where a photo was taken, above the ellipsoid."""

    number: int
    lat: float
    lon: float
    height_m: float
    std_m: tuple[float, float, float]
    flag: int


def read_time_stamps(path: Path) -> list[TimeStamp]:
    """Read a table of time stamps (.MRK), its numbers by their order."""
    stamps = []
    for number, line in enumerate(read_native_text(path).splitlines(), 1):
        if not line.strip():
            continue
        stamp = _stamp([float(text) for text in _NUMBER.findall(line)])
        if stamp is None:
            raise BenchmarkError(
                f"is no time stamp: {' '.join(line.split())[:120]!r}",
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


def _stamp(values: Sequence[float]) -> TimeStamp | None:
    if len(values) != _STAMP_NUMBERS:
        return None
    lat, lon, height, north, east, up, flag = values[6:]
    whole = values[0].is_integer() and flag.is_integer() and 0 <= flag <= 99
    likely = abs(lat) <= 90 and abs(lon) <= 180 and min(north, east, up) >= 0
    if not (whole and likely and max(north, east, up) < 1e4):
        return None
    return TimeStamp(int(values[0]), lat, lon, height, (east, north, up), int(flag))


def photo_time_stamps(
    source: Path, images: Path, metadata: Mapping[str, PhotoPrior]
) -> tuple[dict[str, TimeStamp], list[str]]:
    """Return each photo's time stamp, by its number from the table in its folder, and notes."""
    tables = sorted(p for p in source.rglob("*") if p.name.lower().endswith("timestamp.mrk"))
    found: dict[str, TimeStamp] = {}
    for table in tables:
        by_number = {stamp.number: stamp for stamp in read_time_stamps(table)}
        alone = sum(other.parent == table.parent for other in tables) == 1
        flight = re.sub(r"timestamp\.mrk$", "", table.name, flags=re.IGNORECASE)
        for name in metadata:
            numbers = _PHOTO_NUMBER.findall(PurePosixPath(name).stem)
            ours = (images / name).parent == table.parent
            same = alone or PurePosixPath(name).name.startswith(flight)
            if ours and same and numbers and int(numbers[-1]) in by_number:
                found[name] = by_number[int(numbers[-1])]
    if not tables:
        return {}, []
    _check_stamps(tables[0], found, metadata)
    return found, [
        f"positions of {len(found)} of {len(metadata)} photos come from "
        f"{first_of([table.name for table in tables], noun='table')} of time stamps, above the "
        "ellipsoid"
    ]


def _check_stamps(
    table: Path, found: Mapping[str, TimeStamp], metadata: Mapping[str, PhotoPrior]
) -> None:
    """Refuse tables of other photos: none has a number of theirs, or they are far apart."""
    own = {n: p for n, p in metadata.items() if n in found and p.lon is not None}
    stated = np.array([(p.lon, p.lat) for p in own.values()], dtype=np.float64).reshape(-1, 2)
    stamped = np.array([(found[n].lon, found[n].lat) for n in own]).reshape(-1, 2)
    away = geodesic_distance_m(stated, stamped)
    far = [name for name, metres in zip(own, away, strict=True) if metres > _SAME_PLACE_M]
    if far or not found:
        raise BenchmarkError(
            f"time stamps are more than {_SAME_PLACE_M:g} m from the photos of their number: "
            f"{first_of(far, len(own))}"
            if far
            else "no photo has the number of a time stamp",
            where=table,
            expected=f"the table of these photos, such as DJI_..._0001_V.JPG next to {table.name}",
            fix="take the table out of the folder, and positions come from the photos",
        )
