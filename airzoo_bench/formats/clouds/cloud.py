"""Point clouds: types that readers yield and steps take, clouds in arrays, and files by kind."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import FIX_COPY, PredictionError, counted
from airzoo_bench.core.registry import resolve
from airzoo_bench.formats.arrays import Arrays, check_fields, open_arrays, wrong_type
from airzoo_bench.formats.clouds import KINDS, TEXT_SUFFIXES
from airzoo_bench.formats.npz import map_numbers
from airzoo_bench.geometry.arrays import Floats

_CONFIDENCE = ("confidence", "conf")
_ALLOWED = ("protocol", "points", "colours", "colors", *_CONFIDENCE)
_EXPECTED = "points (N, 3), and perhaps colours (N, 3) and confidence (N,)"
_NUMBERS = "fiu"
_STORED_POINTS = 1 << 20
_HEAD_BYTES = 4096
_BINARY = re.compile(rb"[\x00-\x08\x0e-\x1f]")
_COMMENTS = rb"(#[^\n]*\n|\s)*"
# What the first bytes of a file look like, what it is, its endings and its reader; the first that
# fits is taken.
_LOOKS: tuple[tuple[bytes, str, tuple[str, ...], str], ...] = (
    (rb"ply[\r\n]", "PLY", (".ply",), "ply:open_ply"),
    (rb"LASF", "LAS or LAZ", (".las", ".laz"), "las:open_las"),
    (rb"\x93NUMPY", "npy", (".npy",), "cloud:open_npy"),
    (rb"PK[\x03\x05][\x04\x06]", "npz or zip", (".npz",), "cloud:open_npz"),
    (rb"glTF", "GLB", (".glb",), "mesh_files:open_gltf"),
    (_COMMENTS + rb"(VERSION|FIELDS)\s", "PCD", (".pcd",), "rows:open_pcd"),
    (rb"version https://git-lfs", "a Git LFS pointer, not the file itself", (), ""),
    (rb"\x1f\x8b", "a gzip file, which is to be unpacked", (), ""),
    (rb"\s*<", "HTML or XML", (), ""),
    (rb"\s*\{", "glTF or JSON", (".gltf",), "mesh_files:open_gltf"),
    (rb"(\s*solid\s.*facet|C?N?OFF\s|\x89HDF|ASTM-E57)", "STL, OFF, HDF5 or E57", (), ""),
    (_COMMENTS + rb"(v[nt]?|f|[og]|s|mtllib|usemtl)\s", "OBJ", (".obj",), "mesh_files:open_obj"),
    (rb".*\d", "text", TEXT_SUFFIXES, "rows:open_text"),
)


@dataclass(frozen=True, eq=False)
class Cloud:
    """N points in memory, in the scene's units."""

    points: Floats  # (N, 3) float64
    confidence: NDArray[np.float32] | None = None  # (N,)

    def __len__(self) -> int:
        return len(self.points)


class CloudSource(Protocol):
    """A cloud that is read in pieces, as often as asked, always in the same order."""

    @property
    def count(self) -> int:
        """How many points it holds, those with NaN included."""

    def pieces(self, points: int) -> Iterator[Cloud]:
        """Yield all points, at most that many at a time."""


@dataclass(frozen=True, eq=False)
class FileCloud:
    """A cloud in a file, or sampled on a mesh in a file: a `CloudSource`."""

    path: Path
    kind: str  # for results, such as "PLY (binary)"
    count: int  # points with NaN included
    read: Callable[[int], Iterator[Cloud]]  # yields all points, at most that many at a time
    precision: np.dtype[Any]  # that the coordinates are stored in
    notes: tuple[str, ...] = ()  # on how it was read

    def pieces(self, points: int) -> Iterator[Cloud]:
        """Yield all points, at most that many at a time."""
        return self.read(points)

    def stored(self, folder: Path) -> FileCloud:
        """Return the cloud with its points in plain files of a folder."""
        make = partial(np.lib.format.open_memmap, mode="w+")
        points = make(folder / "points.npy", dtype=np.float64, shape=(self.count, 3))
        confidence, done = None, 0
        for piece in self.pieces(_STORED_POINTS):
            part = slice(done, done + len(piece))
            points[part] = piece.points
            if piece.confidence is not None:
                if confidence is None:
                    path = folder / "confidence.npy"
                    confidence = make(path, dtype=np.float32, shape=(self.count,))
                confidence[part] = piece.confidence
            done += len(piece)
        return replace(self, read=ArrayPieces(points, confidence))


@dataclass(frozen=True)
class MeshSampling:
    """How a protocol samples meshes, by one of `count` and `per_square_unit`."""

    seed: int  # from 0 up to 2^64 - 1
    count: int | None  # points on the whole mesh
    per_square_unit: float | None  # points per square unit of the scene (square metre)
    max_points: int  # a mesh in millimetres would ask for a million times as many


@dataclass(frozen=True, eq=False)
class ArrayPieces:
    """Reads a cloud from arrays, which may be mapped: points (N, 3) and confidence (N,)."""

    points: NDArray[Any]
    confidence: NDArray[Any] | None = None

    def __call__(self, size: int) -> Iterator[Cloud]:
        """Yield all points, at most `size` at a time."""
        for start in range(0, len(self.points), size):
            part = slice(start, start + size)
            trust = None if self.confidence is None else _as_confidence(self.confidence[part])
            yield Cloud(np.array(self.points[part], np.float64), trust)


