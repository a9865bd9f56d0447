"""``.npy`` and ``.npz`` files: no pickle, no memory beyond what was agreed, no copies of maps.

A member's header is held against the size that the archive states before its data are touched.
Members that ``numpy.savez`` stored are mapped, so that descriptors may be larger than memory.
"""

from __future__ import annotations

import math
import struct
import zipfile
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, UnreadableError, readable

_NUMBERS, _KINDS = "biuf", "biufUS"
_LOCAL_HEADER_BYTES = 30
_PIECE_BYTES = 1 << 22
_MAX_CODE_POINT, _SURROGATES = 0x10FFFF, (0xD800, 0xDFFF)
_DAMAGED = "field '{}' is damaged or cut off"
_FIX_LARGE = "save arrays of numbers by numpy.savez, uncompressed, to have them read in pieces"


@dataclass(frozen=True)
class Budget:
    """The memory that the parts of a file take, and their common limit.

    Readers name each part before they allocate it, with the bytes that a run makes of it.
    """

    limit_bytes: int
    taken: dict[str, int] = field(default_factory=dict)

    def hold(self, path: Path, part: str, nbytes: int, fix: str | None = None) -> None:
        """Count a part; one that is named again counts once, with its larger size."""
        self.taken[part] = max(nbytes, self.taken.get(part, 0))
        others = sum(self.taken.values()) - self.taken[part]
        if self.taken[part] + others > self.limit_bytes:
            rest = f" besides {others:,} bytes of others" if others else ""
            raise PredictionError(
                f"{part}: {self.taken[part]:,} bytes of memory{rest}, more than the limit",
                where=path,
                expected=f"at most {self.limit_bytes:,} bytes, all together",
                fix="raise --max-memory" + (f", or {fix}" if fix else ""),
            )


class NpyHeader(NamedTuple):
    """The content of a header, which is not checked against the data."""

    shape: tuple[int, ...]
    fortran_order: bool
    dtype: np.dtype[Any]

    @property
    def nbytes(self) -> int:
        """Size of the data in bytes, in exact integers."""
        return math.prod(self.shape) * self.dtype.itemsize

    def fits(self, size: int) -> bool:
        """Tell whether its array takes this many bytes."""
        plain = min(self.shape, default=0) >= 0 and self.dtype.itemsize > 0
        return plain and max(self.shape, default=0) < 1 << 62 and self.nbytes == size


class Entry(NamedTuple):
    """One member of an archive: its header, and how many bytes of the member that takes."""

    header: NpyHeader
    member: zipfile.ZipInfo
    header_bytes: int

    @property
    def shape(self) -> tuple[int, ...]:
        """The array's shape."""
        return self.header.shape


def read_header(stream: IO[bytes]) -> NpyHeader:
    """Read the header of an npy stream up to its data."""
    readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    version = npy.read_magic(stream)
    if version not in readers:
        raise ValueError(f"version {version} of the npy format is not for plain arrays")
    try:
        return NpyHeader(*readers[version](stream))
    except Exception as error:  # of NumPy over a text: SyntaxError, RecursionError, TokenError
        raise ValueError(str(error) or type(error).__name__) from error


def map_numbers(path: Path) -> NDArray[Any]:
    """Map the numbers that ``numpy.save`` wrote without reading them."""
    what = "no array of numbers, or a damaged one"
    expected = "a file as numpy.save writes it"
    with readable(path, what, expected=expected), path.open("rb") as stream:
        header = read_header(stream)
        shape, fortran_order, dtype = header
        if dtype.kind not in _NUMBERS or not dtype.isnative:
            objects = "pickled Python objects, never loaded"
            raise ValueError(objects if dtype.hasobject else f"{dtype.str} data")
        size = path.stat().st_size - stream.tell()
        if not header.fits(size):
            raise ValueError(f"it states the shape {str(shape)[:80]}, and holds {size:,} bytes")
        if not size:
            return np.empty(shape, dtype)
        return np.memmap(path, dtype, "r", stream.tell(), shape, "F" if fortran_order else "C")


