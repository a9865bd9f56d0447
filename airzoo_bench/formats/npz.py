"""``.npy`` and ``.npz`` files: no pickle, no memory beyond what was agreed, no copies of maps.

A member's header is held against the size that the archive states before its data are touched.
Members that ``numpy.savez`` stored are mapped, so that descriptors may be larger than memory.
"""

from __future__ import annotations

import math
import struct
import zipfile
from collections.abc import Collection
from contextlib import AbstractContextManager
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
        total = sum(self.taken.values())
        if total > self.limit_bytes:
            raise PredictionError(
                f"{part}: {self.taken[part]:,} bytes of memory, with others {total:,}, more than "
                "the limit",
                where=path,
                expected=f"at most {self.limit_bytes:,} bytes, all together",
                fix="raise --max-memory" + (f", or {fix}" if fix else ""),
            )


class Entry(NamedTuple):
    """An array of an archive: its header, its member, and where in it the data begin."""

    shape: tuple[int, ...]
    fortran_order: bool
    dtype: np.dtype[Any]
    member: zipfile.ZipInfo
    start: int

    @property
    def nbytes(self) -> int:
        """Size of the data in bytes, in exact integers."""
        return math.prod(self.shape) * self.dtype.itemsize


def read_header(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Read shape, order and type of an npy stream up to its data, which are not looked at."""
    readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    version = npy.read_magic(stream)
    if version not in readers:
        raise ValueError(f"version {version} of the npy format is not for plain arrays")
    try:
        shape, fortran_order, dtype = readers[version](stream)
    except Exception as error:  # of NumPy over a text: SyntaxError, RecursionError, TokenError
        raise ValueError(str(error) or type(error).__name__) from error
    return shape, fortran_order, dtype


def _check_size(shape: tuple[int, ...], dtype: np.dtype[Any], size: int) -> None:
    plain = all(0 <= side < 1 << 62 for side in shape) and dtype.itemsize > 0
    if not plain or math.prod(shape) * dtype.itemsize != size:
        stated = f"{str(shape)[:80]} of {dtype.str[:20]}"
        raise ValueError(f"its header states {stated}, and it holds {size:,} bytes")


def map_numbers(path: Path) -> NDArray[Any]:
    """Map the numbers that ``numpy.save`` wrote without reading them."""
    what, expected = "no array of numbers, or a damaged one", "a file as numpy.save writes it"
    with readable(path, what, expected=expected), path.open("rb") as stream:
        shape, fortran_order, dtype = read_header(stream)
        if dtype.kind not in _NUMBERS or not dtype.isnative:
            objects = "pickled Python objects, never loaded"
            raise ValueError(objects if dtype.hasobject else f"{dtype.str} data")
        size = path.stat().st_size - stream.tell()
        _check_size(shape, dtype, size)
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
            if wrong is not None or len(set(names)) < len(names):
                raise ValueError(f"it holds {(wrong or 'a member twice')[:80]!r}")
            self.entries = {
                name: self._entry(archive, member, name)
                for member in archive.infolist()
                if (name := member.filename.removesuffix(".npy")) not in untouched
            }

    def _entry(self, archive: zipfile.ZipFile, member: zipfile.ZipInfo, name: str) -> Entry:
        with self._readable(name), archive.open(member) as stream:
            entry = Entry(*read_header(stream), member, stream.tell())
            if entry.dtype.kind in _KINDS:
                _check_size(entry.shape, entry.dtype, member.file_size - entry.start)
                return entry
        holds = "holds pickled Python objects, which are never loaded"
        raise PredictionError(
            f"field '{name}' {holds if entry.dtype.hasobject else f'has dtype {entry.dtype}'}",
            where=self.path,
            expected="arrays of numbers or of fixed-width text",
            fix=f'np.array({name}, dtype=str); before that, fill shorter lists up with ""',
        )

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
        with (
            self._readable(name),
            zipfile.ZipFile(self.path) as archive,
            archive.open(entry.member) as stream,
        ):
            stream.read(entry.start)
            view = memoryview(flat.view(np.uint8).data if flat.nbytes else b"")
            while view:
                count = stream.readinto(view[:_PIECE_BYTES])  # type: ignore[attr-defined]
                if not count:
                    raise EOFError("the data ends early")
                view = view[count:]
            stream.read(1)  # at its end, zipfile compares the checksum
            array = flat.reshape(entry.shape, order="F" if entry.fortran_order else "C")
            return _decode_text(array)

    def map(self, name: str) -> NDArray[Any]:
        """Map one array from disk where it is stored plainly, else read it."""
        entry, dtype = self.entries[name], self.entries[name].dtype
        stored = entry.member.compress_type == zipfile.ZIP_STORED and not entry.fortran_order
        if not (stored and dtype.kind in _NUMBERS and dtype.isnative and entry.nbytes):
            return self.read(name)
        with self._readable(name), self.path.open("rb") as stream:
            stream.seek(entry.member.header_offset)
            local = stream.read(_LOCAL_HEADER_BYTES)
            start = stream.tell() + sum(struct.unpack("<HH", local[26:])) + entry.start
            if local[:4] != b"PK\x03\x04" or start + entry.nbytes > self.path.stat().st_size:
                raise EOFError("the file ends before its data does")
        return np.memmap(self.path, dtype, "r", start, entry.shape)

    def _readable(self, name: str) -> AbstractContextManager[None]:
        return readable(self.path, f"field '{name}' is damaged or cut off")


def _decode_text(array: NDArray[Any]) -> NDArray[Any]:
    if array.dtype.kind == "S":
        return np.char.decode(array, "utf-8")
    if array.dtype.kind == "U" and array.size:
        array = array.astype(array.dtype.newbyteorder("="), order="C", copy=False)
        codes = array.reshape(-1).view(np.uint32)
        surrogate = (codes >= _SURROGATES[0]) & (codes <= _SURROGATES[1])
        if codes.max() > _MAX_CODE_POINT or surrogate.any():
            raise ValueError("it holds characters outside Unicode")
    return array
