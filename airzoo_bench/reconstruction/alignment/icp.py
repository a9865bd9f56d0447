"""Iterated closest points: a similarity refined between two clouds.

The library's own solver (Open3D's ``registration_icp``) sums in the order in which its threads
finish, so that the same clouds give other last bits on every run; the loop is therefore here, over
pykdtree, whose neighbours do not depend on threads. The truth is searched in parts of a fixed size,
whether or not they are kept in memory, so that memory changes no neighbour.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from airzoo_bench.formats.clouds.cloud import CloudSource
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.reconstruction.alignment.similarity import AlignmentError, Similarity, fit_many
from airzoo_bench.reconstruction.cloud_sources import finite_pieces, finite_rows

__all__ = ["CloudFit", "IcpReport", "IcpSettings", "drawn", "refine"]

_PART = 1 << 18


@dataclass(frozen=True)
class IcpSettings:
    """How two clouds are brought together.

    Attributes
    ----------
    max_points : int
        Predicted points that are used, drawn with the seed; the truth is used whole.
    max_distance : float
        Points of the prediction count where the truth is within it, in units of the truth.
    max_iterations : int
    tolerance : float
        The loop ends where the cost falls by less than this share of it.
    with_scale : bool
        Refine the scale too.
    seed : int
    """

    max_points: int
    max_distance: float
    max_iterations: int
    tolerance: float
    with_scale: bool
    seed: int


@dataclass(frozen=True)
class CloudFit:
    """How near one cloud is to another.

    Attributes
    ----------
    fitness : float
        Share of the points with the other cloud within the limit.
    rmse : float
        Root mean square distance of those; infinite where there are none.
    cost : float
        Root mean square distance of all points, each at most the limit: one figure for both.
    """

    fitness: float
    rmse: float
    cost: float


@dataclass(frozen=True)
class IcpReport:
    """What ICP did.

    Attributes
    ----------
    before, after : CloudFit
        Of the transform that it began with, and of the one returned.
    iterations : int
    points : int
        Predicted points that were used.
    """

    before: CloudFit
    after: CloudFit
    iterations: int
    points: int


def refine(
    predicted: CloudSource, truth: CloudSource, settings: IcpSettings, *, memory_points: int
) -> tuple[Similarity, IcpReport]:
    """Find the similarity that brings a cloud in the frame of the truth nearer to it, by ICP."""
    points = drawn(predicted, settings.max_points, settings.seed)
    origin = next((part[0] for part in finite_pieces(truth, _PART) if len(part)), None)
    if not len(points) or origin is None:
        raise AlignmentError("ICP needs points in the prediction and in the truth")
    # Near zero: the tree works on offsets from a point of the truth.
    points = points - origin
    nearest = _Nearest(truth, origin, settings.max_distance, in_memory=truth.count <= memory_points)
    transform = Similarity.identity()
    distances, partners = nearest(points)
    before = fit = _cloud_fit(distances, settings.max_distance)
    _require_overlap(distances, settings.max_distance)
    rounds = 0
    while rounds < settings.max_iterations:
        rounds += 1
        step = _step(points, partners, np.isfinite(distances), settings.with_scale, transform)
        distances, found = nearest(step.apply(points))
        new = _cloud_fit(distances, settings.max_distance)
        if not new.cost < fit.cost:
            break
        gain, transform, fit, partners = fit.cost - new.cost, step, new, found
        if gain < settings.tolerance * fit.cost:
            break
    report = IcpReport(before, fit, rounds, len(points))
    if fit == before:
        return Similarity.identity(), report
    back, start = transform.translation + origin, transform.origin + origin
    return Similarity(transform.scale, transform.rotation, back, start), report


def drawn(source: CloudSource, count: int, seed: int) -> Floats:
    """Draw at most `count` of the finite points of a cloud, kept in their order."""
    random = np.random.default_rng(seed)
    points, keys = np.zeros((0, 3)), np.zeros(0)
    for piece in source.pieces(_PART):
        finite = finite_rows(piece.points)
        points = np.concatenate((points, piece.points[finite]))
        keys = np.concatenate((keys, random.random(len(piece))[finite]))
        if len(keys) > count:
            kept = np.sort(np.argpartition(keys, count)[:count])
            points, keys = points[kept], keys[kept]
    return points


class _Nearest:
    """Distances to the nearest point within a limit, infinite beyond, and that point."""

    def __init__(
        self, truth: CloudSource, origin: Floats, limit: float, *, in_memory: bool
    ) -> None:
        self._truth, self._origin, self._limit = truth, origin, limit
        self._points = list(self._read()) if in_memory else None

    def __call__(self, queries: Floats) -> tuple[Floats, Floats]:
        distances, partners = np.full(len(queries), np.inf), np.full_like(queries, np.nan)
        for points, tree in self._read() if self._points is None else self._points:
            self._improve(queries, points, tree, distances, partners)
        return distances, partners

    def _read(self) -> Iterator[tuple[Floats, Any]]:
        from pykdtree.kdtree import KDTree

        for part in finite_pieces(self._truth, _PART):
            if len(part):
                near_zero = part - self._origin
                yield near_zero, KDTree(near_zero)

    def _improve(
        self, queries: Floats, points: Floats, tree: Any, distances: Floats, partners: Floats
    ) -> None:
        low, high = points.min(axis=0) - self._limit, points.max(axis=0) + self._limit
        rows = np.flatnonzero(((queries >= low) & (queries <= high)).all(axis=1))
        if not len(rows):
            return
        _, index = tree.query(queries[rows], distance_upper_bound=self._limit)
        inside = index < len(points)
        rows, there = rows[inside], points[index[inside]]
        offset = queries[rows] - there
        found = np.sqrt((offset * offset).sum(axis=1))
        # The tree compares rounded squares: what it let through at the limit is cut here.
        nearer = (found <= self._limit) & (found < distances[rows])
        distances[rows[nearer]], partners[rows[nearer]] = found[nearer], there[nearer]


def _step(
    points: Floats, partners: Floats, near: Bools, with_scale: bool, transform: Similarity
) -> Similarity:
    # Without scale the clouds are fitted as they are now: the scale of before stays.
    moved = transform.apply(points[near])
    (step,), (determined,) = fit_many(moved[None], partners[None, near], with_scale=with_scale)
    return step.after(transform) if determined else transform


def _cloud_fit(distances: Floats, limit: float) -> CloudFit:
    near = distances[np.isfinite(distances)]
    squared = float((near * near).sum())
    capped = squared + limit * limit * (len(distances) - len(near))
    return CloudFit(
        fitness=len(near) / len(distances),
        rmse=float(np.sqrt(squared / len(near))) if len(near) else np.inf,
        cost=float(np.sqrt(capped / len(distances))),
    )


def _require_overlap(distances: Floats, limit: float) -> None:
    near = int(np.isfinite(distances).sum())
    if near < 3:
        raise AlignmentError(
            f"ICP has {near} of {len(distances)} predicted points within {limit:g} of the truth",
            expected="clouds that overlap after the alignment by cameras",
            fix="check the poses, or choose an alignment without ICP",
        )
