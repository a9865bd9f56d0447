"""MATLAB 5 files by scipy.io: plain arrays of numbers and lines of text."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
from numpy.typing import NDArray

from airzoo_bench.core.errors import readable
from airzoo_bench.formats.npz import Budget

_MAGIC = b"MATLAB 5.0 MAT-file"


class MatFile:
    """The arrays of a MATLAB 5 file, read one at a time, of `limit_bytes` together at most."""

    def __init__(self, path: Path, limit_bytes: int) -> None:
        self.path = path
        self.budget = Budget(limit_bytes)
        with self._readable(), path.open("rb") as stream:
            if stream.read(len(_MAGIC)) != _MAGIC:
                raise ValueError("no MATLAB 5 file; version 7.3 is HDF5")
            self._names = {name for name, _, _ in scipy.io.whosmat(path)}

    def names(self) -> set[str]:
        """Return the names of the arrays."""
        return set(self._names)

    def numbers(self, name: str) -> NDArray[Any]:
        """Read an array of numbers, in C order."""
        values = self._read(name, "biuf")
        return np.ascontiguousarray(values, values.dtype.newbyteorder("="))

    def texts(self, name: str) -> list[str]:
        """Read an array of characters as its rows, without the blanks that fill them up."""
        return [str(row).rstrip(" \0") for row in self._read(name, "U").reshape(-1)]

    def _read(self, name: str, kinds: str) -> NDArray[Any]:
        with self._readable():
            values = scipy.io.loadmat(self.path, variable_names=[name], chars_as_strings=True)[name]
            if not isinstance(values, np.ndarray) or values.dtype.kind not in kinds:
                raise TypeError(f"variable {name!r} holds no array of the type that is needed")
        # The file has columns first: while these become rows, both are there.
        self.budget.hold(self.path, f"variable {name!r}", 2 * values.nbytes)
        return values

    def _readable(self) -> AbstractContextManager[None]:
        what = "damaged or cut off, or of a kind that is not read here"
        expected = "arrays of numbers and text, as scipy.io.savemat writes them"
        return readable(self.path, what, expected=expected)