def cloud_of_columns(columns: Mapping[str, NDArray[Any]]) -> Cloud:
    """Make a cloud of columns (N,) by name: x, y, z, and perhaps confidence."""
    points = np.empty((len(columns["x"]), 3))
    for axis, name in enumerate("xyz"):
        points[:, axis] = columns[name]
    found = next((columns[name] for name in _CONFIDENCE if name in columns), None)
    return Cloud(points, None if found is None else _as_confidence(found))


def _as_confidence(column: NDArray[Any]) -> NDArray[np.float32]:
    """Turn a column (N,) into float32; numbers too large for it become infinite."""
    with np.errstate(over="ignore", invalid="ignore"):
        return column.astype(np.float32)


def refusal(
    path: Path, what: str, *, expected: str | None = None, fix: str | None = None
) -> PredictionError:
    """Make the error of a file."""
    return PredictionError(what, where=path, expected=expected, fix=fix)


def open_npz(path: Path, limit_bytes: int) -> FileCloud:
    """Open an npz file with ``points`` (N, 3), perhaps ``confidence`` (N,)."""
    arrays = open_arrays(path, limit_bytes)
    check_fields(arrays, ("points",), _ALLOWED, _EXPECTED)
    columns = {"points": _column(arrays, "points", (3,))}
    columns |= {name: _column(arrays, name, ()) for name in _CONFIDENCE if name in arrays.names()}
    lengths = {len(column) for column in columns.values()}
    if len(columns) > 2 or len(lengths) > 1:
        stated = ", ".join(f"{len(column):,} of {name}" for name, column in columns.items())
        raise refusal(path, f"holds {stated}", expected="one confidence a point, named once")
    points = columns.pop("points")
    read = ArrayPieces(points, *columns.values())
    return FileCloud(path, "npz", len(points), read, points.dtype)


def _column(arrays: Arrays, name: str, row: tuple[int, ...]) -> NDArray[Any]:
    values = arrays.map(name)
    is_plain = values.dtype.kind in _NUMBERS and values.dtype.itemsize <= 8
    if not is_plain or values.ndim != 1 + len(row) or values.shape[1:] != row:
        fix = f"np.asarray({name}, dtype=np.float64) of that shape"
        raise wrong_type(arrays.path, name, values, expected=_EXPECTED, fix=fix)
    return values


def open_npy(path: Path) -> FileCloud:
    """Open an npy file of points (N, 3), or of points with up to three columns more (N, 4 to 6)."""
    rows = map_numbers(path)
    if rows.ndim != 2 or not 3 <= rows.shape[1] <= 6 or rows.dtype.kind not in _NUMBERS:
        raise refusal(
            path,
            f"an array of {rows.dtype} and shape {rows.shape}",
            expected="points (N, 3), or with colours (N, 6), numbers of at most 64 bits",
            fix="np.save(file, np.asarray(points, dtype=np.float64))",
        )
    passed = rows.shape[1] - 3
    notes = (f"x y z from columns 1, 2, 3; {counted(passed, 'column')} passed over",)
    read = ArrayPieces(rows[:, :3])
    return FileCloud(path, "npy", len(rows), read, rows.dtype, notes if passed else ())


def open_cloud(path: Path, *, limit_bytes: int, sampling: MeshSampling | None) -> FileCloud:
    """Open a cloud, or a mesh as points on its surface; the ending and first bytes say which."""
    reader = _reader_of(path)
    limits = (limit_bytes,) if path.suffix.lower() == ".npz" else ()
    opened: Any = resolve(f"{__package__}.{reader}")(path, *limits)
    if isinstance(opened, FileCloud):
        return opened
    sampled: FileCloud = resolve(f"{__package__}.meshes:cloud_of_mesh")(opened, sampling)
    return sampled


def _reader_of(path: Path) -> str:
    """Return the function that reads a file, after a check of its first bytes."""
    if not path.is_file():
        what = "a folder, not a file" if path.is_dir() else "no such file"
        raise refusal(path, what, expected=f"one of {KINDS}")
    with path.open("rb") as stream:
        head = stream.read(_HEAD_BYTES)
    if not head:
        raise refusal(path, "is empty", fix=FIX_COPY)
    looks = [one[1:] for one in _LOOKS if re.match(one[0], head, re.DOTALL)]
    if _BINARY.search(head):
        looks = [one for one in looks[:1] if one[0] not in ("text", "OBJ")]
    found, suffixes, reader = looks[0] if looks else ("", (), "")
    if path.suffix.lower() not in suffixes:
        unknown = f"no cloud: it begins with the bytes {head[:8].hex(' ')}"
        raise refusal(
            path,
            f"is named {path.suffix[:20]!r}, and its content is that of {found or unknown}",
            expected=f"the content of one of {KINDS}, named as what it is",
            fix="give it the ending of what it is, or write the points as PLY, LAZ or npz",
        )
    return reader
