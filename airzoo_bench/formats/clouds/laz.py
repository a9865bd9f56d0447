"""The compressed body of LAZ files, by lazrs, once its tables are checked against the file."""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import lazrs
import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.plurals import counted
from airzoo_bench.formats.clouds.cloud import FIX_COPY, refusal

__all__ = ["LazBody"]

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

Chunks = list[tuple[int, int]]
"""Points and bytes of each chunk."""


@dataclass(frozen=True, eq=False)
class LazBody:
    """The compressed points of a file.

    Attributes
    ----------
    path : Path
    stream : binary file
    laszip : bytes
        The record that LASzip leaves for its reader.
    start : int
        Where the compressed points begin.
    record_bytes : int
        Size of a point.
    count : int
        How many points the header of the file counts.
    """

    path: Path
    stream: IO[bytes]
    laszip: bytes
    start: int
    record_bytes: int
    count: int

    def records(self, points: int) -> Iterator[NDArray[np.uint8]]:
        """Yield the points as bytes, at most that many points at a time."""
        try:
            self._checked_chunks()
            self.stream.seek(self.start)
            decompressor = lazrs.ParLasZipDecompressor(self.stream, self.laszip)
        except _DAMAGE as error:
            raise self._damaged(str(error)) from error
        for done in range(0, self.count, points):
            block = np.empty(min(points, self.count - done) * self.record_bytes, np.uint8)
            try:
                decompressor.decompress_many(block)
            except lazrs.LazrsError as error:
                raise self._damaged(str(error)) from error
            except BaseException as error:
                if type(error).__module__ != _PANIC:
                    raise
                raise self._damaged(str(error)) from error
            yield block

    def beyond_count(self) -> tuple[int, str]:
        """Return how much the points hold beyond those that the header counts, and of what."""
        try:
            chunks = self._checked_chunks()
            if not chunks:
                return 0, "points"
            if self._compressor == _LAYERED:
                return self._layered_points(chunks) - self.count, "points"
            left = self._left_in_last_chunk(chunks)
        except _DAMAGE as error:
            raise self._damaged(str(error)) from error
        return left if left > _END_OF_CODE else 0, "compressed bytes"

    @property
    def _compressor(self) -> int:
        return int(struct.unpack_from("<H", self.laszip)[0])

    @property
    def _items(self) -> list[tuple[int, int]]:
        """Types and sizes of the parts of a point."""
        places = range(_RECORD_BYTES, len(self.laszip), _ITEM_BYTES)
        return [struct.unpack_from("<HH", self.laszip, place) for place in places]

    def _left_in_last_chunk(self, chunks: Chunks) -> int:
        end = self.start + 8 + sum(nbytes for _, nbytes in chunks)
        first = sum(points for points, _ in chunks[:-1])
        if not 0 <= first < self.count:
            return 0
        with _Dripping(self.path) as stream:
            stream.seek(self.start)
            decompressor = lazrs.LasZipDecompressor(stream, self.laszip)
            decompressor.seek(first)
            for done in range(first, self.count, _BLOCK_POINTS):
                points = min(_BLOCK_POINTS, self.count - done)
                decompressor.decompress_many(np.empty(points * self.record_bytes, np.uint8))
            return end - stream.tell()

    def _layered_points(self, chunks: Chunks) -> int:
        total, start = 0, self.start + 8
        for _, nbytes in chunks:
            self.stream.seek(start + self.record_bytes)
            total += int.from_bytes(self.stream.read(4), "little")
            start += nbytes
        return total

    def _checked_chunks(self) -> Chunks:
        self._check_items()
        vlr = lazrs.LazVlr(self.laszip)
        self._check_chunk_count(vlr)
        self.stream.seek(self.start)
        # Writers of chunks of any size may end with one of nothing.
        chunks: Chunks = [some for some in lazrs.read_chunk_table(self.stream, vlr) if any(some)]
        self._check_chunks(chunks)
        return chunks

    def _check_items(self) -> None:
        items = int.from_bytes(self.laszip[32:_RECORD_BYTES], "little")
        if len(self.laszip) != _RECORD_BYTES + items * _ITEM_BYTES:
            raise self._damaged("its LASzip record is cut off")
        if self._compressor not in _CHUNKED:
            raise refusal(
                self.path,
                f"LAZ compressed in the way number {self._compressor}",
                expected="chunks (2 or 3), as LASzip writes since version 2",
                fix="write it again with a newer tool, or give LAS or PLY",
            )
        total = sum(size for _, size in self._items)
        if total != self.record_bytes:
            what = f"points of {self.record_bytes} bytes are compressed as {total} bytes"
            raise self._damaged(what)

    def _check_chunk_count(self, vlr: Any) -> None:
        size = self.path.stat().st_size
        self.stream.seek(self.start)
        table = int.from_bytes(self.stream.read(8), "little", signed=True)
        if table == -1:
            self.stream.seek(max(size - 8, self.start))
            table = int.from_bytes(self.stream.read(8), "little", signed=True)
        if not self.start + 8 <= table <= size - 8:
            raise self._damaged("the file ends before its chunk table")
        self.stream.seek(table)
        chunks = struct.unpack("<II", self.stream.read(8))[1]
        # A chunk holds its first point as it is, so that it takes a point's bytes at least.
        most = (table - self.start - 8) // vlr.item_size()
        of_one_size = not vlr.uses_variable_size_chunks()
        wanted = -(-self.count // max(vlr.chunk_size(), 1)) if of_one_size else chunks
        if chunks > most or chunks != wanted:
            listed, needed = counted(chunks, "chunk"), counted(self.count, "point")
            raise self._damaged(f"its table lists {listed} for {needed}")

    def _check_chunks(self, chunks: Chunks) -> None:
        room = self.path.stat().st_size - self.start - 8
        points, nbytes = (sum(column) for column in zip((0, 0), *chunks, strict=True))
        if nbytes > room or points < self.count:
            raise self._damaged("the chunks of its table do not fit the file")
        largest = max((points for points, _ in chunks), default=0) * self.record_bytes
        if largest > _MOST_CHUNK_BYTES:
            raise refusal(
                self.path,
                f"chunks of {largest:,} bytes cannot be read in pieces",
                expected=f"at most {_MOST_CHUNK_BYTES:,} bytes, usually 50,000 points",
                fix="write it again with the usual size of chunks",
            )
        if self._compressor == _LAYERED:
            self._check_layers(chunks)

    def _check_layers(self, chunks: Chunks) -> None:
        layers = sum(
            size if kind == _EXTRA_BYTES_ITEM else _LAYERS.get(kind, 0)
            for kind, size in self._items
        )
        start = self.start + 8
        for _, nbytes in chunks:
            self.stream.seek(start + self.record_bytes + 4)
            sizes = np.frombuffer(self.stream.read(4 * layers).ljust(4 * layers, b"\xff"), "<u4")
            if int(sizes.sum(dtype=np.int64)) + self.record_bytes + 4 + 4 * layers > nbytes:
                raise self._damaged("the layers of a chunk do not fit it")
            start += nbytes

    def _damaged(self, reason: str) -> PredictionError:
        what = f"the LAZ file is damaged or cut off: {reason[:200]}"
        return refusal(self.path, what, fix=FIX_COPY)


class _Dripping(io.FileIO):
    """A file that gives few bytes at a time, so that its place shows what a decoder took."""

    def readinto(self, buffer: Any, /) -> int:
        return super().readinto(memoryview(buffer)[:_DRIP]) or 0

    def read(self, size: int | None = -1, /) -> bytes:
        return super().read(_DRIP if size is None or size < 0 else min(size, _DRIP)) or b""
