"""Where a photo says that it was taken: position in EXIF, gimbal angles in DJI's XMP.

Position is EXIF's where it has one (its seconds have four decimals, 3 mm), DJI's otherwise. Angles
are as `geometry.poses` takes them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.formats.photos import opened_photo
from airzoo_bench.geometry.crs import (
    describe_crs,
    from_lonlat,
    grid_convergence_deg,
    horizontal_crs,
)
from airzoo_bench.geometry.poses import Poses, angles_to_rotations

__all__ = ["PhotoPrior", "priors_to_poses", "read_dji_texts", "read_prior"]

_XMP = b"http://ns.adobe.com/xap/1.0/\0"
_NAMESPACE = "http://www.dji.com/drone-dji/1.0/"
_GPS_IFD = 0x8825
_LATITUDE, _LONGITUDE, _ALTITUDE = 2, 4, 6  # the tag before each is the reference of its sign
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)", re.ASCII)
_NUMBERS = (
    "GpsLatitude",
    "GpsLongitude",
    "GpsLongtitude",  # thus on some bodies
    "AbsoluteAltitude",
    "RelativeAltitude",
    "GimbalYawDegree",
    "GimbalPitchDegree",
    "GimbalRollDegree",
)
# Above sea level or ellipsoid, and below; EXIF 3.0 added 2 and 3.
_ALTITUDE_SIGN = {0: 1.0, 1: -1.0, 2: 1.0, 3: -1.0}


@dataclass(frozen=True)
class PhotoPrior:
    """Position and attitude that a photo's metadata state.

    Attributes
    ----------
    lon, lat : float or None
        WGS84, degrees; both or neither.
    altitude_m : float or None
        Above sea level or ellipsoid: photos do not say reliably which.
    yaw_deg, pitch_deg, roll_deg : float or None
        Of the gimbal; see `geometry.poses`.
    relative_altitude_m : float or None
        Above the place of take-off.
    """

    lon: float | None = None
    lat: float | None = None
    altitude_m: float | None = None
    yaw_deg: float | None = None
    pitch_deg: float | None = None
    roll_deg: float | None = None
    relative_altitude_m: float | None = None

    @property
    def is_complete(self) -> bool:
        """Whether position, altitude and attitude are all there."""
        return None not in _required(self)


def read_prior(path: Path) -> PhotoPrior:
    """Read a photo's position and attitude from its EXIF and DJI's XMP."""
    gps, packet = _metadata(path)
    try:
        dji = _dji_values(packet)
        lon, lat = _position(gps, dji)
        return PhotoPrior(
            lon=lon,
            lat=lat,
            altitude_m=_altitude(gps, dji),
            yaw_deg=dji.get("GimbalYawDegree"),
            pitch_deg=dji.get("GimbalPitchDegree"),
            roll_deg=dji.get("GimbalRollDegree"),
            relative_altitude_m=dji.get("RelativeAltitude"),
        )
    except BenchmarkError as fault:
        raise fault.inside(path) from fault


def read_dji_texts(path: Path) -> dict[str, str]:
    """Read all that DJI's XMP of a photo states."""
    try:
        return _dji_texts(_metadata(path)[1])
    except BenchmarkError as fault:
        raise fault if str(path) in str(fault.where) else fault.inside(path) from fault


def priors_to_poses(priors: Mapping[str, PhotoPrior], crs: Any) -> Poses:
    """Turn priors into poses in a projected CRS."""
    table = {name: _required(prior) for name, prior in priors.items()}
    for what, part in (("position", slice(0, 3)), ("gimbal angles", slice(3, 6))):
        lacking = [name for name, values in table.items() if None in values[part]]
        _refuse(lacking, len(priors), f"no {what} in the metadata")
    rows = np.array(list(table.values()), dtype=np.float64).reshape(-1, 6)
    lonlat, altitude, angles = np.split(rows, (2, 3), axis=1)
    xy, convergence = from_lonlat(crs, lonlat), grid_convergence_deg(crs, lonlat)
    beyond = np.isnan(xy).any(axis=1) | np.isnan(convergence)
    outside = [name for name, bad in zip(priors, beyond, strict=True) if bad]
    _refuse(outside, len(priors), f"positions beyond {describe_crs(horizontal_crs(crs))}")
    rotations = angles_to_rotations(*angles.T, convergence_deg=convergence)
    return Poses.from_centres(rotations, np.hstack((xy, altitude)), names=list(priors))


def _required(prior: PhotoPrior) -> tuple[float | None, ...]:
    position = (prior.lon, prior.lat, prior.altitude_m)
    return (*position, prior.yaw_deg, prior.pitch_deg, prior.roll_deg)


def _refuse(names: list[str], total: int, what: str) -> None:
    if names:
        raise BenchmarkError(
            f"{what}: {first_of(names, total)}",
            expected="photos as the drone wrote them, with EXIF GPS and DJI's XMP",
            fix="give poses for these photos, or take them out",
        )


