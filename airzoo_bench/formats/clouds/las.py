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

from airzoo_bench.core.errors import PredictionError, counted
from airzoo_bench.formats.clouds.cloud import (
    FIX_COPY,
    Cloud,
    FileCloud,
    columns_to_points,
    refusal,
    uncounted,
)

__all__ = ["open_las", "read_projection"]

_SHORTEST = 227
_VLR_BYTES = 54
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
            raise refusal(
                path, f"its scale and offset are {numbers.tolist()}", expected="finite numbers"
            )
        compressed, count = header.are_points_compressed, header.point_count
        left, what = (_beyond_laz if compressed else _beyond_las)(path, header)
    if left < 0:
        raise _too_few(path, count)
    kind = "LAZ" if compressed else "LAS"
    notes = uncounted(left, what, count)
    return FileCloud(path, kind, count, partial(_read, path), np.dtype(np.float64), notes)


def read_projection(path: Path) -> bytes:
    """Return what the records of a file say of its CRS; nothing where they do not."""
    with _opened(path) as reader:
        records = [one for one in reader.header.vlrs if one.user_id == "LASF_Projection"]
        return b"".join(
            one.record_id.to_bytes(2, "little") + one.record_data_bytes() for one in records
        )


@contextmanager
def _opened(path: Path) -> Iterator[laspy.LasReader]:
    """Open a file whose header counts no more records than there is room for."""
    with path.open("rb") as stream:
        raw = stream.read(_SHORTEST)
    if len(raw) < _SHORTEST or raw[:4] != b"LASF":
        raise refusal(path, "the LAS header is cut off", fix=FIX_COPY)
    header_bytes, start, records = struct.unpack_from("<HII", raw, 94)
    room = (start - header_bytes) // _VLR_BYTES
    sound = _SHORTEST <= header_bytes <= start <= path.stat().st_size and raw[24] == 1
    if not sound or records > room:
        raise refusal(
            path, f"the LAS header contradicts itself: points from byte {start:,}", fix=FIX_COPY
        )
    try:
        with laspy.open(path, read_evlrs=False) as reader:
            yield reader
    except FileNotFoundError:
        raise
    except _DAMAGE as error:
        raise _damaged(path, error) from error
    except BaseException as error:
        if type(error).__module__ != _PANIC:
            raise
        raise _damaged(path, error) from error


def _beyond_las(path: Path, header: laspy.LasHeader) -> tuple[int, str]:
    """Return how many bytes follow the points that the header counts, before other records."""
    size, start = path.stat().st_size, header.offset_to_point_data
    marks = header.start_of_first_evlr, header.start_of_waveform_data_packet_record
    end = min((mark for mark in marks if mark and start < mark < size), default=size)
    if size < start + header.point_count * header.point_format.size:
        return -1, "bytes"
    left = end - start - header.point_count * header.point_format.size
    return left if left >= header.point_format.size else 0, "bytes"


def _beyond_laz(path: Path, header: laspy.LasHeader) -> tuple[int, str]:
    """Return how much the chunks hold beyond the points that the header counts; below 0 if less."""
    start, size, count = header.offset_to_point_data, header.point_format.size, header.point_count
    laszip = header.vlrs.get("LasZipVlr")[0].record_data
    vlr = lazrs.LazVlr(laszip)
    if vlr.item_size() != size:
        raise ValueError(f"points of {size} bytes are compressed as {vlr.item_size()} bytes")
    with path.open("rb") as stream:
        _check_chunk_count(path, stream, start, vlr.item_size())
        stream.seek(start)
        # Writers of chunks of any size may end with one of nothing.
        chunks = [some for some in lazrs.read_chunk_table(stream, vlr) if any(some)]
        if start + 8 + sum(nbytes for _, nbytes in chunks) > path.stat().st_size:
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
    left = _left_in_last_chunk(path, laszip, start, before, header)
    left += start + 8 + sum(nbytes for _, nbytes in chunks)
    # A decoder asks for bytes before it needs them.
    return (left if not -2 * _LAST_BYTES <= left <= _LAST_BYTES else 0), "compressed bytes"


def _check_chunk_count(path: Path, stream: Any, start: int, point_bytes: int) -> None:
    """Refuse a table of more chunks than fit: lazrs takes the memory, or ends the process."""
    size = path.stat().st_size
    stream.seek(start)
    table = int.from_bytes(stream.read(8), "little", signed=True)
    if table == -1:
        stream.seek(size - 8)
        table = int.from_bytes(stream.read(8), "little", signed=True)
    if not start + 8 <= table <= size - 8:
        raise ValueError("the file ends before its chunk table")
    stream.seek(table + 4)
    chunks = int.from_bytes(stream.read(4), "little")
    if chunks > (table - start - 8) // point_bytes:
        raise ValueError(f"its table lists {counted(chunks, 'chunk')}")


def _left_in_last_chunk(
    path: Path, laszip: bytes, start: int, before: int, header: laspy.LasHeader
) -> int:
    """Decode the last chunk, and return the place in the file where that ends, below 0."""
    with _Dripping(path) as stream:
        stream.seek(start)
        decompressor = lazrs.LasZipDecompressor(stream, laszip)
        decompressor.seek(before)
        for done in range(before, header.point_count, _BLOCK_POINTS):
            points = min(_BLOCK_POINTS, header.point_count - done)
            decompressor.decompress_many(np.empty(points * header.point_format.size, np.uint8))
        return -stream.tell()


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
                yield Cloud(columns_to_points(*(np.asarray(chunk[axis]) for axis in "xyz")))
            done += len(chunk)
        if done != reader.header.point_count:
            raise _too_few(path, reader.header.point_count)


def _too_few(path: Path, count: int) -> PredictionError:
    return refusal(
        path,
        f"its header promises {counted(count, 'point')}, and the file holds fewer",
        expected="all points that the header promises",
        fix=FIX_COPY,
    )


def _damaged(path: Path, error: BaseException) -> PredictionError:
    what = f"the LAS or LAZ file is damaged or cut off: {str(error)[:200] or type(error).__name__}"
    return refusal(path, what, fix=FIX_COPY)
