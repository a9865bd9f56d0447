"""LAS and LAZ: the header read here, the compressed body by lazrs.

The header is a table of fixed places, and laspy reads it trustingly: a number of records of
4 billion keeps it busy for hours. lazrs in turn takes the memory that the chunk table asks for, and
ends the whole process where there is none. So every number that memory follows from is first
checked against the size of the file.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.plurals import counted
from airzoo_bench.formats.clouds.cloud import (
    FIX_COPY,
    Cloud,
    FileCloud,
    columns_to_points,
    read_records,
    refusal,
    uncounted,
)
from airzoo_bench.formats.clouds.laz import LazBody
from airzoo_bench.geometry.arrays import Floats

__all__ = ["LasHeader", "open_las", "read_header"]

_SHORTEST = 227
_RGB_AT = {2: 20, 3: 28, 5: 28, 7: 30, 8: 30, 10: 30}
_BASE_SIZE = {0: 20, 1: 28, 2: 26, 3: 34, 4: 57, 5: 63, 6: 30, 7: 36, 8: 38, 9: 59, 10: 67}
_VLR_HEADER = 54
_LASZIP = (b"laszip encoded", 22204)
_PROJECTION = b"LASF_Projection"
_COLOUR_PROBE = 50_000


@dataclass(frozen=True, eq=False)
class LasHeader:
    """What of a LAS header the points need.

    Attributes
    ----------
    version : tuple of int
    compressed : bool
    point_format : int
        0 to 10.
    record_bytes : int
    count : int
    start, end : int
        Where the points begin, and where in the file something else may follow them.
    scale, offset : (3,) float64
        World coordinate = integer * scale + offset.
    laszip : bytes or None
        The record that LASzip leaves for its reader.
    projection : bytes
        What its records say of a CRS; nothing where they do not.
    """

    version: tuple[int, int]
    compressed: bool
    point_format: int
    record_bytes: int
    count: int
    start: int
    end: int
    scale: Floats
    offset: Floats
    laszip: bytes | None
    projection: bytes

    @property
    def record(self) -> np.dtype[Any]:
        """Type of a point: integer coordinates and, where there are any, colours."""
        names, kinds, places = ["xyz"], [("<i4", 3)], [0]
        if self.point_format in _RGB_AT:
            names, kinds = [*names, "rgb"], [*kinds, ("<u2", 3)]
            places = [*places, _RGB_AT[self.point_format]]
        layout: Any = {"names": names, "formats": kinds, "offsets": places}
        record: np.dtype[Any] = np.dtype(layout | {"itemsize": self.record_bytes})
        return record

    def compressed_in(self, path: Path, stream: IO[bytes]) -> LazBody:
        """Return the compressed points of a file."""
        laszip = self.laszip or b""
        return LazBody(path, stream, laszip, self.start, self.record_bytes, self.count)


def open_las(path: Path) -> FileCloud:
    """Open a LAS or LAZ file."""
    header = read_header(path)
    kind = "LAZ" if header.compressed else "LAS"
    shift = _colour_shift(path, header)
    read = partial(_read, path, header, shift)
    notes = _more_than_promised(path, header)
    return FileCloud(path, kind, header.count, read, np.dtype(np.float64), notes)


def read_header(path: Path) -> LasHeader:
    """Read and check the header of a LAS or LAZ file."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        raw = stream.read(375)
        if len(raw) < _SHORTEST or raw[:4] != b"LASF":
            raise refusal(path, "the LAS header is cut off", fix=FIX_COPY)
        header_bytes, start, n_vlrs, form, record_bytes, count = struct.unpack_from(
            "<HIIBHI", raw, 94
        )
        version = (raw[24], raw[25])
        if version >= (1, 4) and len(raw) >= 255:
            count = struct.unpack_from("<Q", raw, 247)[0]
        point_format = form & 0x3F
        _check_header(path, version, point_format, record_bytes, header_bytes, start, size)
        stream.seek(header_bytes)
        laszip, projection = _records_of(path, stream, n_vlrs, start - header_bytes)
    numbers = np.frombuffer(raw, "<f8", 6, 131).astype(np.float64)
    if not (np.isfinite(numbers).all() and (numbers[:3] != 0).all()):
        raise refusal(
            path, f"its scale and offset are {numbers.tolist()}", expected="finite numbers"
        )
    compressed = bool(form & 0xC0)
    header = LasHeader(
        version,
        compressed,
        point_format,
        record_bytes,
        count,
        start,
        _end_of_points(raw, version, start, size),
        numbers[:3],
        numbers[3:],
        laszip,
        projection,
    )
    _check_body(path, header, size)
    return header


