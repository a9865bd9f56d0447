"""Reading ``.npz`` files that strangers wrote: no pickle, no surprise in size, no traceback.

Every member's header is checked before a byte of its data is touched: the dtype must be numbers or
text, the size it states must be the size that the archive holds, and all that is read must fit the
memory limit together. Members saved without compression (``numpy.savez``) can be mapped instead of
read, so descriptors may be larger than memory.
"""

from __future__ import annotations

import math
import struct
import zipfile
import zlib
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, UnreadableError
from airzoo_bench.formats.budget import Budget
from airzoo_bench.formats.npy import read_header

__all__ = ["DAMAGE", "ArrayEntry", "NpzFile", "damaged"]

_MAX_MEMBERS = 64
_LOCAL_HEADER_BYTES = 30
_KINDS = "biufUS"
_MAX_DIMENSIONS = 8
_FIX_LARGE = "save arrays of numbers by numpy.savez, uncompressed, to have them read in pieces"
_MAX_CODE_POINT = 0x10FFFF
_SURROGATES = (0xD800, 0xDFFF)
_LOOKS_LIKE = {
    b"\x93NUMPY": "a single .npy array",
    b"\x89HDF\r\n": "an HDF5 file",
    b"PAR1": "a parquet file",
    b"\x80": "a Python pickle",
    b"PK": "a zip archive that was cut off or damaged",
}
_COMPRESSIONS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
DAMAGE = (EOFError, OSError, RuntimeError, ValueError, zipfile.BadZipFile, zlib.error)
"""What zipfile and its decompressor raise over damaged bytes, and `read_header`."""


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
        """Size of the data in bytes, in exact integers (headers may state absurd shapes)."""
        return math.prod(self.shape) * self.dtype.itemsize


