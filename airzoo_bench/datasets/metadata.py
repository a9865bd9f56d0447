"""Metadata of photos: position in EXIF, gimbal angles in DJI's XMP; and photos without any.

Position is EXIF's where it has one (its seconds have four decimals, 3 mm), DJI's otherwise. Angles
are as `geometry.poses` takes them.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pandas as pd

from airzoo_bench.core.errors import BenchmarkError, first_of, readable
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.tables import read_table
from airzoo_bench.formats.photos import open_photo
from airzoo_bench.geometry.crs import (
    describe_crs,
    from_lonlat,
    grid_convergence_deg,
    horizontal_crs,
)
from airzoo_bench.geometry.poses import Poses, angles_to_rotations, rotations_to_angles

PRIOR_VALUES = ("lon", "lat", "altitude_m", "yaw_deg", "pitch_deg", "roll_deg")
_LIMITS = {"lon": 180.0, "lat": 90.0}
_XMP = b"http://ns.adobe.com/xap/1.0/\0"
_NAMESPACE = "http://www.dji.com/drone-dji/1.0/"
_GPS_IFD = 0x8825
_LATITUDE, _LONGITUDE, _ALTITUDE = 2, 4, 6  # the tag before each is the reference of its sign
# Standard deviations of a consumer drone's metadata: GPS without RTK (east, north, up); compass
# and gimbal (yaw, pitch, roll).
_GPS_M, _ANGLES_DEG = (2.0, 2.0, 3.0), (2.0, 0.7, 0.5)
_UNIFORMS = 12  # whose sum has the variance 1 and is normal to all purposes
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)", re.ASCII)


@dataclass(frozen=True)
class PhotoPrior:
    """Position and attitude that a photo's metadata state.

    Position in WGS84, angles of the gimbal; photos do not say reliably whether the altitude is
    above the sea or the ellipsoid. `relative_altitude_m` is above the place of take-off.
    """

    lon: float | None = None
    lat: float | None = None
    altitude_m: float | None = None
    yaw_deg: float | None = None
    pitch_deg: float | None = None
    roll_deg: float | None = None
    relative_altitude_m: float | None = None

    @property
    def values(self) -> tuple[float | None, ...]:
        """Position, altitude and attitude."""
        return tuple(getattr(self, name) for name in PRIOR_VALUES)

    @property
    def is_complete(self) -> bool:
        """Whether position, altitude and attitude are all there."""
        return None not in self.values


def read_prior(path: Path) -> PhotoPrior:
    """Read a photo's position and attitude from its EXIF and DJI's XMP."""
    gps, texts = _metadata(path)
    with readable(path, "damaged metadata of the photo", kind=BenchmarkError):
        lon, lat = _position(gps, texts)
        names = ("GimbalYawDegree", "GimbalPitchDegree", "GimbalRollDegree", "RelativeAltitude")
        rest = (_dji_number(texts, name) for name in names)
        return PhotoPrior(lon, lat, _altitude(gps, texts), *rest)


def read_dji_texts(path: Path) -> dict[str, str]:
    """Read all that DJI's XMP of a photo states, by the names without its namespace."""
    return _metadata(path)[1]


def photo_metadata(
    names: Sequence[str],
    images: Path,
    priors: Path | None,
    photos: Iterable[str],
    progress: Progress,
) -> dict[str, PhotoPrior]:
    """Read what photos state; a table of priors goes before that."""
    given = {} if priors is None else read_prior_file(priors, photos)
    shown = progress(names, "metadata", len(names))
    return {name: replace(read_prior(images / name), **given.get(name, {})) for name in shown}


def read_prior_file(path: Path, photos: Iterable[str]) -> dict[str, dict[str, float]]:
    """Read a CSV with the column ``image`` and some of `PRIOR_VALUES`."""
    table = read_table(path, {one: (one,) for one in ("image", *PRIOR_VALUES)}, PRIOR_VALUES)
    table.require_unique("image")
    strange = [name for name in table.names if name not in table.header.values()]
    odd = strange or sorted({*table.texts("image")} - {*photos})
    if odd:
        raise BenchmarkError(
            f"has columns or photos that are not known: {first_of(map(repr, odd))}",
            where=path,
            expected=f"image, and some of {', '.join(PRIOR_VALUES)}; each photo once, by its name "
            "relative to the folder of the photos",
        )
    found: dict[str, dict[str, float]] = {name: {} for name in table.texts("image")}
    for column in (name for name in PRIOR_VALUES if table.has(name)):
        most = _LIMITS.get(column, 1e6)
        numbers = table.numbers(column, -most, most, empty=True).tolist()
        for values, value in zip(found.values(), numbers, strict=True):
            values |= {} if math.isnan(value) else {column: value}
    return found


