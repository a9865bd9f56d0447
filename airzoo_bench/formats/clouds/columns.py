"""What the columns of a table without names hold: places first, then perhaps colours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.formats.clouds.cloud import Cloud, as_colours, as_confidence
from airzoo_bench.geometry.arrays import Floats

__all__ = ["Columns", "columns_by_name", "columns_of_sample"]

_XYZ = (("x", "easting"), ("y", "northing"), ("z", "height", "elevation", "altitude"))
_COLOURS = (("r", "red"), ("g", "green"), ("b", "blue"))
_CONFIDENCE = ("confidence", "conf")


@dataclass(frozen=True)
class Columns:
    """Which columns of a table are what, counted from 0.

    Attributes
    ----------
    width : int
    xyz : tuple of int
    colours : tuple of int, or None
    bright : float
        What the brightest colour is: 255, 1 or 65535.
    confidence : int or None
    """

    width: int
    xyz: tuple[int, ...] = (0, 1, 2)
    colours: tuple[int, ...] | None = None
    bright: float = 255.0
    confidence: int | None = None

    def cloud(self, rows: NDArray[Any]) -> Cloud:
        """Return the points of rows (N, width)."""
        colours = confidence = None
        if self.colours is not None:
            colours = as_colours(*(rows[:, place] / self.bright for place in self.colours))
        if self.confidence is not None:
            confidence = as_confidence(rows[:, self.confidence])
        points: Floats = rows[:, list(self.xyz)].astype(np.float64)
        return Cloud(points, colours, confidence)

    def note(self) -> str:
        """Say what was taken to be what, with columns counted from 1."""
        taken = {"x y z": self.xyz, "red green blue": self.colours}
        if self.confidence is not None:
            taken["confidence"] = (self.confidence,)
        said = [
            f"{what} from {', '.join(str(place + 1) for place in places)}"
            for what, places in taken.items()
            if places is not None
        ]
        left = self.width - sum(len(places) for places in taken.values() if places is not None)
        passed = [f"{left} of {self.width} passed over"] if left else []
        return f"columns, counted from 1: {'; '.join(said + passed)}"


def columns_by_name(names: list[str], sample: NDArray[Any]) -> Columns | None:
    """Find the columns by their names, whatever their case; None where x, y or z is missing."""
    lower = [name.lower() for name in names]
    xyz = _places(lower, _XYZ)
    if xyz is None:
        return None
    colours = _places(lower, _COLOURS)
    bright = None if colours is None else _bright(sample[:, list(colours)])
    confidence = next((lower.index(name) for name in _CONFIDENCE if name in lower), None)
    return Columns(
        len(names), xyz, None if bright is None else colours, bright or 255.0, confidence
    )


def columns_of_sample(sample: NDArray[Any], *, intensity_first: bool = False) -> Columns:
    """Guess the columns of rows (N, width) without names: x, y, z, perhaps intensity, colours."""
    width = sample.shape[1]
    behind = [3, 4] if width == 7 else [3] if width >= 6 else []
    for first in reversed(behind) if intensity_first else behind:
        places = (first, first + 1, first + 2)
        if _bright(sample[:, list(places)]) == 255.0:
            return Columns(width, colours=places)
    return Columns(width)


def _places(names: list[str], wanted: tuple[tuple[str, ...], ...]) -> tuple[int, ...] | None:
    found = [next((names.index(name) for name in some if name in names), None) for some in wanted]
    places = tuple(place for place in found if place is not None)
    return places if len(places) == len(wanted) else None


def _bright(colours: NDArray[Any]) -> float | None:
    """Return what the brightest of colours (N, 3) would be; None where they are no colours."""
    if not (np.isfinite(colours).all() and (colours >= 0.0).all()):
        return None
    if (colours != np.rint(colours)).any():
        return 1.0 if (colours <= 1.0).all() else None
    most = colours.max(initial=0.0)
    return next((bright for bright in (255.0, 65535.0) if most <= bright), None)
