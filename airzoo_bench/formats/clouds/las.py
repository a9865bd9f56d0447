"""LAS and LAZ by laspy, and folders of such files as one cloud.

What headers count is held against the file first: laspy takes a number of records as it is stated,
and lazrs decodes points that are not there.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import IO, Any

import laspy
import lazrs
import numpy as np

from airzoo_bench.core.errors import counted, readable
from airzoo_bench.formats.clouds.cloud import Cloud, FileCloud, cloud_of_columns, refusal
from airzoo_bench.formats.clouds.rows import check_left, too_few_points

SHARD_SUFFIXES = (".las", ".laz")
"""Endings of files that can be shards."""
_SHORTEST, _VLR_BYTES = 227, 54
_LAYERED = 3  # the compressor of point formats 6 and above, which counts the points of each chunk


def open_las(path: Path) -> FileCloud:
    """Open a LAS or LAZ file."""
    with _damage(path):
        _check_room(path)
        with laspy.open(path, read_evlrs=False) as reader:
            header = reader.header
        numbers = np.concatenate([header.scales, header.offsets])
        if not (np.isfinite(numbers).all() and (header.scales != 0).all()):
            raise ValueError(f"its scale and offset are {numbers.tolist()}")
        compressed, count = header.are_points_compressed, header.point_count
        left = (_points_beyond if compressed else _bytes_beyond)(path, header)
    notes = check_left(path, count, left, "points" if compressed else "bytes")
    kind = "LAZ" if compressed else "LAS"
    return FileCloud(path, kind, count, partial(_read, path, count), np.dtype(np.float64), notes)


def _read(path: Path, count: int, points: int) -> Iterator[Cloud]:
    with _damage(path):
        reader = laspy.open(path, read_evlrs=False)
    with reader:
        chunks, done = reader.chunk_iterator(points), 0
        while done < count:
            with _damage(path):
                chunk = next(chunks, None)
                if chunk is None:
                    raise too_few_points(path, count)
                cloud = cloud_of_columns({axis: np.asarray(chunk[axis]) for axis in "xyz"})
            done += len(cloud)
            yield cloud


def open_shards(folder: Path, paths: Sequence[Path]) -> FileCloud:
    """Open the shards of a cloud as one cloud, in the order that they are given in."""
    names = [path.stem for path in paths]
    twice = next((path for path in paths if names.count(path.stem) > 1), None)
    if twice is not None:
        raise refusal(
            twice,
            "is there as LAS and as LAZ, and its points would count twice",
            expected="each part of the cloud in one shard",
            fix="take one of the two away, or rename it if their points are others",
        )
    files = tuple(map(open_las, paths))
    kinds = " and ".join(sorted({file.kind for file in files}))
    return FileCloud(
        folder,
        f"{kinds} in {counted(len(files), 'shard')}",
        sum(file.count for file in files),
        partial(_shard_pieces, files),
        np.dtype(np.float64),
        tuple(f"{file.path.name}: {note}" for file in files for note in file.notes),
    )


def shards_in(folder: Path) -> list[Path]:
    """Return the files of a folder that can be shards, by name."""
    found = (path for path in folder.iterdir() if path.name.lower().endswith(SHARD_SUFFIXES))
    paths = sorted(path for path in found if not path.name.startswith("."))
    if not paths:
        raise refusal(folder, "holds no shard", expected=f"files {', '.join(SHARD_SUFFIXES)}")
    return paths


def _shard_pieces(files: tuple[FileCloud, ...], points: int) -> Iterator[Cloud]:
    """Yield the points in the same pieces as from one file."""
    left = np.zeros((0, 3))
    for file in files:
        for piece in file.pieces(points):
            left = np.concatenate((left, piece.points)) if len(left) else piece.points
            while len(left) >= points:
                yield Cloud(left[:points])
                left = left[points:]
    if len(left):
        yield Cloud(left)


def _damage(path: Path) -> AbstractContextManager[None]:
    return readable(path, "the LAS or LAZ file is damaged or cut off")


def _check_room(path: Path) -> None:
    """Refuse a header that counts more records than there is room for."""
    with path.open("rb") as stream:
        header_bytes, start, records = struct.unpack_from("<HII", stream.read(_SHORTEST), 94)
    room = (start - header_bytes) // _VLR_BYTES
    if not _SHORTEST <= header_bytes <= start <= path.stat().st_size or records > room:
        raise ValueError(f"its header contradicts itself: points from byte {start:,}")


def _bytes_beyond(path: Path, header: laspy.LasHeader) -> int:
    """Return how many bytes follow the points that the header counts, before other records."""
    size, start = path.stat().st_size, header.offset_to_point_data
    end = start + header.point_count * header.point_format.size
    marks = header.start_of_first_evlr, header.start_of_waveform_data_packet_record
    last = min((mark for mark in marks if mark and start < mark < size), default=size)
    return size - end if size < end or last - end >= header.point_format.size else 0


def _points_beyond(path: Path, header: laspy.LasHeader) -> int:
    """Return how many points the chunks hold beyond those that the header counts.

    Old compressors do not count the points of the last chunk: any number that fits is then right.
    """
    start, size = header.offset_to_point_data, header.point_format.size
    count = int(header.point_count)
    laszip = header.vlrs.get("LasZipVlr")[0].record_data
    vlr = lazrs.LazVlr(laszip)
    if vlr.item_size() != size:
        raise ValueError(f"points of {size} bytes are compressed as {vlr.item_size()} bytes")
    with path.open("rb") as stream:
        chunks = _chunks(stream, start, path.stat().st_size, vlr)
        place, total = start + 8, 0
        if place + sum(nbytes for _, nbytes in chunks) > path.stat().st_size:
            return -1
        if struct.unpack_from("<H", laszip)[0] == _LAYERED:
            for _, nbytes in chunks:
                stream.seek(place + size)
                total += int.from_bytes(stream.read(4), "little")
                place += nbytes
            return total - count
    most = sum(points for points, _ in chunks)
    return max(most - chunks[-1][0] - count + 1, 0) if count <= most and chunks else most - count


def _chunks(stream: IO[bytes], start: int, size: int, vlr: Any) -> list[tuple[int, int]]:
    """Return points and bytes of each chunk; lazrs ends the process over a table of too many."""
    for place in (start, size - 8):  # where a writer could not go back, its place is at the end
        stream.seek(place)
        table = int.from_bytes(stream.read(8), "little", signed=True)
        if table != -1:
            break
    if not start + 8 <= table <= size - 8:
        raise ValueError("the file ends before its chunk table")
    stream.seek(table + 4)
    chunks = int.from_bytes(stream.read(4), "little")
    if chunks > (table - start - 8) // vlr.item_size():
        raise ValueError(f"its table lists {chunks:,} chunks")
    stream.seek(start)
    # Writers of chunks of any size may end with one of nothing.
    return [some for some in lazrs.read_chunk_table(stream, vlr) if any(some)]
