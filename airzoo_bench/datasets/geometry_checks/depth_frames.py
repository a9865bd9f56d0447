"""Frames with depth: read on demand, sampled by a seed, and paired for comparison."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.datasets.geometry_checks.depth_maps import DepthKind, read_depth
from airzoo_bench.geometry.arrays import Floats, Ints, apply_matrix
from airzoo_bench.geometry.cameras import Cameras, back_project, project
from airzoo_bench.geometry.poses import Poses, world_to_camera

__all__ = ["Frame", "FrameStore", "PairRule", "Sampling", "choose_pairs", "shared_views"]

_CACHE_BYTES = 256 << 20


@dataclass(frozen=True)
class Sampling:
    """How depths are read and sampled.

    Attributes
    ----------
    pixels : int
        Sampled of each frame; all where it has fewer.
    seed : int
    kind : DepthKind
    scale_m : float or None
        See `depth_maps.read_depth`.
    """

    pixels: int = 4096
    seed: int = 0
    kind: DepthKind = DepthKind.Z
    scale_m: float | None = None


@dataclass(frozen=True, eq=False)
class Frame:
    """A photo's camera, pose and depth.

    Attributes
    ----------
    camera : Cameras
        Of length 1.
    rotation : (3, 3) array
        World-to-camera.
    centre : (3,) array
    depth : (height, width) float32 array
        As stored, of `kind`; NaN where there is none.
    kind : DepthKind
    points : (S, 3) array
        The sampled pixels that have a depth, back-projected, in the camera's frame.
    """

    camera: Cameras
    rotation: Floats
    centre: Floats
    depth: NDArray[np.float32]
    kind: DepthKind
    points: Floats

    @property
    def world_points(self) -> Floats:
        """The sampled points (S, 3) in the world."""
        return apply_matrix(self.rotation.T, self.points) + self.centre


class FrameStore:
    """N frames, read on demand and cached in up to 256 MiB.

    Parameters
    ----------
    cameras, poses : Cameras, Poses
    depths : sequence of N Path
    sampling : Sampling
    """

    def __init__(
        self, cameras: Cameras, poses: Poses, depths: Sequence[Path], sampling: Sampling
    ) -> None:
        self.cameras, self.poses, self.depths = cameras, poses, depths
        self.sampling = sampling
        self._kept: OrderedDict[int, Frame] = OrderedDict()

    def __len__(self) -> int:
        return len(self.depths)

    def __reduce__(self) -> tuple[type[FrameStore], tuple[object, ...]]:
        # Without what is cached: another process reads what it needs.
        return FrameStore, (self.cameras, self.poses, self.depths, self.sampling)

    def frame(self, index: int) -> Frame:
        """Return a frame, reading it unless it is cached."""
        frame = self._kept.pop(index, None) or self._read(index)
        self._kept[index] = frame
        sizes = [f.depth.nbytes + f.points.nbytes for f in self._kept.values()]
        while len(sizes) > 2 and sum(sizes) > _CACHE_BYTES:
            self._kept.popitem(last=False)
            del sizes[0]
        return frame

    def _read(self, index: int) -> Frame:
        camera, pose = self.cameras.take(index), self.poses.take(index)
        width, height = int(camera.width[0]), int(camera.height[0])
        depth = read_depth(self.depths[index], width, height, self.sampling.scale_m)
        points = _sampled_points(camera, depth, index, self.sampling)
        return Frame(camera, pose.rotation[0], pose.centres[0], depth, self.sampling.kind, points)


def _sampled_points(
    camera: Cameras, depth: NDArray[np.float32], index: int, sampling: Sampling
) -> Floats:
    count = min(sampling.pixels, depth.size)
    picked = np.random.default_rng((sampling.seed, index)).choice(depth.size, count, replace=False)
    row, column = np.divmod(picked, depth.shape[1])
    distance = depth[row, column].astype(np.float64)
    rays = back_project(camera, np.stack((column, row), axis=-1)[None] + 0.5)[0]
    if sampling.kind is DepthKind.Z:
        rays = rays / rays[:, 2:]
    points: Floats = rays * distance[:, None]
    return points[np.isfinite(points).all(axis=1)]


_CANDIDATES = 48
_PARTNERS = 4
_LEAST_OVERLAP = 0.1
_LEAST_OVERLAP_WIDE = 0.25
_BLOCK = 64


class PairRule(StrEnum):
    """Which pairs of frames are compared."""

    NEIGHBOURS = "neighbours"
    """Each frame with the next in the order of ids."""
    OVERLAP = "overlap"
    """Each frame with the four that see most of what it sees, at least 10 %."""
    WIDE = "wide"
    """Each frame with the four farthest cameras that see at least 25 % of what it sees."""
    ALL = "all"
    """The three together."""


def choose_pairs(
    rule: PairRule, cameras: Cameras, poses: Poses, points: Floats
) -> NDArray[np.int64]:
    """Choose the pairs of N frames."""
    first = np.arange(len(poses) - 1)
    parts = [np.empty((0, 2), np.int64)]
    if rule in (PairRule.NEIGHBOURS, PairRule.ALL):
        parts.append(np.stack((first, first + 1), axis=1))
    if rule is not PairRule.NEIGHBOURS:
        other, share = shared_views(cameras, poses, points)
        if rule in (PairRule.OVERLAP, PairRule.ALL):
            parts.append(_best(other, share, share >= _LEAST_OVERLAP))
        if rule in (PairRule.WIDE, PairRule.ALL):
            apart = poses.centres[other] - poses.centres[:, None]
            distance = np.sqrt((apart * apart).sum(axis=-1))
            parts.append(_best(other, distance, share >= _LEAST_OVERLAP_WIDE))
    pairs = np.sort(np.concatenate(parts), axis=1)
    return np.unique(pairs, axis=0)


def shared_views(cameras: Cameras, poses: Poses, points: Floats) -> tuple[Ints, Floats]:
    """Share of each frame's points that lie in the image of others, hidden or not."""
    from scipy.spatial import cKDTree

    seen = np.asarray(np.isfinite(points).all(axis=2))
    has_points = np.asarray(seen.any(axis=1))
    counts = np.maximum(seen.sum(axis=1), 1)
    middle = np.where(seen[..., None], points, 0.0).sum(axis=1) / counts[:, None]
    # A frame without points sees nothing: its middle is put where its camera is.
    middle = np.where(has_points[:, None], middle, poses.centres)
    # A tree answers with rows only as far as there are some.
    _, nearest = cKDTree(middle).query(middle, k=np.arange(1, min(_CANDIDATES, len(middle)) + 1))
    other: Ints = nearest.astype(np.int64)
    share = np.empty(other.shape)
    for start in range(0, len(other), _BLOCK):
        part = slice(start, start + _BLOCK)
        share[part] = _shares(cameras, poses, points[part], other[part]) / counts[part, None]
    share[other == np.arange(len(other))[:, None]] = 0.0
    return other, share