def priors_to_poses(priors: Mapping[str, PhotoPrior], crs: Any) -> Poses:
    """Turn complete priors into poses in a projected CRS."""
    rows = np.array([prior.values for prior in priors.values()], np.float64).reshape(-1, 6)
    lonlat, altitude, angles = np.split(rows, (2, 3), axis=1)
    xy, convergence = from_lonlat(crs, lonlat), grid_convergence_deg(crs, lonlat)
    beyond = np.isnan(xy).any(axis=1) | np.isnan(convergence)
    if beyond.any():
        names = [name for name, bad in zip(priors, beyond, strict=True) if bad]
        what = f"positions beyond {describe_crs(horizontal_crs(crs))}"
        fix = "give poses for these photos, or take them out"
        raise BenchmarkError(f"{what}: {first_of(names, len(priors))}", fix=fix)
    rotations = angles_to_rotations(*angles.T, convergence_deg=convergence)
    return Poses.from_centres(rotations, np.hstack((xy, altitude)), names=list(priors))


def metadata_priors(metadata: Mapping[str, PhotoPrior], crs: str) -> Poses | None:
    """Return a prior for each photo, NaN where its metadata lack one; None where all lack one."""
    whole = {name: prior for name, prior in metadata.items() if prior.is_complete}
    if not whole:
        return None
    return poses_by_name(priors_to_poses(whole, crs), list(whole), list(metadata))


def poses_by_name(poses: Poses, given: Sequence[str], names: Sequence[str]) -> Poses:
    """Return the poses of names in their order; NaN for those that none is given for."""
    rows = pd.Index(given).get_indexer(pd.Index(names))  # -1 where there is none: the last
    rotation = np.concatenate((poses.rotation, np.full((1, 3, 3), np.nan)))[rows]
    centres = np.concatenate((poses.centres, np.full((1, 3), np.nan)))[rows]
    return Poses(rotation=rotation, centres=centres)


def noisy_priors(names: Sequence[str], poses: Poses, seed: int) -> Poses:
    """Return a consumer drone's readings of GPS and gimbal for true poses, from a seed."""
    unit = np.empty((len(names), 6))
    for row, name in enumerate(names):
        blocks = (f"{seed}/{name}/{block}".encode() for block in range(5))
        digest = b"".join(hashlib.sha256(block).digest() for block in blocks)
        bits = np.frombuffer(digest, dtype=">u2")[: 6 * _UNIFORMS].reshape(6, _UNIFORMS)
        total = bits.astype(np.int64).sum(axis=1) * 2 + _UNIFORMS - (_UNIFORMS << 16)
        unit[row] = total / (2 << 16)
    centres = poses.centres + unit[:, :3] * np.array(_GPS_M)
    turns = unit[:, 3:] * np.array(_ANGLES_DEG)
    yaw, pitch, roll = (rotations_to_angles(poses.rotation, convergence_deg=0.0) + turns).T
    return Poses.from_centres(angles_to_rotations(yaw, pitch, roll, convergence_deg=0.0), centres)


def _metadata(path: Path) -> tuple[dict[int, Any], dict[str, str]]:
    """Read the GPS part of EXIF and DJI's namespace of XMP; empty where there is none."""
    with open_photo(path) as image:
        gps = dict(image.getexif().get_ifd(_GPS_IFD))
        segments = getattr(image, "applist", [])
    packets = (data for name, data in segments if name == "APP1" and data.startswith(_XMP))
    packet = next((data for data in packets if _NAMESPACE.encode() in data), b"")
    with readable(path, "DJI's XMP is damaged", kind=BenchmarkError):
        return gps, _dji_texts(packet[len(_XMP) :].decode("utf-8-sig").strip("\0 \r\n\t"))


def _dji_texts(packet: str) -> dict[str, str]:
    """Read DJI's namespace, whether attributes or elements."""
    # Without a document type there are no entities, neither large nor from elsewhere.
    if "<!DOCTYPE" in packet:
        raise ValueError("it declares a document type")
    texts: dict[str, str] = {}
    for element in ElementTree.fromstring(packet).iter() if packet else ():
        for name, value in ((element.tag, element.text or ""), *element.attrib.items()):
            if name.startswith("{" + _NAMESPACE + "}") and value.strip():
                texts.setdefault(name.partition("}")[2], value.strip())
    return texts


def _dji_number(texts: Mapping[str, str], name: str) -> float | None:
    if name not in texts:
        return None
    if not _NUMBER.fullmatch(texts[name]):
        raise ValueError(f"DJI's {name} is {texts[name][:40]!r}, no decimal number")
    return float(texts[name])


