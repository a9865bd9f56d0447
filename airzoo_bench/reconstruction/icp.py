"""Iterated closest points: a similarity refined between two clouds.

Open3D's ``registration_icp`` sums in the order in which its threads finish, so that the same clouds
give other last bits on every run; the loop is therefore here, over pykdtree, whose neighbours do
not depend on threads. The truth is searched in parts of a fixed size, whether or not they are kept
in memory, so that memory changes no neighbour.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from pykdtree.kdtree import KDTree

from airzoo_bench.formats.clouds.cloud import CloudSource
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.reconstruction.clouds import finite_pieces, finite_rows
from airzoo_bench.reconstruction.settings import Alignment as AlignmentSettings
from airzoo_bench.reconstruction.similarity import AlignmentError, Similarity, fit_many

_PART = 1 << 18


@dataclass(frozen=True)
class CloudFit:
    """How near one cloud is to another.

    The share of points with the other cloud within the limit, the root mean square distance of
    those, and that of all, each at most the limit: one figure for both.
    """

    fitness: float
    rmse: float
    cost: float

    @classmethod
    def summarise(cls, distances: Floats, limit: float) -> CloudFit:
        """Summarise distances (N,), infinite beyond the limit."""
        near = distances[np.isfinite(distances)]
        squared = float((near * near).sum())
        capped = squared + limit * limit * (len(distances) - len(near))
        rmse = float(np.sqrt(squared / len(near))) if len(near) else np.inf
        return cls(len(near) / len(distances), rmse, float(np.sqrt(capped / len(distances))))


@dataclass(frozen=True)
class IcpReport:
    """How near the clouds were before and after ICP, its rounds, and the points that it used."""

    before: CloudFit
    after: CloudFit
    iterations: int
    points: int


def refine(
    predicted: CloudSource, truth: CloudSource, settings: AlignmentSettings, *, memory_points: int
) -> tuple[Similarity, IcpReport]:
    """Find the similarity that brings a cloud in the frame of the truth nearer to it, by ICP."""
    limit = settings.icp_below_m
    points = draw_points(predicted, settings.icp_points, settings.seed)
    origin = next((part[0] for part in finite_pieces(truth, _PART) if len(part)), None)
    if not len(points) or origin is None:
        raise AlignmentError("ICP needs points in the prediction and in the truth")
    # Near zero: the tree works on offsets from a point of the truth.
    points = points - origin
    kept = list(_trees(truth, origin)) if truth.count <= memory_points else None

    def nearest(queries: Floats) -> tuple[Floats, Floats]:
        return _nearest(queries, _trees(truth, origin) if kept is None else kept, limit)

    transform = Similarity.identity()
    distances, partners = nearest(points)
    before = fit = CloudFit.summarise(distances, limit)
    if np.isfinite(distances).sum() < 3:
        raise AlignmentError(
            f"ICP has {np.isfinite(distances).sum()} of {len(distances)} predicted points within "
            f"{limit:g} of the truth",
            expected="clouds that overlap after the alignment by cameras",
            fix="check the poses, or choose an alignment without ICP",
        )
    rounds = 0
    while rounds < settings.icp_iterations:
        rounds += 1
        near = np.isfinite(distances)
        step = _step(points[near], partners[near], transform, settings.icp_with_scale)
        distances, found = nearest(step.apply(points))
        new = CloudFit.summarise(distances, limit)
        if not new.cost < fit.cost:
            break
        gain, transform, fit, partners = fit.cost - new.cost, step, new, found
        if gain < settings.icp_tolerance * fit.cost:
            break
    report = IcpReport(before, fit, rounds, len(points))
    if fit == before:
        return Similarity.identity(), report
    back, start = transform.translation + origin, transform.origin + origin
    return Similarity(transform.scale, transform.rotation, back, start), report


def draw_points(source: CloudSource, count: int, seed: int) -> Floats:
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


def _step(points: Floats, partners: Floats, transform: Similarity, with_scale: bool) -> Similarity:
    # Without scale the clouds are fitted as they are now: the scale of before stays.
    moved = transform.apply(points)
    (step,), (determined,) = fit_many(moved[None], partners[None], with_scale=with_scale)
    return step.after(transform) if determined else transform


def _trees(truth: CloudSource, origin: Floats) -> Iterator[tuple[Floats, Any]]:
    for part in finite_pieces(truth, _PART):
        if len(part):
            yield part - origin, KDTree(part - origin)


def _nearest(queries: Floats, trees: Any, limit: float) -> tuple[Floats, Floats]:
    """Find the nearest true points (N, 3) and their distances (N,), infinite beyond the limit."""
    distances, partners = np.full(len(queries), np.inf), np.full_like(queries, np.nan)
    for points, tree in trees:
        low, high = points.min(axis=0) - limit, points.max(axis=0) + limit
        rows = np.flatnonzero(((queries >= low) & (queries <= high)).all(axis=1))
        if not len(rows):
            continue
        _, index = tree.query(queries[rows], distance_upper_bound=limit)
        inside = index < len(points)
        rows, there = rows[inside], points[index[inside]]
        offset = queries[rows] - there
        found = np.sqrt((offset * offset).sum(axis=1))
        # The tree compares rounded squares: what it let through at the limit is cut here.
        nearer = (found <= limit) & (found < distances[rows])
        distances[rows[nearer]], partners[rows[nearer]] = found[nearer], there[nearer]
    return distances, partners
