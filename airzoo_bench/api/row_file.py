"""Rows of numbers kept on disk until all of them are there: descriptors, depth maps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from airzoo_bench.api.arrays import in_order
from airzoo_bench.core.errors import PredictionError

__all__ = ["RowFile"]

_KINDS = ("float16", "float32", "float64")


class RowFile:
    """Up to `count` rows of one shape, in a file, so that they may be larger than memory.

    Parameters
    ----------
    path : Path
        Made with the first row.
    field : str
        What the rows are called in messages.
    count : int
    axes : int
        How many axes a row has.
    """

    def __init__(self, path: Path, field: str, count: int, axes: int) -> None:
        self._path, self._field, self._axes = path, field, axes
        self._there = np.zeros(count, np.bool_)
        self._rows: NDArray[np.floating[Any]] | None = None

    @property
    def there(self) -> NDArray[np.bool_]:
        """Which rows are there, (count,)."""
        return self._there

    def check(self, values: ArrayLike) -> NDArray[np.floating[Any]]:
        """Return a row as it will be kept: floating point, of the shape of the first.

        Raises
        ------
        ArgumentError
            It has no order, or masked entries.
        PredictionError
            It is of another shape, is empty, or has no floating-point numbers.
        """
        row = np.asarray(in_order(self._field, values))
        if row.dtype.name not in _KINDS or row.ndim != self._axes or not row.size:
            raise PredictionError(
                f"{self._field} is {row.dtype} of shape {row.shape}",
                expected=f"{', '.join(_KINDS)} with {self._axes} axes, none of them empty",
            )
        if self._rows is not None and row.shape != self._rows.shape[1:]:
            raise PredictionError(
                f"{self._field} has shape {row.shape}",
                expected=f"{self._rows.shape[1:]}, the shape of the first",
            )
        if self._rows is not None and row.dtype != self._rows.dtype:
            raise PredictionError(
                f"{self._field} is {row.dtype}, and the first was {self._rows.dtype}",
                expected="one type for all, which keeps all digits",
                fix="np.asarray(values, np.float32) for each",
            )
        return row

    def put(self, index: int, row: NDArray[np.floating[Any]]) -> None:
        """Keep a row that `check` has returned, in the type of the first."""
        if self._rows is None:
            shape = (len(self._there), *row.shape)
            self._rows = np.memmap(self._path, row.dtype, "w+", shape=shape)
        self._rows[index] = row
        self._there[index] = True

    def packed(self) -> NDArray[np.floating[Any]]:
        """Return the rows that are there, (n, ...), in order, still on disk; the last call."""
        if self._rows is None:
            raise ValueError("no row was put")
        for target, source in enumerate(np.flatnonzero(self._there)):
            if target != source:
                self._rows[target] = self._rows[source]
        return self._rows[: int(self._there.sum())]
