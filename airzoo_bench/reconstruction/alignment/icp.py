"""Iterated closest points: a similarity refined between two clouds.

The library's own solver (Open3D's ``registration_icp``) sums in the order in which its threads
finish, so that the same clouds give other last bits on every run; the loop is therefore here, over
pykdtree, whose neighbours do not depend on threads.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.reconstruction.alignment.similarity import AlignmentError, Similarity, fit_many

__all__ = ["CloudFit", "IcpReport", "IcpSettings", "refine", "subsample"]


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
    predicted: Floats, truth: Floats, start: Similarity, settings: IcpSettings
) -> tuple[Similarity, IcpReport]:
    """Refine a similarity by point-to-point ICP.

    Each round fits the similarity to the pairs within the limit, which can only lower the cost;
    where rounding raises it nonetheless, the transform before is kept. With scale a cloud that
    overlaps little may shrink: the report shows the fit before and after.

    Parameters
    ----------
    predicted : (N, 3) array
        In the prediction's frame.
    truth : (M, 3) array
    start : Similarity
        From the prediction's frame to the truth's.
    settings : IcpSettings

    Returns
    -------
    transform : Similarity
    report : IcpReport

    Raises
    ------
    AlignmentError
        Either cloud is empty, or fewer than 3 points of the prediction are within the limit.

    References
    ----------
    Besl and McKay, A method for registration of 3-D shapes, PAMI 14(2), 1992.
    """
    if not (len(predicted) and len(truth)):
        raise AlignmentError("ICP needs points in the prediction and in the truth")
    points = subsample(predicted, settings.max_points, settings.seed)
    origin = truth[0]
    nearest = _Nearest(truth - origin, settings.max_distance)
    # From here on near zero: the tree works on offsets from a point of the truth.
    transform = Similarity(start.scale, start.rotation, start.translation - origin, start.origin)
    distances, partners = nearest(transform.apply(points))
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
    back = transform.translation + origin
    refined = Similarity(transform.scale, transform.rotation, back, transform.origin)
    if rounds == 0 or fit == before:
        refined = start
    return refined, IcpReport(before, fit, rounds, len(points))


def subsample(points: Floats, count: int, seed: int) -> Floats:
    """Draw at most `count` of the points (N, 3), kept in their order."""
    if len(points) <= count:
        return points
    rows = np.random.default_rng(seed).choice(len(points), count, replace=False)
    return points[np.sort(rows)]


class _Nearest:
    """Distances to the nearest point within a limit, infinite beyond, and that point."""

    def __init__(self, points: Floats, limit: float) -> None:
        from pykdtree.kdtree import KDTree

        self._points = points
        self._tree = KDTree(points)
        self._limit = limit

    def __call__(self, queries: Floats) -> tuple[Floats, Floats]:
        _, rows = self._tree.query(queries, distance_upper_bound=self._limit)
        inside = rows < len(self._points)
        partners = np.full_like(queries, np.nan)
        partners[inside] = self._points[rows[inside]]
        offset = queries - partners
        distances = np.sqrt((offset * offset).sum(axis=1))
        # The tree compares rounded squares: what it let through at the limit is cut here.
        distances[~inside | (distances > self._limit)] = np.inf
        return distances, partners


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
            mend="check the poses, or choose an alignment without ICP",
        )
