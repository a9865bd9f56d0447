"""Which columns of a table are x, y, z and confidence; others are passed over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.formats.clouds.cloud import Cloud, as_confidence

__all__ = ["Columns", "columns_by_name"]

_XYZ = (("x", "easting"), ("y", "northing"), ("z", "height", "elevation", "altitude"))
_CONFIDENCE = ("confidence", "conf")


@dataclass(frozen=True)
class Columns:
    """Columns of a table of `width`, counted from 0."""

    width: int
    xyz: tuple[int, ...] = (0, 1, 2)
    confidence: int | None = None

    def cloud(self, rows: NDArray[Any]) -> Cloud:
        """Return the points of rows (N, width)."""
        trust = None if self.confidence is None else as_confidence(rows[:, self.confidence])
        return Cloud(rows[:, list(self.xyz)].astype(np.float64), None, trust)

    def note(self) -> str:
        """Say which columns were read, counted from 1."""
        said = "x y z from " + ", ".join(str(place + 1) for place in self.xyz)
        left = self.width - 3
        if self.confidence is not None:
            said, left = f"{said}; confidence from {self.confidence + 1}", left - 1
        passed = f"; {left} of {self.width} passed over" if left else ""
        return f"columns, counted from 1: {said}{passed}"


def columns_by_name(names: list[str]) -> Columns | None:
    """Find the columns by their names, whatever their case; None where x, y or z is missing."""
    lower = [name.lower() for name in names]
    found = [next((lower.index(name) for name in some if name in lower), None) for some in _XYZ]
    xyz = tuple(place for place in found if place is not None)
    trust = next((lower.index(name) for name in _CONFIDENCE if name in lower), None)
    return Columns(len(names), xyz, trust) if len(xyz) == len(_XYZ) else None
