"""Finite points, and the part of a cloud that lies in a region."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.geometry.arrays import Bools, Floats

__all__ = ["Box", "bounding_box", "finite_rows", "take"]

_ENDLESS = 1e150


@dataclass(frozen=True, eq=False)
class Box:
    """A box along the axes, borders included.

    Attributes
    ----------
    low, high : (3,) float64
    """

    low: Floats
    high: Floats

    def grown(self, margin: float) -> Box:
        """Return the box with its sides moved outwards by `margin`."""
        return Box(self.low - margin, self.high + margin)

    def joined(self, other: Box) -> Box:
        """Return the smallest box that holds both."""
        return Box(np.minimum(self.low, other.low), np.maximum(self.high, other.high))

    def holds(self, points: Floats) -> Bools:
        """Whether each of points (N, 3) lies in the box or on its border."""
        inside: Bools = np.all((points >= self.low) & (points <= self.high), axis=1)
        return inside


def bounding_box(points: Floats) -> Box:
    """Smallest box that holds points (N, 3), finite.

    Raises
    ------
    ValueError
        No points.
    """
    if len(points) == 0:
        raise ValueError("no points to put a box around")
    return Box(points.min(axis=0), points.max(axis=0))


def finite_rows(points: Floats) -> Bools:
    """Whether each of points (N, 3) has coordinates whose squares are numbers."""
    finite: Bools = np.all(np.abs(points) < _ENDLESS, axis=1)
    return finite


def take(cloud: Cloud, rows: Bools | slice) -> Cloud:
    """Return some of the points, with their colours and confidences: a mask (N,), or a slice."""
    return Cloud(
        cloud.points[rows],
        None if cloud.colours is None else cloud.colours[rows],
        None if cloud.confidence is None else cloud.confidence[rows],
    )
