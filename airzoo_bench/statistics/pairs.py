"""Pairs of many variables, row by row."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

__all__ = ["Places", "Wanted", "rows_of"]

Places = NDArray[np.intp]
"""Variables, by their numbers."""
Wanted = NDArray[np.bool_]
"""Which pairs are asked for (V, V), above the diagonal alone."""


def rows_of(wanted: Wanted) -> Iterator[tuple[int, Places]]:
    """Yield each wanted pair once: a variable with others.

    Parameters
    ----------
    wanted : (V, V) bool
        True above the diagonal alone.

    Yields
    ------
    tuple of int and (C,) array of int
        With at least one other; all are higher.
    """
    for one in np.flatnonzero(wanted.any(axis=1)).tolist():
        yield one, np.flatnonzero(wanted[one])
