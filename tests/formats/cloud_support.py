"""Files of clouds, written by hand so that they may be wrong, and read back."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.formats.clouds.cloud import Cloud, FileCloud
from airzoo_bench.formats.clouds.formats import open_cloud
from airzoo_bench.formats.clouds.meshes import MeshSampling

LIMIT = 1 << 26
SAMPLING = MeshSampling(seed=7, count=500, per_square_unit=None, max_points=100_000)
_PLY_NAMES = {"f4": "float", "f8": "double", "u1": "uchar", "i4": "int", "u2": "ushort"}
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


def read(path: Path, points: int = 7, **settings: Any) -> Cloud:
    """Read a whole file in pieces, and hold each to its size."""
    source = opened(path, **settings)
    pieces = list(source.pieces(points))
    assert all(len(piece) == points for piece in pieces[:-1])
    assert sum(len(piece) for piece in pieces) == source.count
    return joined(pieces)


def joined(pieces: Sequence[Cloud]) -> Cloud:
    def column(name: str) -> Any:
        parts = [getattr(piece, name) for piece in pieces]
        return None if not parts or parts[0] is None else np.concatenate(parts)

    points = column("points") if pieces else np.empty((0, 3))
    return Cloud(points, column("colours"), column("confidence"))


def made(count: int = 40, seed: int = 0) -> dict[str, NDArray[Any]]:
    """Columns of a cloud: doubles a few million metres away, colours, confidence, an extra."""
    random = np.random.default_rng(seed)
    xyz = random.random((count, 3)) * 100 + (576_661.0, 5_188_114.0, 156.0)
    columns: dict[str, NDArray[Any]] = dict(zip("xyz", xyz.T, strict=True))
    for name in ("red", "green", "blue"):
        columns[name] = random.integers(0, 256, count).astype("u1")
    columns["class"] = random.integers(-5, 5, count).astype("i4")
    columns["confidence"] = random.random(count).astype("f4")
    return columns


def points_of(columns: dict[str, NDArray[Any]]) -> NDArray[np.float64]:
    return np.stack([columns[axis] for axis in "xyz"], axis=-1).astype(np.float64)


def colours_of(columns: dict[str, NDArray[Any]]) -> NDArray[Any]:
    return np.stack([columns[name] for name in ("red", "green", "blue")], axis=-1)


def write_ply(
    path: Path,
    columns: dict[str, NDArray[Any]],
    order: str = "<",
    *,
    promised: int | None = None,
    before: bytes = b"",
    before_header: str = "",
    faces_header: str = "",
    faces: bytes = b"",
) -> Path:
    count = len(next(iter(columns.values())))
    header = [f"ply\nformat {_ORDERS[order]} 1.0\ncomment made"]
    header += [before_header] if before_header else []
    header += [f"element vertex {count if promised is None else promised}"]
    header += [f"property {_PLY_NAMES[c.dtype.str[1:]]} {name}" for name, c in columns.items()]
    header += [faces_header] if faces_header else []
    body = _ply_text(columns) if not order else _ply_binary(columns, order)
    head = "\n".join([*header, "end_header\n"]).encode()
    path.write_bytes(head + before + body + faces)
    return path


def _ply_binary(columns: dict[str, NDArray[Any]], order: str) -> bytes:
    record = np.dtype([(name, order + column.dtype.str[1:]) for name, column in columns.items()])
    rows = np.empty(len(next(iter(columns.values()))), record)
    for name, column in columns.items():
        rows[name] = column
    return rows.tobytes()


def _ply_text(columns: dict[str, NDArray[Any]]) -> bytes:
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    return "".join(" ".join(map(repr, row)) + "\n" for row in rows).encode()


def write_pcd(path: Path, columns: dict[str, NDArray[Any]], data: str, **changes: str) -> Path:
    """Write x, y, z and packed rgb."""
    count = len(columns["x"])
    colours = colours_of(columns).astype("<u4")
    packed = colours[:, 0] << 16 | colours[:, 1] << 8 | colours[:, 2]
    fields = {name: columns[name].astype("<f8") for name in "xyz"} | {"rgb": packed}
    header = {
        "VERSION": "0.7",
        "FIELDS": "x y z rgb",
        "SIZE": "8 8 8 4",
        "TYPE": "F F F U",
        "COUNT": "1 1 1 1",
        "WIDTH": str(count),
        "HEIGHT": "1",
        "VIEWPOINT": "0 0 0 1 0 0 0",
        "POINTS": str(count),
        "DATA": data,
    } | changes
    head = "# .PCD v0.7\n" + "".join(f"{key} {value}\n" for key, value in header.items())
    path.write_bytes(head.encode() + _pcd_body(fields, data))
    return path


def _pcd_body(fields: dict[str, NDArray[Any]], data: str) -> bytes:
    if data == "ascii":
        return _ply_text(fields)
    if data == "binary":
        return _ply_binary(fields, "<")
    plain = b"".join(column.tobytes() for column in fields.values())
    packed = lzf_literals(plain)
    return struct.pack("<II", len(packed), len(plain)) + packed


def lzf_literals(data: bytes) -> bytes:
    """Compress by LZF without finding anything to compress."""
    parts = [data[start : start + 32] for start in range(0, len(data), 32)]
    return b"".join(bytes([len(part) - 1]) + part for part in parts)


def write_las(path: Path, columns: dict[str, NDArray[Any]], point_format: int = 3) -> Path:
    """Write LAS or LAZ, by the ending, with laspy: scale 0.001, 16-bit colours."""
    import laspy

    header = laspy.LasHeader(point_format=point_format)
    header.scales = np.full(3, 0.001)
    header.offsets = np.floor(points_of(columns).min(axis=0))
    las = laspy.LasData(header)
    las.x, las.y, las.z = (columns[axis] for axis in "xyz")
    if point_format in (2, 3, 5, 7, 8, 10):
        for name in ("red", "green", "blue"):
            setattr(las, name, columns[name].astype(np.uint16) * 257)
    las.write(path)
    return path


def text_rows(columns: dict[str, NDArray[Any]], separator: str = " ") -> str:
    """Return x, y, z, red, green, blue, a point a line."""
    names = ("x", "y", "z", "red", "green", "blue")
    rows = zip(*(columns[name].tolist() for name in names), strict=True)
    return "".join(separator.join(map(repr, row)) + "\n" for row in rows)
