"""The header of an array that ``numpy.save`` wrote, which strangers may have written."""

from __future__ import annotations

import struct
import tokenize
import warnings
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.lib import format as npy

__all__ = ["NpyHeader", "read_header"]

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
    """Read the header of an npy stream, which then stands at the data.

    Raises
    ------
    ValueError
        It is no header of an array without field names (versions 1 and 2 of the format).
    """
    readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    version = npy.read_magic(stream)
    if version not in readers:
        raise ValueError(f"version {version} of the npy format is not for plain arrays")
    try:
        with warnings.catch_warnings(action="ignore"):  # of headers that NumPy needs to fix
            return NpyHeader(*readers[version](stream))
    except _FAULTS as error:
        raise ValueError(str(error) or type(error).__name__) from error