class NpzFile:
    """The arrays of an ``.npz`` file, checked, and read one at a time.

    Parameters
    ----------
    path : Path
        The file.
    limit_bytes : int
        The most that the arrays that are read may take in memory together.
    untouched : collection of str
        Names of arrays that are passed over, as if the file had none of them.

    Raises
    ------
    PredictionError
        It is not an npz, is cut off or damaged, or holds Python objects.
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
        self.budget.hold(self.path, what, _bytes_in_memory(entry), _FIX_LARGE)
        try:
            with zipfile.ZipFile(self.path) as archive, archive.open(entry.member) as stream:
                stream.read(entry.header_bytes)
                array = _fill(stream, entry)
        except DAMAGE as error:
            raise damaged(self.path, name, str(error)) from error
        return _checked_text(array, self.path, name)

    def map(self, name: str) -> NDArray[Any]:
        """Map one array from disk where it is stored plainly, else read it."""
        entry = self.entries[name]
        plain = not (entry.compressed or entry.fortran_order or entry.nbytes == 0)
        if not (plain and entry.dtype.kind in "biuf" and entry.dtype.isnative):
            return self.read(name)
        offset = _data_offset(self.path, entry)
        return np.memmap(self.path, entry.dtype, "r", offset, entry.shape)


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
            members = archive.infolist()
            if len(members) > _MAX_MEMBERS:
                raise _not_npz(path, f"it holds {len(members):,} members")
            _check_members(path, members)
            passed_over = {f"{name}.npy" for name in untouched}
            kept = [member for member in members if member.filename not in passed_over]
            return [_entry(path, archive, member) for member in kept]
    except DAMAGE as error:
        raise _not_npz(path, _impression(path)) from error


def _check_members(path: Path, members: list[zipfile.ZipInfo]) -> None:
    for name, count in Counter(member.filename for member in members).items():
        if not name.endswith(".npy"):
            raise _not_npz(path, f"its member {name[:80]!r} is not an array (.npy)")
        if count > 1:
            raise _not_npz(path, f"it holds the member {name[:80]!r} {count} times")
    if any(member.flag_bits & 0x1 for member in members):
        raise _not_npz(path, "it is encrypted")
    if any(member.compress_type not in _COMPRESSIONS for member in members):
        raise _not_npz(path, "it is compressed in a way that NumPy does not write")


def _entry(path: Path, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> ArrayEntry:
    name = member.filename.removesuffix(".npy")
    try:
        with archive.open(member) as stream:
            shape, fortran_order, dtype = read_header(stream)
            header_bytes = stream.tell()
    except DAMAGE as error:
        raise damaged(path, name, str(error)) from error
    compressed = member.compress_type != zipfile.ZIP_STORED
    entry = ArrayEntry(name, shape, dtype, fortran_order, compressed, member, header_bytes)
    _check_header(path, entry)
    return entry


def _check_header(path: Path, entry: ArrayEntry) -> None:
    if entry.dtype.hasobject:
        raise PredictionError(
            f"field '{entry.name}' holds pickled Python objects, which are never loaded",
            where=path,
            expected="arrays of numbers or of fixed-width text",
            fix=f"save it as text: np.array({entry.name}, dtype=str)",
        )
    if entry.dtype.kind not in _KINDS:
        raise PredictionError(
            f"field '{entry.name}' has dtype {entry.dtype}",
            where=path,
            expected="numbers or text",
            fix="save each part under its own name: `airzoo-bench template` writes an example",
        )
    sound = len(entry.shape) <= _MAX_DIMENSIONS and all(0 <= n < 1 << 62 for n in entry.shape)
    if not sound or entry.dtype.itemsize == 0:
        stated = str((entry.shape, entry.dtype.str))[:80]
        raise damaged(path, entry.name, f"its header states the shape and type {stated}")
    size = entry.member.file_size - entry.header_bytes
    if entry.nbytes != size:
        reason = f"its header states {entry.nbytes:,} bytes, the archive holds {size:,}"
        raise damaged(path, entry.name, reason)


def _bytes_in_memory(entry: ArrayEntry) -> int:
    # Bytes become text when they are read, which takes four more bytes a character.
    return entry.nbytes * (5 if entry.dtype.kind == "S" else 1)


def _fill(stream: IO[bytes], entry: ArrayEntry) -> NDArray[Any]:
    # Reading into an array of the checked size bounds the memory: a member that unpacks to more
    # than its header says is never unpacked beyond it.
    flat = np.empty(math.prod(entry.shape), entry.dtype)
    view = memoryview(flat.view(np.uint8).data if flat.nbytes else b"")
    done = 0
    while done < len(view):
        count = stream.readinto(view[done : done + (1 << 22)])  # type: ignore[attr-defined]
        if not count:
            raise EOFError("the data ends early")
        done += count
    if stream.read(1):
        raise EOFError("there is more data than the header says")
    return flat.reshape(entry.shape, order="F" if entry.fortran_order else "C")


def _checked_text(array: NDArray[Any], path: Path, name: str) -> NDArray[Any]:
    if array.dtype.kind == "S":
        try:
            return np.char.decode(array, "utf-8")
        except UnicodeDecodeError as error:
            raise PredictionError(
                f"field '{name}' holds bytes that are not UTF-8",
                where=path,
                expected="text",
                fix=f"save it as text: np.array({name}, dtype=str)",
            ) from error
    if array.dtype.kind == "U" and array.size and array.dtype.itemsize:
        native = array.astype(array.dtype.newbyteorder("="), order="C", copy=False)
        codes = native.reshape(-1).view(np.uint32)
        surrogate = (codes >= _SURROGATES[0]) & (codes <= _SURROGATES[1])
        if codes.max() > _MAX_CODE_POINT or surrogate.any():
            raise damaged(path, name, "it holds characters outside Unicode")
        return native
    return array


def _data_offset(path: Path, entry: ArrayEntry) -> int:
    with path.open("rb") as stream:
        stream.seek(entry.member.header_offset)
        local = stream.read(_LOCAL_HEADER_BYTES)
    if len(local) < _LOCAL_HEADER_BYTES or local[:4] != b"PK\x03\x04":
        raise damaged(path, entry.name, "its local header is missing")
    name_bytes, extra_bytes = struct.unpack("<HH", local[26:30])
    start = entry.member.header_offset + _LOCAL_HEADER_BYTES + name_bytes + extra_bytes
    offset = int(start + entry.header_bytes)
    if offset + entry.nbytes > path.stat().st_size:
        raise damaged(path, entry.name, "the file ends before its data does")
    return offset


def _impression(path: Path) -> str:
    with path.open("rb") as stream:
        head = stream.read(8)
    for magic, text in _LOOKS_LIKE.items():
        if head.startswith(magic):
            return f"it looks like {text}"
    return "it is empty" if not head else f"it begins with the bytes {head.hex(' ')}"


def _not_npz(path: Path, impression: str) -> UnreadableError:
    return UnreadableError(
        f"not an npz file: {impression}",
        where=path,
        expected="a file written by numpy.savez or numpy.savez_compressed",
        fix="`airzoo-bench template` writes an example",
    )


def damaged(path: Path, name: str, reason: str) -> PredictionError:
    """Make the error of a field whose bytes are not what they should be."""
    return PredictionError(
        f"field '{name}' is damaged or cut off: {reason}",
        where=path,
        fix="write or copy the file again",
    )
