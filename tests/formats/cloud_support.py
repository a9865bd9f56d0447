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


E57_SCALE = 2.0**-10


def write_e57(path: Path, columns: dict[str, NDArray[Any]], split: int = 17) -> Path:
    """Write x as double, y and z as scaled integers of 37 and 21 bits, and colours; two packets."""
    count = len(columns["x"])
    whole = {"y": (37, 5_188_000.0), "z": (21, 0.0)}
    streams = [columns["x"].astype("<f8").tobytes()]
    prototype = '<cartesianX type="Float"/>'
    for name, (bits, offset) in whole.items():
        raw = np.rint((columns[name] - offset) / E57_SCALE).astype(np.uint64)
        spread = (raw[:, None] >> np.arange(bits, dtype=np.uint64)) & np.uint64(1)
        streams.append(np.packbits(spread.astype(np.uint8).ravel(), bitorder="little").tobytes())
        prototype += (
            f'<cartesian{name.upper()} type="ScaledInteger" minimum="0" '
            f'maximum="{(1 << bits) - 1}" scale="{E57_SCALE}" offset="{offset}"/>'
        )
    for name in ("Red", "Green", "Blue"):
        streams.append(columns[name.lower()].tobytes())
        prototype += f'<color{name} type="Integer" minimum="0" maximum="255"/>'
    packets = b""
    for part in (slice(None, split), slice(split, None)):
        given = [stream[part] for stream in streams]
        sizes = struct.pack(f"<{len(given)}H", *map(len, given))
        body = sizes + b"".join(given)
        body += b"\0" * (-(6 + len(body)) % 4)
        packets += struct.pack("<BBHH", 1, 0, 5 + len(body), len(given)) + body
    section = struct.pack("<B7xQQQ", 1, 32 + len(packets), 48 + 32, 0) + packets
    text = (
        '<?xml version="1.0"?><e57Root xmlns="http://www.astm.org/COMMIT/E57/2010-e57-v1.0">'
        '<data3D type="Vector"><vectorChild type="Structure"><pose type="Structure"><translation>'
        '<x type="Float">100</x></translation></pose>'
        f'<points type="CompressedVector" fileOffset="48" recordCount="{count}">'
        f"<prototype>{prototype}</prototype></points></vectorChild></data3D></e57Root>"
    ).encode()
    place = 48 + len(section)
    place += place // 1020 * 4  # the XML's place is one of the file, with the checksums
    body = section + text
    pages = -(-(48 + len(body)) // 1020)
    head = b"ASTM-E57" + struct.pack("<IIQQQQ", 1, 0, pages * 1024, place, len(text), 1024)
    path.write_bytes(e57_pages((head + body).ljust(pages * 1020, b"\0")))
    return path


def e57_pages(content: bytes) -> bytes:
    """Cut content into pages, each with its checksum."""
    starts = range(0, len(content), 1020)
    pages = [content[start : start + 1020].ljust(1020, b"\0") for start in starts]
    return b"".join(page + _crc32c(page).to_bytes(4, "big") for page in pages)


def e57_content(file: bytes) -> bytes:
    """Return what the pages of a file hold."""
    return b"".join(file[start : start + 1020] for start in range(0, len(file), 1024))


def _crc32c(content: bytes) -> int:
    """Bit by bit, as RFC 3720 has it."""
    register = 0xFFFFFFFF
    for byte in content:
        register ^= byte
        for _ in range(8):
            register = (register >> 1) ^ (0x82F63B78 if register & 1 else 0)
    return register ^ 0xFFFFFFFF


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