def _metadata(path: Path) -> tuple[dict[int, Any], bytes]:
    """Read the GPS part of EXIF and DJI's XMP packet; empty where there is none."""
    with opened_photo(path) as image:
        gps = dict(image.getexif().get_ifd(_GPS_IFD))
        segments = getattr(image, "applist", [])
    # A segment holds 64 KiB at the most, whatever it says of itself.
    packets = (data for name, data in segments if name == "APP1" and data.startswith(_XMP))
    return gps, next((data for data in packets if _NAMESPACE.encode() in data), b"")


def _dji_values(packet: bytes) -> dict[str, float]:
    """Read the numbers of DJI's namespace, whether attributes or elements."""
    texts = _dji_texts(packet)
    return {name: _number(name, texts[name]) for name in _NUMBERS if name in texts}


def _dji_texts(packet: bytes) -> dict[str, str]:
    """Read what DJI's namespace states, by the names without it."""
    if not packet:
        return {}
    texts: dict[str, str] = {}
    for element in _parsed(packet).iter():
        for name, text in ((element.tag, element.text or ""), *element.attrib.items()):
            if name.startswith("{" + _NAMESPACE + "}") and text.strip():
                texts.setdefault(name.partition("}")[2], text.strip())
    return texts


def _parsed(packet: bytes) -> ElementTree.Element:
    expected = "an XMP packet as the drone wrote it"
    try:
        text = packet[len(_XMP) :].decode("utf-8-sig").strip("\0 \r\n\t")
        # Without a document type there are no entities, neither large nor from elsewhere.
        if "<!DOCTYPE" in text:
            raise BenchmarkError("DJI's XMP declares a document type", expected=expected)
        return ElementTree.fromstring(text)
    except (UnicodeDecodeError, ElementTree.ParseError) as error:
        raise BenchmarkError(f"DJI's XMP is damaged: {error}", expected=expected) from error


def _number(name: str, text: str) -> float:
    if not _NUMBER.fullmatch(text):
        raise BenchmarkError(
            f"DJI's {name} is {text[:40]!r}", expected="a decimal number, such as +12.30"
        )
    return float(text)


def _position(gps: dict[int, Any], dji: dict[str, float]) -> tuple[float | None, float | None]:
    lon, lat = _degrees(gps, _LONGITUDE, "EW"), _degrees(gps, _LATITUDE, "NS")
    if lon is None or lat is None:
        lon, lat = dji.get("GpsLongitude", dji.get("GpsLongtitude")), dji.get("GpsLatitude")
    if lon is None or lat is None or (lon, lat) == (0.0, 0.0):
        return None, None
    if abs(lon) > 180.0 or abs(lat) > 90.0:
        raise BenchmarkError(
            f"no position on the earth: longitude {lon}, latitude {lat}",
            expected="at most 180 and 90 degrees",
            fix="swap longitude and latitude: one is beyond 90 degrees, the other is not"
            if abs(lat) <= 180.0 and abs(lon) <= 90.0
            else None,
        )
    return lon, lat


def _degrees(gps: dict[int, Any], tag: int, signs: str) -> float | None:
    """Read degrees, minutes and seconds; the sign is in the tag before."""
    if tag not in gps or _unknown(gps[tag]):
        return None
    parts = _numbers(gps[tag], 3)
    reference = str(gps.get(tag - 1, "")).strip("\0 ").upper()
    if reference not in tuple(signs):
        raise BenchmarkError(
            f"EXIF GPS tag {tag - 1} is {reference[:40]!r}", expected=f"{signs[0]} or {signs[1]}"
        )
    size = parts[0] + parts[1] / 60.0 + parts[2] / 3600.0
    return size if reference == signs[0] else -size


def _unknown(value: Any) -> bool:
    # 0/0, EXIF's way of saying so.
    parts = value if isinstance(value, tuple) else (value,)
    return all(isinstance(part, Real) and math.isnan(part) for part in parts)


def _altitude(gps: dict[int, Any], dji: dict[str, float]) -> float | None:
    if _ALTITUDE not in gps or _unknown(gps[_ALTITUDE]):
        return dji.get("AbsoluteAltitude")
    reference = gps.get(_ALTITUDE - 1, b"\0")
    code = reference[0] if isinstance(reference, bytes) and reference else reference
    if code not in _ALTITUDE_SIGN:
        raise BenchmarkError(
            f"EXIF GPSAltitudeRef is {str(code)[:40]}", expected="0 to 3; 1 and 3 are below"
        )
    return _ALTITUDE_SIGN[code] * _numbers(gps[_ALTITUDE], 1)[0]


def _numbers(value: Any, count: int) -> list[float]:
    parts = value if isinstance(value, tuple) else (value,)
    numbers = [float(part) for part in parts if isinstance(part, Real)]
    if len(parts) != count or len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise BenchmarkError(
            f"EXIF GPS is damaged: {str(value)[:40]}", expected=f"{count} finite numbers"
        )
    return numbers
