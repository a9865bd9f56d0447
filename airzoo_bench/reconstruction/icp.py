"""Refining an alignment by iterated closest points.

Open3D's registration_icp sums in the order in which its threads finish, so that the same clouds
give other last bits on every run; neighbours of pykdtree do not depend on threads.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from pykdtree.kdtree import KDTree

from airzoo_bench.formats.clouds.cloud import CloudSource
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.reconstruction.alignment import AlignmentError, Similarity, fit_sim3
from airzoo_bench.reconstruction.clouds import finite_pieces, finite_rows, gather_points
from airzoo_bench.reconstruction.settings import AlignmentSettings

_PART = 1 << 18  # points of a cloud at a time


def refine(
    predicted: CloudSource, truth: CloudSource, settings: AlignmentSettings, *, memory_points: int
) -> tuple[Similarity, dict[str, Any]]:
    """Find the similarity that brings a cloud in the frame of the truth nearer to it, by ICP.

    The report has the rounds, the points used, and how near the clouds were before and after: the
    share of points with the other cloud within the limit (fitness), the root mean square distance
    of those (rmse), and that of all, each at most the limit (cost).
    """
    limit = settings.icp_below_m
    points = draw_points(predicted, settings.icp_points, settings.seed)
    origin = next((part[0] for part in finite_pieces(truth, _PART) if len(part)), None)
    if not len(points) or origin is None:
        raise AlignmentError("ICP needs points in the prediction and in the truth")
    # Near zero: the tree works on offsets from a point of the truth.
    points, near_zero = points - origin, (part - origin for part in finite_pieces(truth, _PART))
    targets = gather_points(near_zero, on_disk=truth.count > memory_points)
    tree = KDTree(targets)

    def nearest(queries: Floats) -> tuple[Floats, Floats]:
        _, index = tree.query(queries, distance_upper_bound=limit)
        there = targets[np.minimum(index, len(targets) - 1)]
        offset = queries - there
        away = np.sqrt((offset * offset).sum(axis=1))
        # The tree compares rounded squares, and may let through more than the limit.
        away[(index >= len(targets)) | (away > limit)] = np.inf
        return away, there

    transform, rounds = Similarity.identity(), 0
    distances, partners = nearest(points)
    before = fit = _fit_of(distances, limit)
    if np.isfinite(distances).sum() < 3:
        raise AlignmentError("ICP has fewer than 3 predicted points within its limit of the truth")
    while rounds < settings.icp_iterations:
        rounds += 1
        near = np.isfinite(distances)
        # Without scale, the clouds are fitted as they are now: the scale of before stays.
        moved, with_scale = transform.apply(points[near]), settings.icp_with_scale
        (step,), (determined,) = fit_sim3(moved[None], partners[near][None], with_scale=with_scale)
        step = step.after(transform) if determined else transform
        distances, nearest_now = nearest(step.apply(points))
        new = _fit_of(distances, limit)
        gain = fit["cost"] - new["cost"]
        if not gain > 0.0:
            break
        transform, fit, partners = step, new, nearest_now
        if gain < settings.icp_tolerance * new["cost"]:
            break
    report = {"before": before, "after": fit, "iterations": rounds, "points": len(points)}
    if fit == before:
        return transform, report
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


def _fit_of(distances: Floats, limit: float) -> dict[str, float]:
    near = distances[np.isfinite(distances)]
    squared = float((near * near).sum())
    capped = squared + limit * limit * (len(distances) - len(near))
    rmse = float(np.sqrt(squared / len(near))) if len(near) else np.inf
    cost = float(np.sqrt(capped / len(distances)))
    return {"fitness": len(near) / len(distances), "rmse": rmse, "cost": cost}
