"""Thinning a flight to key frames whose neighbours share as much ground as is asked.

What a frame sees of the ground is its footprint on a level plane, as far as 400 m in depth along
the optical axis: beyond, an oblique view goes on to the horizon. The overlap of two frames is the
area that their footprints share over the area of the smaller: the same in both directions of
flight, and 1 where one sees all that the other sees.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from airzoo_bench.core.errors import UsageError
from airzoo_bench.datasets.mini.flights.trajectory import Trajectory, trajectory_poses
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.cameras import Cameras, anchor_pixels, back_project
from airzoo_bench.geometry.poses import Poses, rays_to_world

__all__ = ["footprints", "key_frames", "overlaps"]

_MOST_DEPTH_M = 400.0
# Frames looked at together in search of the next key frame.
_BLOCK = 64


def key_frames(
    trajectory: Trajectory, camera: Cameras, ground_height: float, overlap: float
) -> Ints:
    """Choose key frames so that each overlaps the one before as is asked, above 0 and below 1."""
    if not 0.0 < overlap < 1.0:
        raise UsageError(
            f"key frames with an overlap of {overlap:g}", expected="above 0 and below 1"
        )
    seen = footprints(camera, trajectory_poses(trajectory), ground_height)
    usable = np.flatnonzero(shapely.area(seen) > 0.0)
    kept = list(range(min(1, len(usable))))
    while kept and (following := _next(seen[usable], kept[-1], overlap)) is not None:
        kept.append(following)
    return usable[kept].astype(np.int64)


def overlaps(a: ArrayLike, b: ArrayLike) -> Floats:
    """Return the overlap of footprints (N,), which broadcast; 0 where one has no area."""
    smaller = np.minimum(shapely.area(a), shapely.area(b))
    shared = shapely.area(shapely.intersection(a, b))
    share = np.divide(shared, smaller, out=np.zeros_like(shared), where=smaller > 0.0)
    return np.asarray(np.minimum(share, 1.0), dtype=np.float64)


def footprints(
    camera: Cameras, poses: Poses, ground_height: float, most_depth_m: float = _MOST_DEPTH_M
) -> NDArray[np.object_]:
    """Return what N frames see of a level plane, no deeper than some metres."""
    rays = back_project(camera, anchor_pixels(camera, 0.0))
    corners = rays_to_world(poses, rays / rays[..., 2:])
    above = poses.centres[:, 2] - ground_height
    # Depth at which the ray of a pixel meets the ground is above / fall; both are to be positive.
    ends, seen = _cut(corners, -corners[..., 2] - above[:, None] / most_depth_m)
    seen &= (above > 0.0)[:, None]
    depth = above[:, None] / np.where(seen, -ends[..., 2], 1.0)
    offset = poses.centres[:, :2] - poses.centres[0, :2]
    places = ends[..., :2] * depth[..., None] + offset[:, None]
    hulls = np.full(len(places), shapely.Polygon(), dtype=object)
    some = seen.any(axis=1)
    if some.any():
        frame, _ = np.nonzero(seen[some])
        points = shapely.multipoints(shapely.points(places[seen]), indices=frame)
        hulls[some] = shapely.convex_hull(points)
    return hulls


def _cut(corners: Floats, spare: Floats) -> tuple[Floats, Bools]:
    """Cut the sides of quadrilaterals to where `spare` is not negative."""
    after, spare_after = np.roll(corners, -1, axis=1), np.roll(spare, -1, axis=1)
    rise = spare_after - spare
    zero = np.divide(-spare, rise, out=np.zeros_like(rise), where=rise != 0.0)
    start = np.where(spare < 0.0, zero, 0.0)[..., None]
    stop = np.where(spare_after < 0.0, zero, 1.0)[..., None]
    side = after - corners
    ends = np.concatenate((corners + start * side, corners + stop * side), axis=1)
    seen = (spare >= 0.0) | (spare_after >= 0.0)
    return ends, np.concatenate((seen, seen), axis=1)


def _next(seen: NDArray[np.object_], current: int, overlap: float) -> int | None:
    """Return the key frame after a key frame; None where the flight ends before it."""
    before = 1.0
    for start in range(current + 1, len(seen), _BLOCK):
        shared = overlaps(seen[current], seen[start : start + _BLOCK])
        below = np.flatnonzero(shared < overlap)
        if below.size:
            first = int(below[0])
            last_above = before if first == 0 else float(shared[first - 1])
            nearer = last_above - overlap < overlap - float(shared[first])
            # The frame after the current one is taken even where it shares less.
            return max(start + first - int(nearer), current + 1)
        before = float(shared[-1])
    return None
