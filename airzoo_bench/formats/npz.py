"""``.npy`` and ``.npz`` files: no pickle, no memory beyond what was agreed, no copies of maps.

A member's header is held against the size that the archive states before its data are touched.
Members that ``numpy.savez`` stored are mapped, so that descriptors may be larger than memory.
"""

from __future__ import annotations

import math
import struct
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, UnreadableError
from airzoo_bench.formats.budget import Budget

__all__ = ["ArrayEntry", "NpyHeader", "NpzFile", "map_numbers", "read_header"]

_NUMBERS, _KINDS = "biuf", "biufUS"
_LOCAL_HEADER_BYTES = 30
_PIECE_BYTES = 1 << 22
_MAX_CODE_POINT, _SURROGATES = 0x10FFFF, (0xD800, 0xDFFF)
_FIX_COPY = "write or copy the file again"
_FIX_LARGE = "save arrays of numbers by numpy.savez, uncompressed, to have them read in pieces"
# What `ast.literal_eval` and `numpy.dtype` raise over a text, and NumPy over what they return.
_HEADER_FAULTS = (
    *(EOFError, MemoryError, OverflowError, RecursionError, SyntaxError, TypeError, ValueError),
    *(struct.error, tokenize.TokenError),
)
# What zipfile and its decompressors raise over damaged bytes, and `read_header`.
_DAMAGE = (
    *(EOFError, NotImplementedError, OSError, RuntimeError, ValueError),
    *(zipfile.BadZipFile, zlib.error),
)


class NpyHeader(NamedTuple):
    """What a header states; nothing of it is checked against the data."""

    shape: tuple[int, ...]
    fortran_order: bool
    dtype: np.dtype[Any]


@dataclass(frozen=True)
class ArrayEntry:
    """What the header of one member says."""

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    fortran_order: bool
    compressed: bool
    member: zipfile.ZipInfo
    header_bytes: int

    @property
    def nbytes(self) -> int:
        """Size of the data in bytes, in exact integers."""
        return math.prod(self.shape) * self.dtype.itemsize


def read_header(stream: IO[bytes]) -> NpyHeader:
    """Read the header of an npy stream, which then stands at the data."""
    readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    version = npy.read_magic(stream)
    if version not in readers:
        raise ValueError(f"version {version} of the npy format is not for plain arrays")
    try:
        with warnings.catch_warnings(action="ignore"):  # of headers that NumPy needs to fix
            return NpyHeader(*readers[version](stream))
    except _HEADER_FAULTS as error:
        raise ValueError(str(error) or type(error).__name__) from error


def map_numbers(path: Path) -> NDArray[Any]:
    """Map the numbers that ``numpy.save`` wrote, none of which is read yet."""
    try:
        with path.open("rb") as stream:
            shape, fortran_order, dtype = read_header(stream)
            offset = stream.tell()
        if dtype.kind not in _NUMBERS or not dtype.isnative:
            raise ValueError(
                "pickled Python objects, never loaded" if dtype.hasobject else f"{dtype.str} data"
            )
        size = path.stat().st_size - offset
        if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != size:
            raise ValueError(f"it states the shape {str(shape)[:80]}, and holds {size:,} bytes")
    except (OSError, ValueError) as error:
        raise PredictionError(
            f"no array of numbers, or a damaged one: {str(error)[:200]}",
            where=path,
            expected="a file as numpy.save writes it",
            fix=_FIX_COPY,
        ) from error
    if not size:
        return np.empty(shape, dtype)
    return np.memmap(path, dtype, "r", offset, shape, "F" if fortran_order else "C")


class NpzFile:
    """The arrays of an ``.npz`` file, checked, and read one at a time.

    Parameters
    ----------
    path : Path
    limit_bytes : int
        The most that the arrays that are read may take in memory together.
    untouched : collection of str
        Names of arrays that are passed over, as if the file had none of them.
    """

    def __init__(self, path: Path, limit_bytes: int, untouched: Collection[str] = ()) -> None:
        self.path = path
        self.budget = Budget(limit_bytes)
        self.entries = {entry.name: entry for entry in _entries(path, untouched)}

    def names(self) -> set[str]:
        """Return the names of the arrays."""
        return set(self.entries)

    def read(self, name: str) -> NDArray[Any]:
        """Read one array into memory."""
        entry = self.entries[name]
        what = f"field '{name}' (shape {entry.shape}, {entry.dtype})"
        # Bytes become text when they are read, which takes four more bytes a character.
        copies = 5 if entry.dtype.kind == "S" else 1
        self.budget.hold(self.path, what, entry.nbytes * copies, _FIX_LARGE)
        flat = np.empty(math.prod(entry.shape), entry.dtype)
        try:
            with zipfile.ZipFile(self.path) as archive, archive.open(entry.member) as stream:
                stream.read(entry.header_bytes)
                _fill(stream, flat)
                if stream.read(1):  # at its end, zipfile compares the checksum as well
                    raise EOFError("there is more data than the header says")
        except _DAMAGE as error:
            raise _damaged(self.path, name, str(error)) from error
        array = flat.reshape(entry.shape, order="F" if entry.fortran_order else "C")
        return _checked_text(array, self.path, name)

    def map(self, name: str) -> NDArray[Any]:
        """Map one array from disk where it is stored plainly, else read it."""
        entry = self.entries[name]
        plain = entry.dtype.kind in _NUMBERS and entry.dtype.isnative and entry.nbytes > 0
        if entry.compressed or entry.fortran_order or not plain:
            return self.read(name)
        return np.memmap(self.path, entry.dtype, "r", _data_offset(self.path, entry), entry.shape)