def _position(gps: dict[int, Any], dji: Mapping[str, str]) -> tuple[float | None, float | None]:
    lon, lat = _degrees(gps, _LONGITUDE, "EW"), _degrees(gps, _LATITUDE, "NS")
    if lon is None or lat is None:
        # Some bodies misspell it.
        name = "GpsLongitude" if "GpsLongitude" in dji else "GpsLongtitude"
        lon, lat = _dji_number(dji, name), _dji_number(dji, "GpsLatitude")
    if lon is None or lat is None or (lon, lat) == (0.0, 0.0):
        return None, None
    if abs(lon) > 180.0 or abs(lat) > 90.0:
        raise ValueError(f"no position on the earth: longitude {lon}, latitude {lat}")
    return lon, lat


def _degrees(gps: dict[int, Any], tag: int, signs: str) -> float | None:
    """Read degrees, minutes and seconds; the sign is in the tag before."""
    parts = _numbers(gps, tag, 3)
    if parts is None:
        return None
    size = parts[0] + parts[1] / 60.0 + parts[2] / 3600.0
    reference = str(gps.get(tag - 1, "")).strip("\0 ").upper()
    return {signs[0]: size, signs[1]: -size}[reference]


def _altitude(gps: dict[int, Any], dji: Mapping[str, str]) -> float | None:
    parts = _numbers(gps, _ALTITUDE, 1)
    if parts is None:
        return _dji_number(dji, "AbsoluteAltitude")
    reference = gps.get(_ALTITUDE - 1, b"\0")
    below = (reference[0] if isinstance(reference, bytes) and reference else reference) in (1, 3)
    return -parts[0] if below else parts[0]


def _numbers(gps: dict[int, Any], tag: int, count: int) -> list[float] | None:
    """Read the numbers of a tag; None where it is missing, or 0/0, EXIF's way of saying so."""
    value = gps.get(tag)
    if value is None:
        return None
    numbers = [float(part) for part in (value if isinstance(value, tuple) else (value,))]
    if all(map(math.isnan, numbers)):
        return None
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise ValueError(f"EXIF GPS has {str(value)[:40]} for {count} finite numbers")
    return numbers


# --- photos without metadata: cut, not encoded again ---

_JPEG, _PNG = b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n"
_END, _SCAN, _JFIF, _ADOBE = 0xD9, 0xDA, 0xE0, 0xEE
# Frames (except hierarchical ones), tables of Huffman, arithmetic and quantisation, DNL, DRI.
_JPEG_KEPT = frozenset((*range(0xC0, 0xC5), *range(0xC9, 0xCD), 0xDB, 0xDC, 0xDD, _END, _SCAN))
_JPEG_ALONE = frozenset((0x01, *range(0xD0, 0xD8), _END))
# A scan, with its coded data: up to a marker that is no stuffed byte and no restart.
_CODED = re.compile(rb"(?:[^\xff]|\xff[\x00\xd0-\xd7])*+", re.DOTALL)
_PNG_KEPT = frozenset((b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND"))


def bare_photo(data: bytes, where: Path) -> bytes:
    """Return the parts of a JPEG or PNG that make the picture."""
    try:
        for mark, parts in ((_JPEG, _jpeg_parts), (_PNG, _png_parts)):
            if data.startswith(mark):
                return b"".join(parts(data))
    except (IndexError, ValueError):
        pass
    what, fix = "its metadata cannot be taken out", "write it again, and prepare the benchmark anew"
    raise BenchmarkError(what, where=where, expected="a complete JPEG or PNG", fix=fix)


def _jpeg_parts(data: bytes) -> Iterator[bytes]:
    """Yield the parts that stay; a scan has its coded data with it."""
    yield data[:2]
    place, code = 2, 0
    while code != _END:
        if data[place] != 0xFF:
            raise ValueError("no marker")
        while data[place + 1] == 0xFF:  # fill bytes
            place += 1
        code, end = data[place + 1], place + 2
        if code not in _JPEG_ALONE:
            end += int.from_bytes(data[end : end + 2], "big")
            if end > len(data) or end < place + 4:
                raise ValueError("a segment without an end")
        body = data[place + 4 : end]
        # JFIF without a preview, and how the colours are coded.
        plain = len(body) == 14 and body.startswith(b"JFIF\0") and body[12:] == b"\0\0"
        plain = plain if code == _JFIF else len(body) == 12 and body.startswith(b"Adobe")
        if code == _SCAN and (coded := _CODED.match(data, end)):
            end = coded.end()
        if code in _JPEG_KEPT or (code in (_JFIF, _ADOBE) and plain):
            yield data[place:end]
        place = end


def _png_parts(data: bytes) -> Iterator[bytes]:
    yield _PNG
    place, kind = len(_PNG), b""
    while kind != b"IEND":
        kind = data[place + 4 : place + 8]
        end = place + 12 + int.from_bytes(data[place : place + 4], "big")
        if len(kind) < 4 or end > len(data):
            raise ValueError("a chunk without an end")
        if kind in _PNG_KEPT:
            yield data[place:end]
        place = end
