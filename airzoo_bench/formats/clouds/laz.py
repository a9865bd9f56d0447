"""The compressed body of LAZ files, by lazrs, once its tables are checked against the file."""

from __future__ import annotations

import io
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import lazrs
import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.plurals import counted
from airzoo_bench.formats.clouds.cloud import FIX_COPY, cloud_error

__all__ = ["LazBody", "beyond_count", "open_decompressor"]

_CHUNKED = (2, 3)
_LAYERED = 3
_RECORD_BYTES = 34
_ITEM_BYTES = 6
_MOST_CHUNK_BYTES = 1 << 29
_LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}
_EXTRA_BYTES_ITEM = 14
_DRIP = 64
_END_OF_CODE = 16  # bytes that an encoder may write behind the last point
_BLOCK_POINTS = 50_000
# What Rust raises of data that it did not foresee; no Exception, and lazrs exports no name of it.
_PANIC = "pyo3_runtime"
_DAMAGE = (lazrs.LazrsError, OSError, ValueError, OverflowError)


@dataclass(frozen=True, eq=False)
class LazBody:
    """A decompressor at the first point."""

    path: Path
    decompressor: Any
    record_bytes: int

    def take(self, points: int) -> NDArray[np.uint8]:
        """Return the next records, as bytes.

        Raises
        ------
        PredictionError
            The data are damaged or cut off.
        """
        block = np.empty(points * self.record_bytes, np.uint8)
        try:
            self.decompressor.decompress_many(block)
        except lazrs.LazrsError as error:
            raise _damaged(self.path, str(error)) from error
        except BaseException as error:
            if type(error).__module__ != _PANIC:
                raise
            raise _damaged(self.path, str(error)) from error
        return block


def open_decompressor(
    path: Path, stream: IO[bytes], laszip: bytes, record_bytes: int, count: int
) -> LazBody:
    """Open the compressed points that begin where the stream stands.

    Parameters
    ----------
    path : Path
    stream : binary file
    laszip : bytes
        The LASzip record.
    record_bytes : int
        Size of a point.
    count : int
        How many points there are.

    Raises
    ------
    PredictionError
        Its tables do not fit the file, or the compression is not a known one.
    """
    start = stream.tell()
    try:
        _checked_chunks(path, stream, laszip, start, record_bytes, count)
        stream.seek(start)
        decompressor = lazrs.ParLasZipDecompressor(stream, laszip)
    except _DAMAGE as error:
        raise _damaged(path, str(error)) from error
    return LazBody(path, decompressor, record_bytes)


def beyond_count(
    path: Path, stream: IO[bytes], laszip: bytes, record_bytes: int, count: int
) -> tuple[int, str]:
    """Return how much the compressed points hold beyond those that the header counts, and of what.

    Layered chunks say how many points they hold. Of others the last is decoded: what it did not
    take of its bytes are further points.

    Parameters
    ----------
    path, stream, laszip, record_bytes, count
        As of `open_decompressor`.

    Returns
    -------
    left : int
        At most 0 where there is nothing.
    what : str
        ``"points"`` or ``"compressed bytes"``.

    Raises
    ------
    PredictionError
        As of `open_decompressor`.
    """
    start = stream.tell()
    try:
        chunks = _checked_chunks(path, stream, laszip, start, record_bytes, count)
        if not chunks:
            return 0, "points"
        if struct.unpack_from("<H", laszip)[0] == _LAYERED:
            return _layered_points(stream, chunks, start + 8, record_bytes) - count, "points"
        left = _left_in_last_chunk(path, laszip, chunks, start, record_bytes, count)
    except _DAMAGE as error:
        raise _damaged(path, str(error)) from error
    return left if left > _END_OF_CODE else 0, "compressed bytes"


class _Dripping(io.FileIO):
    """A file that gives few bytes at a time, so that its place shows what a decoder took."""

    def readinto(self, buffer: Any, /) -> int:
        return super().readinto(memoryview(buffer)[:_DRIP]) or 0

    def read(self, size: int | None = -1, /) -> bytes:
        return super().read(_DRIP if size is None or size < 0 else min(size, _DRIP)) or b""


def _left_in_last_chunk(
    path: Path,
    laszip: bytes,
    chunks: list[tuple[int, int]],
    start: int,
    record_bytes: int,
    count: int,
) -> int:
    end = start + 8 + sum(held for _, held in chunks)
    first = sum(points for points, _ in chunks[:-1])
    if not 0 <= first < count:
        return 0
    with _Dripping(path) as stream:
        stream.seek(start)
        decompressor = lazrs.LasZipDecompressor(stream, laszip)
        decompressor.seek(first)
        for done in range(first, count, _BLOCK_POINTS):
            points = min(_BLOCK_POINTS, count - done)
            decompressor.decompress_many(np.empty(points * record_bytes, np.uint8))
        return end - stream.tell()


