"""Reading MATLAB 5 files that strangers wrote: plain arrays of numbers and of characters.

Every size is held against that of the file before memory is taken. What `scipy.io.savemat` writes
by default is read; compressed variables, structs, cells and the HDF5 of version 7.3 are not.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, UnreadableError
from airzoo_bench.formats.budget import Budget

__all__ = ["MatFile", "is_mat5"]

_HEADER_BYTES = 128
_ORDERS = {b"IM": "<", b"MI": ">"}  # the letters that end the header
_MATRIX, _COMPRESSED = 14, 15
_NUMBERS = {
    **{1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4"},
    **{7: "f4", 9: "f8", 12: "i8", 13: "u8"},
}
_CODECS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
_CHARACTERS, _NUMERIC = 4, range(6, 16)  # classes of arrays
_COMPLEX = 0x08
_MOST_VARIABLES = 256
_SMALL = 4
_MOST_DIMENSIONS = 8
_LONGEST_NAME = 256
_BYTES_OF_CHARACTER = 8  # of memory, while text is decoded


@dataclass(frozen=True)
class _Element:
    """Where the data of an element are; its `end` is where the next one begins."""

    kind: int
    start: int
    size: int
    end: int


@dataclass(frozen=True)
class _Variable:
    array_class: int
    shape: tuple[int, ...]
    data: _Element


class MatFile:
    """The arrays of a MATLAB 5 file, read one at a time.

    Parameters
    ----------
    path : Path
    limit_bytes : int
        The most that the arrays that are read may take in memory together.

    Raises
    ------
    UnreadableError
        It is no such file.
    PredictionError
        It is damaged, compressed, or holds more than can be meant.
    """

    def __init__(self, path: Path, limit_bytes: int) -> None:
        if not is_mat5(path):
            raise UnreadableError(
                "no MATLAB 5 file",
                where=path,
                expected="what scipy.io.savemat writes; version 7.3 is HDF5",
                fix="save it with scipy.io.savemat",
            )
        self.path = path
        self.budget = Budget(limit_bytes)
        self._size = path.stat().st_size
        with path.open("rb") as stream:
            stream.seek(_HEADER_BYTES - 2)
            self._order = _ORDERS[stream.read(2)]
            try:
                self._variables = dict(self._scan(stream))
            except (struct.error, UnicodeDecodeError, ValueError) as error:
                raise self._damaged(str(error)) from error

    def names(self) -> set[str]:
        """Return the names of the arrays."""
        return set(self._variables)

    def numbers(self, name: str) -> NDArray[Any]:
        """Read an array of numbers, in C order."""
        variable = self._variables[name]
        code = _NUMBERS.get(variable.data.kind)
        if variable.array_class not in _NUMERIC or code is None:
            raise self._damaged(f"variable {name!r} holds no numbers")
        dtype, count = np.dtype(self._order + code), math.prod(variable.shape)
        if count * dtype.itemsize != variable.data.size:
            raise self._damaged(f"variable {name!r} states the shape {variable.shape}")
        # The file has columns first: while these become rows, both are there.
        self.budget.hold(self.path, f"variable {name!r}", 2 * variable.data.size)
        flat = np.frombuffer(self._bytes(variable.data), dtype)
        columns = flat.reshape(variable.shape, order="F")
        return np.ascontiguousarray(columns, dtype.newbyteorder("="))

    def texts(self, name: str) -> list[str]:
        """Read an array of characters as its rows, without the blanks that fill them up."""
        variable = self._variables[name]
        codec = _CODECS.get(variable.data.kind)
        if variable.array_class != _CHARACTERS or codec is None or len(variable.shape) != 2:
            raise self._damaged(f"variable {name!r} holds no lines of text")
        size = variable.data.size * _BYTES_OF_CHARACTER
        self.budget.hold(self.path, f"variable {name!r}", size)
        if codec in ("utf-16", "utf-32"):
            codec += "-le" if self._order == "<" else "-be"
        try:
            letters = self._bytes(variable.data).decode(codec)
        except UnicodeDecodeError as error:
            raise self._damaged(f"variable {name!r}: {error}") from error
        rows, width = variable.shape
        if len(letters) != rows * width:
            raise self._damaged(f"variable {name!r} states the shape {variable.shape}")
        return [letters[row::rows].rstrip(" \0") for row in range(rows)]

    def _bytes(self, data: _Element) -> bytes:
        with self.path.open("rb") as stream:
            stream.seek(data.start)
            return stream.read(data.size)

    def _scan(self, stream: IO[bytes]) -> Iterator[tuple[str, _Variable]]:
        """Yield the variables, without reading their data."""
        at, count = _HEADER_BYTES, 0
        while at < self._size:
            element, count = self._element(stream, at, self._size), count + 1
            if element.kind == _COMPRESSED:
                raise ValueError("it is compressed; save it with do_compression=False")
            if element.kind != _MATRIX or count > _MOST_VARIABLES:
                raise ValueError(f"an element of type {element.kind} at byte {at:,}")
            found = self._variable(stream, element)
            if found is not None:
                yield found
            at = element.start + element.size

    def _variable(self, stream: IO[bytes], matrix: _Element) -> tuple[str, _Variable] | None:
        """Return a variable with its name; None of what is no array of numbers or characters."""
        end = matrix.start + matrix.size
        flags = self._element(stream, matrix.start, end)
        word = self._unpack(stream, flags, "I")[:1]
        if not word:
            raise ValueError(f"a variable without a class at byte {matrix.start:,}")
        array_class, bits = word[0] & 0xFF, word[0] >> 8 & 0xFF
        shape = self._element(stream, flags.end, end)
        title = self._element(stream, shape.end, end)
        if array_class not in (_CHARACTERS, *_NUMERIC) or bits & _COMPLEX:
            return None
        if not 0 < shape.size // 4 <= _MOST_DIMENSIONS or title.size > _LONGEST_NAME:
            raise ValueError(f"a variable without shape or name at byte {matrix.start:,}")
        sides = tuple(self._unpack(stream, shape, "i"))
        if min(sides) < 0:
            raise ValueError(f"a variable of shape {sides}")
        stream.seek(title.start)
        name = stream.read(title.size).decode("ascii")
        return name, _Variable(array_class, sides, self._element(stream, title.end, end))

    def _element(self, stream: IO[bytes], at: int, end: int) -> _Element:
        """Read the tag of an element that must lie before `end`."""
        stream.seek(at)
        kind, size = struct.unpack(self._order + "II", stream.read(8))
        start, following = at + 8, at + 8 + -(-size // 8) * 8
        small = kind >> 16  # up to four bytes stand within the tag
        if small:
            kind, size, start, following = kind & 0xFFFF, small, at + 4, at + 8
        if start + size > end or small > _SMALL:
            raise ValueError(f"an element of {size:,} bytes at byte {at:,} ends beyond its parent")
        return _Element(kind, start, size, following)

    def _unpack(self, stream: IO[bytes], element: _Element, code: str) -> tuple[int, ...]:
        stream.seek(element.start)
        size = min(element.size, 4 * _MOST_DIMENSIONS)
        return struct.unpack(f"{self._order}{size // 4}{code}", stream.read(size // 4 * 4))

    def _damaged(self, reason: str) -> PredictionError:
        return PredictionError(
            f"damaged, or MATLAB 5 of a kind that is not read here: {reason[:300]}",
            where=self.path,
            expected="arrays of numbers and of characters, as scipy.io.savemat writes them",
            fix="write or copy the file again",
        )


def is_mat5(path: Path) -> bool:
    """Tell by its header whether a path is a MATLAB 5 file."""
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        header = stream.read(_HEADER_BYTES)
    order = _ORDERS.get(header[126:])
    return order is not None and struct.unpack(order + "H", header[124:126])[0] == 0x0100
