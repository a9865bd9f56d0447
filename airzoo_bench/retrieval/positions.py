"""Distances between the positions that a benchmark gives of its images, by its own formulas."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import geodesic_distance_m

__all__ = ["Between", "degrees_apart", "distances_of", "farthest", "metres_apart"]

Between = Callable[[Floats, Floats], Floats]
"""Takes positions (..., 2) of queries and of images, and returns distances (...)."""

_EQUATOR_M = 6378137.0
_CELLS = 1 << 20


def metres_apart(measure: Literal["sphere", "ellipsoid", "plane"]) -> Between:
    """Return how metres are measured."""
    by_name: dict[str, Between] = {
        "sphere": _great_circle,
        "ellipsoid": geodesic_distance_m,
        "plane": _straight,
    }
    return by_name[measure]


def degrees_apart(queries: Floats, images: Floats) -> Floats:
    """Distance in degrees as DenseUAV has it: of longitude and latitude alike, in float32."""
    single = queries.astype(np.float32), images.astype(np.float32)
    return _straight(single[0].astype(np.float64), single[1].astype(np.float64))


def distances_of(
    between: Between, positions: tuple[Floats, Floats], ranked: NDArray[np.int32]
) -> Floats:
    """Return the distance (Q, K) from queries to ranked images; infinite where there is none."""
    queries, images = positions
    found = between(queries[:, None], images[ranked])
    return np.where(ranked >= 0, found, np.inf)


def farthest(between: Between, positions: tuple[Floats, Floats]) -> Floats:
    """Return the distance (Q,) from each query to the image that is farthest from it."""
    queries, images = positions
    step = max(1, _CELLS // max(len(images), 1))
    parts = [
        between(queries[start : start + step, None], images[None]).max(axis=1)
        for start in range(0, len(queries), step)
    ]
    return np.concatenate([np.zeros(0), *parts])


def _straight(queries: Floats, images: Floats) -> Floats:
    found: Floats = np.hypot(*np.moveaxis(images - queries, -1, 0))
    return found


def _great_circle(queries: Floats, images: Floats) -> Floats:
    (lon_a, lat_a), (lon_b, lat_b) = (np.moveaxis(np.radians(p), -1, 0) for p in (queries, images))
    across = np.cos(lat_a) * np.cos(lat_b) * np.sin((lon_a - lon_b) / 2) ** 2
    haversine = np.sin((lat_a - lat_b) / 2) ** 2 + across
    metres: Floats = 2 * _EQUATOR_M * np.arcsin(np.sqrt(np.minimum(haversine, 1.0)))
    return metres
