"""Many small arrays of a method as one large one."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError


def temporary_array(shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return an array that is mapped from a file without a name, which goes with it."""
    with tempfile.TemporaryFile() as file:
        file.truncate(int(np.prod(shape)) * dtype.itemsize)
        return np.memmap(file, dtype, "r+", shape=shape)


def gather(places: Sequence[object], read: Callable[[int], NDArray[Any]]) -> NDArray[Any]:
    """Read the array of each place, all of one shape and type, into a temporary array."""
    first = read(0)
    if not first.size:
        raise PredictionError("has no numbers", where=places[0])
    whole = temporary_array((len(places), *first.shape), first.dtype)
    for row, place in enumerate(places):
        one = read(row) if row else first
        if one.shape != first.shape or one.dtype != first.dtype:
            what = f"is {one.dtype} of shape {one.shape}"
            expected = f"{first.dtype} of shape {first.shape}, as in {places[0]}"
            raise PredictionError(what, where=place, expected=expected)
        whole[row] = one
    return whole
