"""Maps of many views, of which one at a time is in memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Ints

__all__ = ["FloatMaps", "LazyMaps"]


class FloatMaps(Protocol):
    """Maps (N, H, W) or (N, H, W, 3) of floating point: an array, or `LazyMaps`."""

    @property
    def shape(self) -> tuple[int, ...]:
        """N, H, W, and perhaps 3."""

    @property
    def dtype(self) -> np.dtype[Any]:
        """Floating point."""

    def __len__(self) -> int:
        """Return N."""

    def __getitem__(self, key: Any, /) -> Any:
        """Return the map of a view, or the maps of several."""


@dataclass(frozen=True, eq=False)
class LazyMaps:
    """Maps of N views, each made when it is asked for.

    Attributes
    ----------
    rows : (N,) int64
        Which of the views that `make` knows.
    size : tuple of int
        Shape of one map.
    dtype : dtype
    make : callable
        Returns the map of a view.
    """

    rows: Ints
    size: tuple[int, ...]
    dtype: np.dtype[Any]
    make: Callable[[int], NDArray[Any]]

    @property
    def shape(self) -> tuple[int, ...]:
        """As of an array that holds all."""
        return (len(self.rows), *self.size)

    @property
    def ndim(self) -> int:
        """As of an array that holds all."""
        return len(self.shape)

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, key: Any, /) -> Any:
        if isinstance(key, int | np.integer):
            return self.make(int(self.rows[key]))
        return replace(self, rows=self.rows[key])

    def stored(self, folder: Path) -> NDArray[Any]:
        """Return the maps as an array in a plain file of a folder."""
        path = folder / f"maps{len(list(folder.glob('maps*')))}.npy"
        array = np.lib.format.open_memmap(path, "w+", self.dtype, self.shape)
        for row in range(len(self)):
            array[row] = self[row]
        return array
