"""LAS and LAZ by laspy, once what their headers count is held against the file.

laspy takes a number of records as it is stated, and lazrs decodes points that are not there: it
reads on behind the last one.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import laspy
import lazrs
import numpy as np
from laspy.errors import LaspyException

from airzoo_bench.formats.clouds.cloud import (
    FIX_COPY,
    Cloud,
    FileCloud,
    cloud_of_columns,
    refusal,
    too_few,
    uncounted,
)

__all__ = ["open_las"]

_SHORTEST, _VLR_BYTES = 227, 54
_DAMAGE = (
    *(LaspyException, lazrs.LazrsError, ArithmeticError, LookupError, MemoryError),
    *(OSError, TypeError, ValueError, struct.error),
)
_PANIC = "pyo3_runtime"  # of what Rust raises, which is no Exception and has no name
_LAYERED = 3  # the compressor of point formats 6 and above, which counts the points of each chunk
_LAST_BYTES = 16  # that an encoder may write behind the last point
_BLOCK_POINTS = 50_000


def open_las(path: Path) -> FileCloud:
    """Open a LAS or LAZ file."""
    with _opened(path) as reader:
        header = reader.header
        numbers = np.concatenate([header.scales, header.offsets])
        if not (np.isfinite(numbers).all() and (header.scales != 0).all()):
            raise ValueError(f"its scale and offset are {numbers.tolist()}")
        compressed, count = header.are_points_compressed, header.point_count
        left, what = (_beyond_laz if compressed else _beyond_las)(path, header)
    if left < 0:
        raise too_few(path, count)
    kind, notes = "LAZ" if compressed else "LAS", uncounted(left, what, count)
    return FileCloud(path, kind, count, partial(_read, path), np.dtype(np.float64), notes)


@contextmanager
def _opened(path: Path) -> Iterator[laspy.LasReader]:
    """Open a file whose header counts no more records than there is room for."""
    try:
        with path.open("rb") as stream:
            raw = stream.read(_SHORTEST)
        header_bytes, start, records = struct.unpack_from("<HII", raw, 94)
        room = (start - header_bytes) // _VLR_BYTES
        if not _SHORTEST <= header_bytes <= start <= path.stat().st_size or records > room:
            raise ValueError(f"its header contradicts itself: points from byte {start:,}")
        with laspy.open(path, read_evlrs=False) as reader:
            yield reader
    except BaseException as error:
        if not isinstance(error, _DAMAGE) and type(error).__module__ != _PANIC:
            raise
        why = str(error)[:200] or type(error).__name__
        raise refusal(
            path, f"the LAS or LAZ file is damaged or cut off: {why}", fix=FIX_COPY
        ) from error


def _beyond_las(path: Path, header: laspy.LasHeader) -> tuple[int, str]:
    """Return how many bytes follow the points that the header counts, before other records."""
    size, start = path.stat().st_size, header.offset_to_point_data
    end = start + header.point_count * header.point_format.size
    marks = header.start_of_first_evlr, header.start_of_waveform_data_packet_record
    last = min((mark for mark in marks if mark and start < mark < size), default=size)
    if size < end:
        return -1, "bytes"
    return (last - end if last - end >= header.point_format.size else 0), "bytes"


def _beyond_laz(path: Path, header: laspy.LasHeader) -> tuple[int, str]:
    """Return how much the chunks hold beyond the points that the header counts; below 0 if less."""
    start, size, count = header.offset_to_point_data, header.point_format.size, header.point_count
    laszip = header.vlrs.get("LasZipVlr")[0].record_data
    vlr = lazrs.LazVlr(laszip)
    if vlr.item_size() != size:
        raise ValueError(f"points of {size} bytes are compressed as {vlr.item_size()} bytes")
    with path.open("rb") as stream:
        _check_chunk_count(stream, start, path.stat().st_size, size)
        stream.seek(start)
        # Writers of chunks of any size may end with one of nothing.
        chunks = [some for some in lazrs.read_chunk_table(stream, vlr) if any(some)]
        end = start + 8 + sum(nbytes for _, nbytes in chunks)
        if end > path.stat().st_size:
            return -1, "points"
        if struct.unpack_from("<H", laszip)[0] == _LAYERED:
            place, total = start + 8, 0
            for _, nbytes in chunks:
                stream.seek(place + size)
                total += int.from_bytes(stream.read(4), "little")
                place += nbytes
            return total - count, "points"
    before = sum(points for points, _ in chunks[:-1])
    if not chunks or not before < count <= before + chunks[-1][0]:
        return (-1 if count else 0), "points"
    left = end - _end_of_points(path, laszip, before, header)
    # A decoder asks for bytes before it needs them.
    return (left if not -2 * _LAST_BYTES <= left <= _LAST_BYTES else 0), "compressed bytes"


def _check_chunk_count(stream: Any, start: int, size: int, point_bytes: int) -> None:
    """Refuse a table of more chunks than fit: lazrs ends the process for want of memory."""
    for place in (start, size - 8):  # where a writer could not go back, its place is at the end
        stream.seek(place)
        table = int.from_bytes(stream.read(8), "little", signed=True)
        if table != -1:
            break
    if not start + 8 <= table <= size - 8:
        raise ValueError("the file ends before its chunk table")
    stream.seek(table + 4)
    chunks = int.from_bytes(stream.read(4), "little")
    if chunks > (table - start - 8) // point_bytes:
        raise ValueError(f"its table lists {chunks:,} chunks")


def _end_of_points(path: Path, laszip: bytes, before: int, header: laspy.LasHeader) -> int:
    """Decode the last chunk, and return the place in the file that this takes."""
    with _Dripping(path) as stream:
        stream.seek(header.offset_to_point_data)
        decompressor = lazrs.LasZipDecompressor(stream, laszip)
        decompressor.seek(before)
        for done in range(before, header.point_count, _BLOCK_POINTS):
            points = min(_BLOCK_POINTS, header.point_count - done)
            decompressor.decompress_many(np.empty(points * header.point_format.size, np.uint8))
        return stream.tell()


class _Dripping(io.FileIO):
    """A file that gives few bytes at a time, so that its place shows what a decoder took."""

    def readinto(self, buffer: Any, /) -> int:
        return super().readinto(memoryview(buffer)[:_LAST_BYTES]) or 0

    def read(self, size: int | None = -1, /) -> bytes:
        return super().read(min(size or 0, _LAST_BYTES) if (size or 0) >= 0 else _LAST_BYTES) or b""


def _read(path: Path, points: int) -> Iterator[Cloud]:
    with _opened(path) as reader:
        done = 0
        for chunk in reader.chunk_iterator(points):
            with np.errstate(over="ignore", invalid="ignore"):
                yield cloud_of_columns({axis: np.asarray(chunk[axis]) for axis in "xyz"})
            done += len(chunk)
        if done != reader.header.point_count:
            raise too_few(path, reader.header.point_count)
