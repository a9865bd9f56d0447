"""What a pose solver answers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from airzoo_bench.core.shown import Shown, number
from airzoo_bench.geometry.arrays import Bools, Floats, apply_matrix

__all__ = ["PoseEstimate", "Status"]


class Status(StrEnum):
    """How the search for a pose ended."""

    SOLVED = "solved"
    TOO_FEW_MATCHES = "too few matches"
    NO_POSE = "no pose"


@dataclass(frozen=True, eq=False, repr=False)
class PoseEstimate(Shown):
    """The answer of a solver for one query of M matches.

    Attributes
    ----------
    rotation : (3, 3) array
        World-to-camera; NaN on failure.
    centre : (3,) array
        Camera centre in the coordinates of the points; NaN on failure.
    inliers : (M,) bool array
        Matches that the pose explains; none on failure.
    status : Status
        A failure is anything but ``SOLVED``.
    left_out : int
        Matches beyond `max_matches`, which were not used.
    seconds : float
        Spent on it; the one thing that differs from run to run.
    """

    rotation: Floats
    centre: Floats
    inliers: Bools
    status: Status
    left_out: int = 0
    seconds: float = 0.0

    @property
    def matrix(self) -> Floats:
        """The pose [R | t], (3, 4), world-to-camera; NaN on failure."""
        return np.column_stack([self.rotation, -apply_matrix(self.rotation, self.centre)])

    def _shown(self) -> Mapping[str, object]:
        inliers = f"{int(self.inliers.sum())} of {len(self.inliers)}"
        centre = ", ".join(map(number, self.centre.tolist()))
        return {"status": self.status.value, "inliers": inliers, "centre": centre}
