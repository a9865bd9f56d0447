"""Rows of a compressed array in an ``.npz``, one in memory at a time."""

from __future__ import annotations

import math
import zipfile
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.formats.npz import DAMAGE, ArrayEntry, NpzFile, damaged

__all__ = ["RowStream"]


class RowStream:
    """Gives the rows of an array in turn; going back unpacks it from the start again.

    Parameters
    ----------
    file : NpzFile
    name : str
        An array in C order.
    shape : tuple of int
        What the array is taken to be: its own shape, without axes of length 1 at either end.
    """

    def __init__(self, file: NpzFile, name: str, shape: tuple[int, ...]) -> None:
        self._file = file
        self._entry: ArrayEntry = file.entries[name]
        self._shape = shape[1:]
        self._row_bytes = math.prod(self._shape) * self._entry.dtype.itemsize
        what = f"a row of field '{name}'"
        file.budget.hold(file.path, what, 2 * self._row_bytes)
        self._stream: IO[bytes] | None = None
        self._next = 0
        self._last: NDArray[Any] = np.empty(0)

    def __call__(self, row: int) -> NDArray[Any]:
        """Return a row."""
        try:
            stream = self._stream
            if stream is None or row < self._next - 1:
                stream = self._rewound()
            while self._next <= row:
                self._last = self._read(stream)
                self._next += 1
        except DAMAGE as error:
            raise damaged(self._file.path, self._entry.name, str(error)) from error
        return self._last

    def _rewound(self) -> IO[bytes]:
        if self._stream is not None:
            self._stream.close()
        with zipfile.ZipFile(self._file.path) as archive:
            # The stream keeps the file open for itself.
            self._stream = stream = archive.open(self._entry.member)
        stream.read(self._entry.header_bytes)
        self._next = 0
        return stream

    def _read(self, stream: IO[bytes]) -> NDArray[Any]:
        data = bytearray(self._row_bytes)
        view, done = memoryview(data), 0
        while done < len(view):
            count = stream.readinto(view[done:])  # type: ignore[attr-defined]
            if not count:
                raise EOFError("the data ends early")
            done += count
        return np.frombuffer(data, self._entry.dtype).reshape(self._shape)
