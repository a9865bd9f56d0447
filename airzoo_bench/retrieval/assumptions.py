"""Ways in which the assumed values of a truth may be off, and queries that are off by them."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.benchmark.queries import FOCAL_COLUMNS, POSE_COLUMNS, SIZE_COLUMNS, poses_of
from airzoo_bench.geometry.rotations import matrix_to_quaternion
from airzoo_bench.results.sensitivity import TOGETHER

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["AssumedRanges", "Variant", "moved_queries", "variants_of"]


@dataclass(frozen=True)
class AssumedRanges:
    """How far the assumed values of a truth may be off, either way; 0 leaves one alone.

    Attributes
    ----------
    field_of_view : float
        Share of the angle, across and along alike.
    heading_deg, height_m : float
        Of all photos of a scene alike: the turn about the vertical, the height above the ground.
    position_m : float
        Standard deviation of the error of each photo's position, east and north, by itself.
    """

    field_of_view: float = 0.0
    heading_deg: float = 0.0
    height_m: float = 0.0
    position_m: float = 0.0

    @property
    def given(self) -> dict[str, float]:
        """The ranges that are not 0, by name."""
        every = {item.name: getattr(self, item.name) for item in fields(self)}
        return {name: value for name, value in every.items() if value}


@dataclass(frozen=True)
class Variant:
    """One way in which the assumed values are off.

    Attributes
    ----------
    group : str
        The field of `AssumedRanges` that it is of, or `TOGETHER`.
    by : AssumedRanges
        By how much each value is off; `position_m` is a standard deviation, the others have signs.
    draw : int
        Which of the random draws of positions.
    """

    group: str
    by: AssumedRanges
    draw: int = 0


def variants_of(ranges: AssumedRanges, draws: int, seed: int) -> list[Variant]:
    """Return both ends of each range, draws of positions, and draws of all at once."""
    given, none = ranges.given, AssumedRanges()
    found = [
        Variant(name, replace(none, **{name: sign * value}))
        for name, value in given.items()
        if name != "position_m"
        for sign in (-1.0, 1.0)
    ]
    found += [
        Variant("position_m", AssumedRanges(position_m=ranges.position_m), draw)
        for draw in range(draws * bool(ranges.position_m))
    ]
    random = np.random.default_rng(seed)
    for draw in range(draws * (len(given) > 1)):
        off = random.uniform(-1.0, 1.0, 3).tolist()
        by = AssumedRanges(
            ranges.field_of_view * off[0],
            ranges.heading_deg * off[1],
            ranges.height_m * off[2],
            ranges.position_m,
        )
        found.append(Variant(TOGETHER, by, draws + draw))
    return found


def moved_queries(queries: pd.DataFrame, variant: Variant, seed: int) -> pd.DataFrame:
    """Return the queries with cameras and poses that are off."""
    by, poses = variant.by, poses_of(queries)
    sizes = queries[list(SIZE_COLUMNS)].to_numpy(np.float64)
    focal = queries[list(FOCAL_COLUMNS)].to_numpy(np.float64)
    half = np.arctan(sizes / 2 / focal) * (1.0 + by.field_of_view)
    turn = np.radians(by.heading_deg)
    sine, cosine = np.sin(turn), np.cos(turn)
    # Of the camera, clockwise seen from above: of the world, the other way round.
    clockwise = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    centres = poses.centres + np.array([0.0, 0.0, by.height_m])
    if by.position_m:
        # Queries are sorted by id, so that a photo's error does not depend on the order of files.
        random = np.random.default_rng((seed, variant.draw))
        centres[:, :2] += random.normal(0.0, by.position_m, (len(queries), 2))
    numbers = np.concatenate([matrix_to_quaternion(poses.rotation @ clockwise), centres], axis=1)
    moved = queries.copy()
    moved[list(FOCAL_COLUMNS)] = sizes / 2 / np.tan(half)
    moved[list(POSE_COLUMNS)] = numbers
    return moved
