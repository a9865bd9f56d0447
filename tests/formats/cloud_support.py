"""Files of clouds, written by hand so that they may be wrong, and read back."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.formats.clouds.cloud import Cloud, FileCloud, MeshSampling, open_cloud

LIMIT = 1 << 26
SAMPLING = MeshSampling(seed=7, count=500, per_square_unit=None, max_points=100_000)
COLOURS = ("red", "green", "blue")
Columns = dict[str, NDArray[Any]]
_PLY_NAMES = {"f4": "float", "f8": "double", "u1": "uchar", "i4": "int", "u2": "ushort"}
_PCD = ("ascii", "binary", "binary_compressed")
_PLY = {"little": "<", "big": ">", "text": ""}
_ORDERS = {"<": "binary_little_endian", ">": "binary_big_endian", "": "ascii"}


@contextmanager
def refused(message: str) -> Iterator[pytest.ExceptionInfo[PredictionError]]:
    """Expect a fault that says so itself: its place may have the words in its path."""
    with pytest.raises(PredictionError) as caught:
        yield caught
    said = f"{caught.value.what}; {caught.value.expected}"
    assert re.search(message, said), said


def opened(path: Path, limit_bytes: int = LIMIT, sampling: Any = SAMPLING) -> FileCloud:
    return open_cloud(path, limit_bytes=limit_bytes, sampling=sampling)


def read(path: Path, points: int = 7) -> Cloud:
    """Read a whole file in pieces, and hold each to its size."""
    return joined(opened(path), points)


def joined(source: FileCloud, points: int) -> Cloud:
    pieces = list(source.pieces(points))
    assert all(len(piece) == points for piece in pieces[:-1])
    assert sum(len(piece) for piece in pieces) == source.count
    xyz = np.concatenate([np.empty((0, 3)), *(piece.points for piece in pieces)])
    trust = [piece.confidence for piece in pieces if piece.confidence is not None]
    return Cloud(xyz, np.concatenate(trust) if trust else None)


def made(count: int = 40, seed: int = 0) -> Columns:
    """Columns of a cloud: doubles a few million metres away, colours, confidence, an extra."""
    random = np.random.default_rng(seed)
    xyz = random.random((count, 3)) * 100 + (576_661.0, 5_188_114.0, 156.0)
    columns: Columns = dict(zip("xyz", xyz.T, strict=True))
    columns |= {name: random.integers(0, 256, count).astype("u1") for name in COLOURS}
    columns["class"] = random.integers(-5, 5, count).astype("i4")
    columns["confidence"] = random.random(count).astype("f4")
    return columns


def points_of(columns: Columns) -> NDArray[np.float64]:
    return np.stack([columns[axis] for axis in "xyz"], axis=-1).astype(np.float64)


def write_ply(
    path: Path,
    columns: Columns,
    order: str = "<",
    *,
    before: bytes = b"",
    before_header: str = "",
    faces_header: str = "",
    faces: bytes = b"",
) -> Path:
    count = len(next(iter(columns.values())))
    header = [f"ply\nformat {_ORDERS[order]} 1.0\ncomment made", before_header]
    header += [f"element vertex {count}"]
    header += [f"property {_PLY_NAMES[c.dtype.str[1:]]} {name}" for name, c in columns.items()]
    head = "\n".join(filter(None, [*header, faces_header, "end_header\n"])).encode()
    body = _records(columns, order) if order else text_rows(columns).encode()
    path.write_bytes(head + before + body + faces)
    return path


def _records(columns: Columns, order: str) -> bytes:
    record = np.dtype([(name, order + column.dtype.str[1:]) for name, column in columns.items()])
    rows = np.empty(len(next(iter(columns.values()))), record)
    for name, column in columns.items():
        rows[name] = column
    return rows.tobytes()


def text_rows(columns: Columns, separator: str = " ") -> str:
    """Return the columns as text, a point a line."""
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    return "".join(separator.join(map(repr, row)) + "\n" for row in rows)


def write_pcd(path: Path, columns: Columns, data: str, **changes: str) -> Path:
    """Write x, y, z and packed rgb."""
    red, green, blue = (columns[name].astype("<u4") for name in COLOURS)
    fields = {name: columns[name].astype("<f8") for name in "xyz"}
    fields["rgb"] = red << 16 | green << 8 | blue
    header = {"VERSION": "0.7", "FIELDS": "x y z rgb", "SIZE": "8 8 8 4", "TYPE": "F F F U"}
    header |= {"COUNT": "1 1 1 1", "WIDTH": str(len(red)), "HEIGHT": "1"}
    header |= {"VIEWPOINT": "0 0 0 1 0 0 0", "POINTS": str(len(red)), "DATA": data} | changes
    head = "# .PCD v0.7\n" + "".join(f"{key} {value}\n" for key, value in header.items())
    body = text_rows(fields).encode() if data == "ascii" else _records(fields, "<")
    if data == "binary_compressed":  # by LZF that found nothing to compress
        plain = b"".join(column.tobytes() for column in fields.values())
        parts = [plain[start : start + 32] for start in range(0, len(plain), 32)]
        packed = b"".join(bytes([len(part) - 1]) + part for part in parts)
        body = struct.pack("<II", len(packed), len(plain)) + packed
    path.write_bytes(head.encode() + body)
    return path


def write_las(path: Path, columns: Columns, point_format: int = 3) -> Path:
    """Write LAS or LAZ, by the ending, with laspy: scale 0.001."""
    header = laspy.LasHeader(point_format=point_format)
    header.scales = np.full(3, 0.001)
    if len(columns["x"]):
        header.offsets = np.floor(points_of(columns).min(axis=0))
    las = laspy.LasData(header)
    las.x, las.y, las.z = (columns[axis] for axis in "xyz")
    las.write(path)
    return path


def write_text(path: Path, columns: Columns) -> None:
    path.write_text(f"{len(columns['x'])}\n{text_rows({axis: columns[axis] for axis in 'xyz'})}")


WRITERS: dict[str, Callable[[Path, Columns], object]] = {
    **{f"{data}.pcd": partial(write_pcd, data=data) for data in _PCD},
    **{f"{name}.ply": partial(write_ply, order=order) for name, order in _PLY.items()},
    **{
        f"format{kind}.{suffix}": partial(write_las, point_format=kind)
        for kind in (0, 3, 7)
        for suffix in ("las", "laz")
    },
    "a.npz": lambda path, columns: np.savez(
        path, points=points_of(columns), confidence=columns["confidence"]
    ),
    "a.npy": lambda path, columns: np.save(path, points_of(columns)),
    "a.pts": write_text,
}
"""Writers of each format of clouds, by a file's name."""