def _end_of_points(raw: bytes, version: tuple[int, int], start: int, size: int) -> int:
    """Return where waveforms or extended records begin, else the end of the file."""
    places = {(1, 3): 227, (1, 4): 235}
    marks = [
        struct.unpack_from("<Q", raw, place)[0]
        for since, place in places.items()
        if version >= since and len(raw) >= place + 8
    ]
    return min((mark for mark in marks if start < mark < size), default=size)


def _more_than_promised(path: Path, header: LasHeader) -> tuple[str, ...]:
    if not header.compressed:
        left = header.end - header.start - header.count * header.record_bytes
        return uncounted(left if left >= header.record_bytes else 0, "bytes", header.count)
    with path.open("rb") as stream:
        left, what = header.compressed_in(path, stream).beyond_count()
    return uncounted(left, what, header.count)


def _check_header(
    path: Path,
    version: tuple[int, int],
    point_format: int,
    record_bytes: int,
    header_bytes: int,
    start: int,
    size: int,
) -> None:
    if version[0] != 1 or point_format not in _BASE_SIZE:
        raise refusal(
            path,
            f"LAS version {version[0]}.{version[1]} with point format {point_format}",
            expected="version 1.0 to 1.5, point format 0 to 10",
        )
    sound = _SHORTEST <= header_bytes <= start <= size
    if not sound or record_bytes < _BASE_SIZE[point_format]:
        raise refusal(
            path,
            f"the LAS header contradicts itself: points of {record_bytes} bytes from byte {start:,}"
            f" of {size:,}",
            fix=FIX_COPY,
        )


def _check_body(path: Path, header: LasHeader, size: int) -> None:
    room = (size - header.start) // header.record_bytes
    if not header.compressed and room < header.count:
        raise refusal(
            path,
            f"its header promises {counted(header.count, 'point')}, the file has room for {room:,}",
            expected="all points that the header promises",
            fix=FIX_COPY,
        )
    if header.compressed and header.laszip is None:
        raise refusal(path, "its points are compressed, but how is not said", fix=FIX_COPY)


def _records_of(path: Path, stream: IO[bytes], count: int, room: int) -> tuple[bytes | None, bytes]:
    """Return the records of LASzip and of the projection."""
    laszip, projection = None, b""
    for _ in range(count):
        head = stream.read(_VLR_HEADER)
        room -= len(head)
        length = int.from_bytes(head[20:22], "little")
        if len(head) < _VLR_HEADER or room < length:
            raise refusal(path, "its variable length records are cut off", fix=FIX_COPY)
        data = stream.read(length)
        room -= length
        user, number = head[2:18].split(b"\0")[0], int.from_bytes(head[18:20], "little")
        if (user, number) == _LASZIP:
            laszip = data
        elif user == _PROJECTION:
            projection += head[18:22] + data
    return laszip, projection


def _colour_shift(path: Path, header: LasHeader) -> int:
    if "rgb" not in (header.record.names or ()):
        return 0
    block = next(_records(path, header, min(_COLOUR_PROBE, max(header.count, 1))), None)
    return 8 if block is not None and block["rgb"].max(initial=0) > 255 else 0


def _read(path: Path, header: LasHeader, shift: int, points: int) -> Iterator[Cloud]:
    for block in _records(path, header, points):
        with np.errstate(over="ignore", invalid="ignore"):
            xyz = [block["xyz"][:, a] * header.scale[a] + header.offset[a] for a in range(3)]
        colours = None
        if "rgb" in (block.dtype.names or ()):
            colours = np.minimum(block["rgb"] >> np.uint16(shift), 255).astype(np.uint8)
        yield Cloud(columns_to_points(*xyz), colours)


def _records(path: Path, header: LasHeader, points: int) -> Iterator[NDArray[Any]]:
    if not (header.compressed and header.count):
        yield from read_records(path, header.record, header.start, header.count, points)
        return
    with path.open("rb", buffering=0) as stream:
        for raw in header.compressed_in(path, stream).records(points):
            yield raw.view(header.record)
