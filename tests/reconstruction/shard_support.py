"""Clouds written in shards, of every kind of file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pyproj import CRS

from airzoo_bench.formats.clouds.cloud import FileCloud
from airzoo_bench.formats.clouds.shards import open_shards, shards_in
from airzoo_bench.geometry.arrays import Floats

Write = Callable[[Path, Floats], None]


def write_parquet(path: Path, points: Floats, **more: Any) -> None:
    columns: dict[str, Any] = dict(zip("xyz", points.T, strict=True)) | more
    pq.write_table(pa.table(columns), path, row_group_size=97)


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
    return open_shards(folder, shards_in(folder))


def points_in(cloud: FileCloud, size: int = 50) -> Floats:
    return np.concatenate([piece.points for piece in cloud.pieces(size)])
