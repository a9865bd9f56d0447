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


def mat_names(path: Path) -> set[str]:
    """Return the names of the arrays."""
    with _readable(path), path.open("rb") as stream:
        if stream.read(len(_MAGIC)) != _MAGIC:
            raise ValueError("no MATLAB 5 file; version 7.3 is HDF5")
        return {name for name, _, _ in scipy.io.whosmat(path)}


def read_mat(path: Path, name: str, kinds: str, limit_bytes: int) -> NDArray[Any]:
    """Read an array of one of some kinds in C order; of text, lines without blanks at the end."""
    mat_names(path)
    with _readable(path):
        values = scipy.io.loadmat(path, variable_names=[name], chars_as_strings=True)[name]
        if not isinstance(values, np.ndarray) or values.dtype.kind not in kinds:
            raise TypeError(f"variable {name!r} holds no array of the type that is needed")
    # The file has columns first: while these become rows, both are there.
    Budget(limit_bytes).hold(path, f"variable {name!r}", 2 * values.nbytes)
    if values.dtype.kind == "U":
        return np.char.rstrip(values.reshape(-1), " \0")
    return np.ascontiguousarray(values, values.dtype.newbyteorder("="))


def _readable(path: Path) -> AbstractContextManager[None]:
    what = "damaged or cut off, or of a kind that is not read here"
    expected = "arrays of numbers and text, as scipy.io.savemat writes them"
    return readable(path, what, expected=expected)