class NpzFile:
    """The arrays of an ``.npz`` file, read one at a time, of `limit_bytes` together at most.

    Arrays named in `untouched` are passed over, as if the file had none of them.
    """

    def __init__(self, path: Path, limit_bytes: int, untouched: Collection[str] = ()) -> None:
        self.path = path
        self.budget = Budget(limit_bytes)
        if not path.is_file():
            fix = "`airzoo-bench template` writes an example"
            raise UnreadableError("no such prediction file", where=path, fix=fix)
        what = "not an npz file, or a damaged one"
        expected = "a file written by numpy.savez or numpy.savez_compressed"
        with (
            readable(path, what, kind=UnreadableError, expected=expected),
            zipfile.ZipFile(path) as archive,
        ):
            names = archive.namelist()
            wrong = next((name for name in names if not name.endswith(".npy")), None)
            if wrong is not None:
                raise ValueError(f"it holds {wrong[:80]!r}, which is no array")
            if len(set(names)) < len(names):
                raise ValueError("it holds a member twice")
            self.entries = {
                name: self._entry(archive, member, name)
                for member in archive.infolist()
                if (name := member.filename.removesuffix(".npy")) not in untouched
            }

    def _entry(self, archive: zipfile.ZipFile, member: zipfile.ZipInfo, name: str) -> Entry:
        with readable(self.path, _DAMAGED.format(name)), archive.open(member) as stream:
            header = read_header(stream)
            header_bytes, dtype = stream.tell(), header.dtype
            size = member.file_size - header_bytes
            if dtype.kind in _KINDS and not header.fits(size):
                stated = f"{str(header.shape)[:80]} of {dtype.str[:20]}"
                raise ValueError(f"its header states {stated}, the archive {size:,} bytes")
        if dtype.kind not in _KINDS:
            raise PredictionError(
                f"field '{name}' holds pickled Python objects, which are never loaded"
                if dtype.hasobject
                else f"field '{name}' has dtype {dtype}",
                where=self.path,
                expected="arrays of numbers or of fixed-width text",
                fix=f"save it as text, np.array({name}, dtype=str), or each part by itself",
            )
        return Entry(header, member, header_bytes)

    def names(self) -> set[str]:
        """Return the names of the arrays."""
        return set(self.entries)

    def read(self, name: str) -> NDArray[Any]:
        """Read one array into memory."""
        header, member, header_bytes = self.entries[name]
        what = f"field '{name}' (shape {header.shape}, {header.dtype})"
        # Bytes become text when they are read, which takes four more bytes a character.
        copies = 5 if header.dtype.kind == "S" else 1
        self.budget.hold(self.path, what, header.nbytes * copies, _FIX_LARGE)
        flat = np.empty(math.prod(header.shape), header.dtype)
        with (
            readable(self.path, _DAMAGED.format(name)),
            zipfile.ZipFile(self.path) as archive,
            archive.open(member) as stream,
        ):
            stream.read(header_bytes)
            view = memoryview(flat.view(np.uint8).data if flat.nbytes else b"")
            while view:
                count = stream.readinto(view[:_PIECE_BYTES])  # type: ignore[attr-defined]
                if not count:
                    raise EOFError("the data ends early")
                view = view[count:]
            stream.read(1)  # at its end, zipfile compares the checksum
            array = flat.reshape(header.shape, order="F" if header.fortran_order else "C")
            return _checked_text(array)

    def map(self, name: str) -> NDArray[Any]:
        """Map one array from disk where it is stored plainly, else read it."""
        header, member, header_bytes = self.entries[name]
        stored = member.compress_type == zipfile.ZIP_STORED and not header.fortran_order
        dtype = header.dtype
        if not (stored and dtype.kind in _NUMBERS and dtype.isnative and header.nbytes):
            return self.read(name)
        with readable(self.path, _DAMAGED.format(name)), self.path.open("rb") as stream:
            stream.seek(member.header_offset)
            local = stream.read(_LOCAL_HEADER_BYTES)
            start = stream.tell() + sum(struct.unpack("<HH", local[26:])) + header_bytes
            if local[:4] != b"PK\x03\x04" or start + header.nbytes > self.path.stat().st_size:
                raise EOFError("the file ends before its data does")
        return np.memmap(self.path, dtype, "r", start, header.shape)


def _checked_text(array: NDArray[Any]) -> NDArray[Any]:
    if array.dtype.kind == "S":
        return np.char.decode(array, "utf-8")
    if array.dtype.kind == "U" and array.size:
        array = array.astype(array.dtype.newbyteorder("="), order="C", copy=False)
        codes = array.reshape(-1).view(np.uint32)
        surrogate = (codes >= _SURROGATES[0]) & (codes <= _SURROGATES[1])
        if codes.max() > _MAX_CODE_POINT or surrogate.any():
            raise ValueError("it holds characters outside Unicode")
    return array
