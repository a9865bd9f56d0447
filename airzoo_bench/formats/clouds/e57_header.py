"""What the XML text of an E57 file says: scans, their poses, and how each number is packed."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import CameraError
from airzoo_bench.formats.clouds.cloud import refusal
from airzoo_bench.formats.clouds.e57_pages import Pages, damaged
from airzoo_bench.geometry.arrays import Floats, apply_matrix
from airzoo_bench.geometry.rotations import quaternion_to_matrix

__all__ = ["Field", "Scan", "Stream", "read_scans"]

_HEADER = struct.Struct("<8sIIQQQQ")
_PAGES = range(128, (1 << 13) + 1)  # files have 1024
_LONGEST_XML = 1 << 26
_MOST_BITS = 64
_MOST_POINTS = 1 << 48
_NAMESPACE = "{http://www.astm.org/COMMIT/E57/2010-e57-v1.0}"
_INT64 = 1 << 63


@dataclass(frozen=True)
class Field:
    """How a number of a point is packed.

    Attributes
    ----------
    dtype : str or None
        Floating point; None for whole numbers of `bits` bits.
    bits : int
        0 where all are the same.
    least, most : float
    scale, offset : float
    """

    dtype: str | None
    bits: int
    least: float
    most: float
    scale: float = 1.0
    offset: float = 0.0

    @property
    def precision(self) -> np.dtype[Any]:
        """Floating point that holds all the digits of the file."""
        return np.dtype(self.dtype or "<f8")

    def stream(self) -> Stream:
        """Return a stream of such numbers, at its start."""
        return Stream(self)

    def share(self, values: Floats) -> Floats:
        """Return where values lie between the least and the most, 0 to 1."""
        span = (self.most - self.least) * self.scale
        low = self.least * self.scale + self.offset
        shares = np.zeros(len(values)) if not span else (values - low) / span
        return np.clip(np.nan_to_num(shares, nan=0.0), 0.0, 1.0)


@dataclass(eq=False)
class Stream:
    """Numbers of a field, of which packets bring more and more bytes."""

    kind: Field
    _bytes: bytearray = field(default_factory=bytearray)
    _bit: int = 0

    @property
    def ready(self) -> int:
        """How many numbers are there."""
        if self.kind.bits == 0:
            return _MOST_POINTS
        return max(8 * len(self._bytes) - self._bit, 0) // self.kind.bits

    @property
    def held(self) -> int:
        """How many bytes wait."""
        return len(self._bytes)

    def feed(self, more: bytes) -> None:
        """Add the bytes of a packet."""
        if self.kind.bits:
            self._bytes += more

    def take(self, count: int) -> Floats:
        """Return the next numbers (count,)."""
        one = self.kind
        if one.bits == 0:
            return np.full(count, one.least * one.scale + one.offset)
        if one.dtype is not None:
            width = one.bits // 8
            values: Floats = np.frombuffer(bytes(self._bytes[: count * width]), one.dtype).astype(
                np.float64
            )
            del self._bytes[: count * width]
            return values
        whole = self._integers(count)
        return (whole.astype(np.float64) + one.least) * one.scale + one.offset

    def _integers(self, count: int) -> NDArray[np.uint64]:
        """Unpack whole numbers, the lowest bit first."""
        bits, end = self.kind.bits, self._bit + count * self.kind.bits
        raw = np.frombuffer(bytes(self._bytes[: -(-end // 8)]), np.uint8)
        if bits % 8 == 0 and self._bit == 0:
            rows = raw.reshape(count, bits // 8).astype(np.uint64)
            weights = np.arange(0, bits, 8, dtype=np.uint64)
        else:
            spread = np.unpackbits(raw, bitorder="little")[self._bit : end]
            rows = spread.reshape(count, bits).astype(np.uint64)
            weights = np.arange(bits, dtype=np.uint64)
        del self._bytes[: end // 8]
        self._bit = end % 8
        found: NDArray[np.uint64] = (rows << weights).sum(axis=1, dtype=np.uint64)
        return found


@dataclass(frozen=True, eq=False)
class Scan:
    """A scan: fields of its points in the order of their streams, its place in file and world."""

    fields: dict[str, Field]
    count: int
    offset: int
    rotation: Floats
    translation: Floats

    def placed(self, points: Floats) -> Floats:
        """Bring points (N, 3) of the scanner's frame to the world's; exact where it has no pose."""
        if (self.rotation == np.eye(3)).all():
            return points + self.translation
        return apply_matrix(self.rotation, points) + self.translation


def read_scans(path: Path) -> tuple[Pages, list[Scan]]:
    """Read what scans a file holds.

    Raises
    ------
    PredictionError
        Its header or its XML text is damaged, or counts what it has no room for.
    """
    with path.open("rb") as stream:
        head = stream.read(_HEADER.size).ljust(_HEADER.size, b"\0")
    _, major, _, _, xml_at, xml_bytes, page = _HEADER.unpack(head)
    size = path.stat().st_size
    if major != 1 or page not in _PAGES or not 0 < xml_bytes <= min(size, _LONGEST_XML):
        raise damaged(path, "its head is not one of version 1")
    pages = Pages(path, page, size)
    text = pages.read(xml_at, xml_bytes, physical=True)
    if b"<!" in text.replace(b"<![CDATA[", b"").replace(b"<!--", b""):
        raise damaged(path, "its XML text declares what none of its kind does")
    try:
        root = ElementTree.fromstring(text)
        scans = [_scan(one) for one in root.findall(f"{_NAMESPACE}data3D/{_NAMESPACE}vectorChild")]
    except (ElementTree.ParseError, ValueError, KeyError, OverflowError, CameraError) as error:
        raise damaged(path, "its XML text is none of an E57 file") from error
    for scan in scans:
        _check_room(path, scan, size)
    return pages, scans


def _check_room(path: Path, scan: Scan, size: int) -> None:
    bits = sum(one.bits for one in scan.fields.values())
    if not bits or scan.count * bits > 8 * size:
        raise refusal(
            path,
            f"a scan counts {scan.count:,} points, which the file has no room for",
            expected="all points that it counts",
        )


def _scan(element: ElementTree.Element) -> Scan:
    points = _child(element, "points")
    prototype = _child(points, "prototype")
    fields = {one.tag.removeprefix(_NAMESPACE): _field(one) for one in prototype}
    if len(fields) != len(prototype):
        raise ValueError("a field twice")
    count, offset = int(points.attrib["recordCount"]), int(points.attrib["fileOffset"])
    if not (0 <= count <= _MOST_POINTS and 0 < offset < _INT64):
        raise ValueError("an absurd count")
    pose = element.find(f"{_NAMESPACE}pose")
    turn = _numbers(pose, "rotation", "wxyz", (1.0, 0.0, 0.0, 0.0))
    move = _numbers(pose, "translation", "xyz", (0.0, 0.0, 0.0))
    return Scan(fields, count, offset, quaternion_to_matrix([turn])[0], np.array(move))


def _child(element: ElementTree.Element, name: str) -> ElementTree.Element:
    found = element.find(f"{_NAMESPACE}{name}")
    if found is None:
        raise KeyError(name)
    return found


def _numbers(
    pose: ElementTree.Element | None, name: str, parts: str, default: tuple[float, ...]
) -> tuple[float, ...]:
    """Return the parts of a rotation or translation; what is left out is 0."""
    found = None if pose is None else pose.find(f"{_NAMESPACE}{name}")
    if found is None:
        return default
    return tuple(_finite(found.findtext(f"{_NAMESPACE}{part}") or "0") for part in parts)


def _field(element: ElementTree.Element) -> Field:
    said = element.attrib.get
    if said("type") == "Float":
        single = said("precision") == "single"
        least, most = _finite(said("minimum", "0")), _finite(said("maximum", "1"))
        return Field("<f4" if single else "<f8", 32 if single else 64, least, most)
    low, high = int(said("minimum", str(-_INT64))), int(said("maximum", str(_INT64 - 1)))
    if said("type") not in ("Integer", "ScaledInteger") or not -_INT64 <= low <= high < _INT64:
        raise ValueError("a field of another type")
    scale, offset = _finite(said("scale", "1")), _finite(said("offset", "0"))
    return Field(None, (high - low).bit_length(), low, high, scale, offset)


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError("a number that is not finite")
    return value
