"""Point clouds: what every reader yields and every step takes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats

__all__ = ["Cloud", "CloudSource"]


@dataclass(frozen=True, eq=False)
class Cloud:
    """N points, in memory.

    Attributes
    ----------
    points : (N, 3) float64
        World coordinates, in the scene's units.
    colours : (N, 3) uint8 or None
    confidence : (N,) float32 or None
    """

    points: Floats
    colours: NDArray[np.uint8] | None = None
    confidence: NDArray[np.float32] | None = None

    def __len__(self) -> int:
        return len(self.points)


class CloudSource(Protocol):
    """A cloud that is read in pieces, as often as asked, always in the same order."""

    @property
    def count(self) -> int:
        """How many points it holds, those with NaN included."""

    def pieces(self, points: int) -> Iterator[Cloud]:
        """Yield all points, at most so many at a time."""