def _layered_points(
    stream: IO[bytes], chunks: list[tuple[int, int]], start: int, record_bytes: int
) -> int:
    total = 0
    for _, held in chunks:
        stream.seek(start + record_bytes)
        total += int.from_bytes(stream.read(4), "little")
        start += held
    return total


def _checked_chunks(
    path: Path, stream: IO[bytes], laszip: bytes, start: int, record_bytes: int, count: int
) -> list[tuple[int, int]]:
    """Points and bytes of each chunk, once they have been checked against the file."""
    _check_items(path, laszip, record_bytes)
    vlr = lazrs.LazVlr(laszip)
    stream.seek(start)
    _check_chunk_count(path, stream, vlr, start, count)
    stream.seek(start)
    chunks: list[tuple[int, int]] = lazrs.read_chunk_table(stream, vlr)
    _check_chunks(path, stream, laszip, chunks, start, record_bytes, count)
    return chunks


def _items(laszip: bytes) -> list[tuple[int, int]]:
    """Types and sizes of the parts of a point."""
    count = struct.unpack_from("<H", laszip, 32)[0]
    return [
        struct.unpack_from("<HH", laszip, _RECORD_BYTES + _ITEM_BYTES * item)
        for item in range(count)
    ]


def _check_items(path: Path, laszip: bytes, record_bytes: int) -> None:
    if len(laszip) < _RECORD_BYTES:
        raise _damaged(path, "its LASzip record is cut off")
    if struct.unpack_from("<H", laszip, 32)[0] * _ITEM_BYTES + _RECORD_BYTES != len(laszip):
        raise _damaged(path, "its LASzip record is cut off")
    compressor = struct.unpack_from("<H", laszip)[0]
    if compressor not in _CHUNKED:
        raise cloud_error(
            path,
            f"LAZ compressed in the way number {compressor}",
            expected="chunks (2 or 3), as LASzip writes since version 2",
            fix="write it again with a newer tool, or give LAS or PLY",
        )
    total = sum(size for _, size in _items(laszip))
    if total != record_bytes:
        raise _damaged(path, f"points of {record_bytes} bytes are compressed as {total} bytes")


def _check_chunk_count(path: Path, stream: IO[bytes], vlr: Any, start: int, count: int) -> None:
    size = path.stat().st_size
    table = int.from_bytes(stream.read(8), "little", signed=True)
    if table == -1:
        stream.seek(max(size - 8, start))
        table = int.from_bytes(stream.read(8), "little", signed=True)
    if not start + 8 <= table <= size - 8:
        raise _damaged(path, "the file ends before its chunk table")
    stream.seek(table)
    chunks = struct.unpack("<II", stream.read(8))[1]
    # A chunk holds its first point as it is, so that it takes a point's bytes at least.
    most = (table - start - 8) // vlr.item_size()
    wanted = None if vlr.uses_variable_size_chunks() else -(-count // max(vlr.chunk_size(), 1))
    if chunks > most or (wanted is not None and chunks != wanted):
        raise _damaged(
            path, f"its table lists {counted(chunks, 'chunk')} for {counted(count, 'point')}"
        )


def _check_chunks(
    path: Path,
    stream: IO[bytes],
    laszip: bytes,
    chunks: list[tuple[int, int]],
    start: int,
    record_bytes: int,
    count: int,
) -> None:
    room = path.stat().st_size - start - 8
    if sum(held for _, held in chunks) > room or sum(points for points, _ in chunks) < count:
        raise _damaged(path, "the chunks of its table do not fit the file")
    largest = max((points for points, _ in chunks), default=0) * record_bytes
    if largest > _MOST_CHUNK_BYTES:
        raise cloud_error(
            path,
            f"chunks of {largest:,} bytes cannot be read in pieces",
            expected=f"at most {_MOST_CHUNK_BYTES:,} bytes, usually 50,000 points",
            fix="write it again with the usual size of chunks",
        )
    if struct.unpack_from("<H", laszip)[0] == _LAYERED:
        _check_layers(path, stream, _items(laszip), chunks, start + 8, record_bytes)


def _check_layers(
    path: Path,
    stream: IO[bytes],
    items: list[tuple[int, int]],
    chunks: list[tuple[int, int]],
    start: int,
    record_bytes: int,
) -> None:
    layers = sum(
        size if kind == _EXTRA_BYTES_ITEM else _LAYERS.get(kind, 0) for kind, size in items
    )
    for _, held in chunks:
        stream.seek(start + record_bytes + 4)
        sizes = np.frombuffer(stream.read(4 * layers).ljust(4 * layers, b"\xff"), "<u4")
        if int(sizes.sum(dtype=np.int64)) + record_bytes + 4 + 4 * layers > held:
            raise _damaged(path, "the layers of a chunk do not fit it")
        start += held


def _damaged(path: Path, reason: str) -> PredictionError:
    return cloud_error(path, f"the LAZ file is damaged or cut off: {reason[:200]}", fix=FIX_COPY)
