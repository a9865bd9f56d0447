"""Clouds written in shards of LAZ."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np

from airzoo_bench.formats.clouds.cloud import FileCloud
from airzoo_bench.formats.clouds.shards import open_shards, shards_in
from airzoo_bench.geometry.arrays import Floats

Write = Callable[[Path, Floats], None]


def write_laz(path: Path, points: Floats, scale: float = 1e-3) -> None:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, scale), np.floor([*points, np.zeros(3)][0])
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
