"""Clouds written in shards, of every kind of file."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import laspy
import lazrs
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pyproj import CRS

from airzoo_bench.formats.clouds.cloud import FileCloud
from airzoo_bench.formats.clouds.shards import open_shards, shards_in
from airzoo_bench.geometry.arrays import Floats
from tests.formats.cloud_support import LIMIT

Write = Callable[[Path, Floats], None]


def write_parquet(path: Path, points: Floats, **more: Any) -> None:
    columns: dict[str, Any] = dict(zip("xyz", points.T, strict=True)) | more
    pq.write_table(pa.table(columns), path, row_group_size=97)


def write_copc(path: Path, points: Floats) -> None:
    """Write what a COPC file is to a reader of LAZ: chunks of any size, an index behind them."""
    plain = io.BytesIO()
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 1e-3), np.zeros(3)
    cloud = laspy.LasData(header)
    cloud.xyz = points
    cloud.write(plain)
    raw = plain.getvalue()
    start = int.from_bytes(raw[96:100], "little")
    laszip = lazrs.LazVlr.new_for_compression(6, 0, True)
    info = b"\0\0copc".ljust(18, b"\0") + (1).to_bytes(2, "little") + (160).to_bytes(2, "little")
    record = laszip.record_data()
    told = b"\0\0laszip encoded".ljust(18, b"\0") + (22204).to_bytes(2, "little")
    records = info.ljust(54, b"\0") + b"\xff" * 160
    records += (told + len(record).to_bytes(2, "little")).ljust(54, b"\0") + record
    head = bytearray(raw[:start])
    head[96:100] = (start + len(records)).to_bytes(4, "little")
    head[100:104] = (2).to_bytes(4, "little")
    head[104] |= 0x80
    body = io.BytesIO(bytes(head) + records)
    body.seek(0, io.SEEK_END)
    compressor = lazrs.LasZipCompressor(body, laszip)
    rows = np.frombuffer(raw[start : start + 30 * len(points)], np.uint8).reshape(-1, 30)
    for node in np.split(rows, np.cumsum([1, 7, 50])):
        compressor.compress_many(np.ascontiguousarray(node).ravel())
        compressor.finish_current_chunk()
    compressor.done()
    hierarchy = body.seek(0, io.SEEK_END)
    body.write(b"\xff" * 4096)  # an index that leads anywhere
    whole = bytearray(body.getvalue())
    whole[235:243] = hierarchy.to_bytes(8, "little")
    whole[243:247] = (1).to_bytes(4, "little")
    path.write_bytes(whole)


def write_laz(path: Path, points: Floats, *, crs: str | None = None, scale: float = 1e-3) -> None:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, scale), np.zeros(3)
    if crs is not None:
        header.add_crs(CRS(crs))
    cloud = laspy.LasData(header)
    cloud.xyz = points
    cloud.write(path)


def in_shards(folder: Path, points: Floats, count: int, write: Write, suffix: str) -> Path:
    folder.mkdir(parents=True)
    for number, part in enumerate(np.array_split(points, count)):
        write(folder / f"tile-{number:02}{suffix}", part)
    return folder


def opened(folder: Path) -> FileCloud:
    return open_shards(folder, shards_in(folder), LIMIT)


def points_in(cloud: FileCloud, size: int = 50) -> Floats:
    return np.concatenate([piece.points for piece in cloud.pieces(size)])