def _entries(path: Path, untouched: Collection[str]) -> list[ArrayEntry]:
    if not path.is_file():
        raise UnreadableError(
            "no such prediction file",
            where=path,
            expected=".npz or .parquet",
            fix="`airzoo-bench template` writes an example",
        )
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            wrong = next((name for name in names if not name.endswith(".npy")), None)
            if wrong is not None or len(set(names)) < len(names):
                what = "a member twice" if wrong is None else f"{wrong[:80]!r}, which is no array"
                raise ValueError(f"it holds {what}")
            passed_over = {f"{name}.npy" for name in untouched}
            kept = [one for one in archive.infolist() if one.filename not in passed_over]
            return [_entry(path, archive, member) for member in kept]
    except _DAMAGE as error:
        raise UnreadableError(
            f"not an npz file, or a damaged one: {str(error)[:200]}",
            where=path,
            expected="a file written by numpy.savez or numpy.savez_compressed",
            fix="`airzoo-bench template` writes an example",
        ) from error


def _entry(path: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> ArrayEntry:
    name = member.filename.removesuffix(".npy")
    try:
        with archive.open(member) as stream:
            header = read_header(stream)
            header_bytes = stream.tell()
    except _DAMAGE as error:
        raise _damaged(path, name, str(error)) from error
    shape, fortran_order, dtype = header
    compressed = member.compress_type != zipfile.ZIP_STORED
    entry = ArrayEntry(name, shape, dtype, fortran_order, compressed, member, header_bytes)
    if entry.dtype.kind not in _KINDS:
        raise PredictionError(
            f"field '{name}' holds pickled Python objects, which are never loaded"
            if entry.dtype.hasobject
            else f"field '{name}' has dtype {entry.dtype}",
            where=path,
            expected="arrays of numbers or of fixed-width text",
            fix=f"save it as text, np.array({name}, dtype=str), or each part under its own name",
        )
    size = member.file_size - header_bytes
    sound = all(0 <= side < 1 << 62 for side in shape) and dtype.itemsize > 0
    if not sound or entry.nbytes != size:
        stated = f"{str(entry.shape)[:80]} of {entry.dtype.str[:20]}, the archive {size:,} bytes"
        raise _damaged(path, name, f"its header states {stated}")
    return entry


def _fill(stream: IO[bytes], array: NDArray[Any]) -> None:
    """Read an array's bytes: no more are unpacked than it holds."""
    view = memoryview(array.reshape(-1).view(np.uint8).data if array.nbytes else b"")
    while view:
        count = stream.readinto(view[:_PIECE_BYTES])  # type: ignore[attr-defined]
        if not count:
            raise EOFError("the data ends early")
        view = view[count:]


def _checked_text(array: NDArray[Any], path: Path, name: str) -> NDArray[Any]:
    if array.dtype.kind == "S":
        try:
            return np.char.decode(array, "utf-8")
        except UnicodeDecodeError as error:
            raise _damaged(path, name, "it holds bytes that are not UTF-8") from error
    if array.dtype.kind == "U" and array.size:
        array = array.astype(array.dtype.newbyteorder("="), order="C", copy=False)
        codes = array.reshape(-1).view(np.uint32)
        surrogate = (codes >= _SURROGATES[0]) & (codes <= _SURROGATES[1])
        if codes.max() > _MAX_CODE_POINT or surrogate.any():
            raise _damaged(path, name, "it holds characters outside Unicode")
    return array


def _data_offset(path: Path, entry: ArrayEntry) -> int:
    with path.open("rb") as stream:
        stream.seek(entry.member.header_offset)
        local = stream.read(_LOCAL_HEADER_BYTES).ljust(_LOCAL_HEADER_BYTES, b"\0")
        name_bytes, extra_bytes = struct.unpack("<HH", local[26:])
        start: int = stream.tell() + name_bytes + extra_bytes + entry.header_bytes
        if local[:4] != b"PK\x03\x04" or start + entry.nbytes > path.stat().st_size:
            raise _damaged(path, entry.name, "the file ends before its data does")
    return start


def _damaged(path: Path, name: str, reason: str) -> PredictionError:
    return PredictionError(
        f"field '{name}' is damaged or cut off: {reason[:200]}", where=path, fix=_FIX_COPY
    )