def _shares(cameras: Cameras, poses: Poses, points: Floats, other: Ints) -> Floats:
    """How many points (n, P, 3) lie in the images of others (n, C), as (n, C)."""
    flat = other.reshape(-1)
    repeated = np.repeat(points, other.shape[1], axis=0)
    chosen = cameras.take(flat)
    pixels = project(chosen, world_to_camera(poses.take(flat), repeated))
    size = np.stack((chosen.width, chosen.height), axis=-1)[:, None]
    with np.errstate(invalid="ignore"):
        inside = ((pixels >= 0.0) & (pixels <= size)).all(axis=-1)
    counts: Floats = inside.sum(axis=1).reshape(other.shape).astype(np.float64)
    return counts


def _best(other: Ints, value: Floats, allowed: NDArray[np.bool_]) -> Ints:
    """Pairs of each frame with its four allowed others of the greatest value."""
    ranked = np.argsort(np.where(allowed, -value, np.inf), axis=1, kind="stable")[:, :_PARTNERS]
    frame = np.repeat(np.arange(len(other))[:, None], ranked.shape[1], axis=1)
    kept = np.take_along_axis(allowed, ranked, axis=1)
    partner = np.take_along_axis(other, ranked, axis=1)
    return np.stack((frame[kept], partner[kept]), axis=1)
