"""What DJI's photos and tables of time stamps state beyond position and angles."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.datasets.dji import read_dji_texts
from airzoo_bench.datasets.native_text import read_native_text
from airzoo_bench.formats.photos import opened_photo

__all__ = ["FIXED", "DjiTags", "TimeStamp", "read_tags", "read_time_stamps", "stated_accuracy"]

FIXED = (48, 49, 50)
"""RtkFlag of a fixed solution: 50, or its finer 48 and 49."""
_EXIF_IFD, _FOCAL_35MM = 0x8769, 0xA405
_MOST_RATIO = 1.3  # between two focal lengths of one camera
_DIAGONAL_MM = math.hypot(36.0, 24.0)
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")
_STAMP_NUMBERS = 13
_WIDEST, _LONGEST = 0.2, 20.0  # focal lengths in widths of the photo


@dataclass(frozen=True)
class DjiTags:
    """What a photo states.

    Attributes
    ----------
    rtk_flag : int or None
        See `FIXED`; 16 a single point, 34 a float solution.
    std_m : tuple of 3 float, or None
        Standard deviations to the east and north, and of the height.
    lens : dict of str to float
        See `lenses.lens_of`; empty where the photo states none.
    lens_from : str
        What states the lens.
    """

    rtk_flag: int | None
    std_m: tuple[float, float, float] | None
    lens: dict[str, float]
    lens_from: str


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
        See `FIXED`.
    """

    number: int
    lat: float
    lon: float
    height_m: float
    std_m: tuple[float, float, float]
    flag: int


def read_tags(path: Path, size: tuple[int, int]) -> DjiTags:
    """Read the quality of a photo's position, and its lens.

    Raises
    ------
    BenchmarkError
        The photo's metadata are damaged.
    """
    texts = read_dji_texts(path)
    try:
        flag = _numbers(texts, "RtkFlag", 1)
        stds = [_numbers(texts, f"RtkStd{axis}", 1) for axis in ("Lon", "Lat", "Hgt")]
        lens, lens_from = _dewarp(texts, size)
    except BenchmarkError as fault:
        raise fault.inside(path) from fault
    of_film, film_from = _film(path, size)
    if lens and of_film:
        _check_lens(path, size, lens["fx"], of_film["fx"])
    if not lens:
        lens, lens_from = of_film, film_from
    known = [std[0] for std in stds if std]
    std_m = (known[0], known[1], known[2]) if len(known) == 3 else None
    return DjiTags(int(flag[0]) if flag else None, std_m, lens, lens_from)


def _numbers(texts: dict[str, str], name: str, count: int) -> list[float]:
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


def _dewarp(texts: dict[str, str], size: tuple[int, int]) -> tuple[dict[str, float], str]:
    """Read ``date;fx,fy,cx,cy,k1,k2,p1,p2,k3``; cx, cy count from the middle of the photo."""
    if "DewarpData" not in texts:
        return {}, ""
    values = _numbers({"DewarpData": texts["DewarpData"].rpartition(";")[2]}, "DewarpData", 9)
    keys = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
    lens = dict(zip(keys, values, strict=True))
    if not any(values):
        return {}, ""
    for key in ("fx", "fy"):
        if not _WIDEST * size[0] < lens[key] < _LONGEST * size[0]:
            raise BenchmarkError(
                f"DJI's DewarpData has {key} = {lens[key]:g} px in a photo {size[0]} px wide",
                expected="the focal length in pixels of the photo",
                fix="give the camera with --camera",
            )
    lens["cx"] += size[0] / 2
    lens["cy"] += size[1] / 2
    if texts.get("DewarpFlag") == "1":
        return lens | dict.fromkeys(keys[4:], 0.0), "DewarpData, of photos without distortion"
    return lens, "DewarpData"


def _check_lens(path: Path, size: tuple[int, int], dewarp: float, film: float) -> None:
    """Refuse DewarpData of a photo that was made smaller afterwards."""
    ratio = dewarp / film
    if not 1 / _MOST_RATIO < ratio < _MOST_RATIO:
        raise BenchmarkError(
            f"DJI's DewarpData has fx = {dewarp:g} px, and the focal length of 35 mm film makes "
            f"{film:g} px in a photo of {size[0]}x{size[1]} px",
            where=path,
            expected="a photo of the size that the drone took it in",
            fix="take the original photos, or give the camera with --camera",
        )


def _film(path: Path, size: tuple[int, int]) -> tuple[dict[str, float], str]:
    with opened_photo(path) as image:
        focal = image.getexif().get_ifd(_EXIF_IFD).get(_FOCAL_35MM)
    if not isinstance(focal, int) or not 0 < focal < 10_000:
        return {}, ""
    return (
        {"fx": focal / _DIAGONAL_MM * math.hypot(*size)},
        f"the focal length of 35 mm film ({focal} mm), without distortion",
    )


def read_time_stamps(path: Path) -> list[TimeStamp]:
    """Read a table of time stamps, its numbers by their order.

    A line holds the photo's number, time and week, the antenna's offsets to the north, east and
    down in mm, latitude, longitude, height, standard deviations to the north, east and up, and
    the flag; letters between them are passed over.

    Raises
    ------
    BenchmarkError
        A line holds other numbers.
    """
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


def stated_accuracy(
    stated: Sequence[tuple[float, float, float] | None],
) -> tuple[str, float | None]:
    """Say how good positions are stated to be; in metres of all three axes too, if they are.

    Parameters
    ----------
    stated : sequence of (3,) float or None
        Standard deviations of each photo's position.
    """
    stds = np.array([std for std in stated if std is not None])
    if not len(stds):
        return "photos do not state how good their positions are", None
    level = np.median(np.hypot(stds[:, 0], stds[:, 1]))
    said = (
        f"positions are stated good to {level:.3f} m in plan and {np.median(stds[:, 2]):.3f} m in "
        f"height (medians of standard deviations of {len(stds)} photos); gimbal angles to no figure"
    )
    # A file of zeros states nothing.
    return said, round(float(np.median(np.linalg.norm(stds, axis=1))), 4) or None
