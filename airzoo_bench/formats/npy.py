"""The header of an array that ``numpy.save`` wrote, which strangers may have written."""

from __future__ import annotations

import math
import struct
import tokenize
import warnings
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError

__all__ = ["NpyHeader", "map_numbers", "read_header"]

# All that `ast.literal_eval` and `numpy.dtype` raise over a text, and NumPy over what they return.
_FAULTS = (
    *(EOFError, MemoryError, OverflowError, RecursionError, SyntaxError, TypeError, ValueError),
    *(struct.error, tokenize.TokenError),
)


class NpyHeader(NamedTuple):
    """What a header states; nothing of it is checked against the data."""

    shape: tuple[int, ...]
    fortran_order: bool
    dtype: np.dtype[Any]


def read_header(stream: IO[bytes]) -> NpyHeader:
    """Read the header of an npy stream, which then stands at the data."""
    readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    version = npy.read_magic(stream)
    if version not in readers:
        raise ValueError(f"version {version} of the npy format is not for plain arrays")
    try:
        with warnings.catch_warnings(action="ignore"):  # of headers that NumPy needs to fix
            return NpyHeader(*readers[version](stream))
    except _FAULTS as error:
        raise ValueError(str(error) or type(error).__name__) from error


def map_numbers(path: Path) -> NDArray[Any]:
    """Map the numbers that ``numpy.save`` wrote, none of which is read yet."""
    try:
        with path.open("rb") as stream:
            shape, fortran_order, dtype = read_header(stream)
            offset = stream.tell()
    except (OSError, ValueError) as error:
        raise _no_array(path, str(error)) from error
    if dtype.kind not in "biuf" or not dtype.isnative:
        what = "pickled Python objects, never loaded" if dtype.hasobject else f"{dtype.str} data"
        raise _no_array(path, what)
    size = path.stat().st_size - offset
    if any(n < 0 for n in shape) or math.prod(shape) * dtype.itemsize != size:
        raise _no_array(
            path, f"its header states the shape {str(shape)[:80]}, which {size:,} bytes are not"
        )
    if not size:
        return np.empty(shape, dtype)
    return np.memmap(path, dtype, "r", offset, shape, "F" if fortran_order else "C")


def _no_array(path: Path, why: str) -> PredictionError:
    return PredictionError(
        f"no array of numbers, or a damaged one: {why[:200]}",
        where=path,
        expected="a file as numpy.save writes it",
        fix="write or copy the file again",
    )
