"""Clouds that are read in pieces: in memory, moved, or of depth maps and point maps.

Maps are read view by view. Pixel centres sit at integer + 0.5, the image's corner being (0, 0), as
in `geometry.cameras`: the pixel in column u and row v looks through (u + 0.5, v + 0.5).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np

from airzoo_bench.formats.clouds.cloud import Cloud, CloudSource
from airzoo_bench.geometry.arrays import Bools, Floats, Ints, apply_matrix
from airzoo_bench.geometry.cameras import Cameras, back_project
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.alignment.similarity import Similarity
from airzoo_bench.reconstruction.maps import FloatMaps

__all__ = [
    "DepthCloud",
    "DepthMaps",
    "EvenSample",
    "InMemoryCloud",
    "PointMapCloud",
    "PointMaps",
    "Sampled",
    "TransformedCloud",
    "concatenated",
    "finite_pieces",
    "finite_rows",
    "surface_depth",
]

_ENDLESS = 1e150
# Views are worked through in parts of this many pixels, whatever pieces are asked for.
_BLOCK_PIXELS = 1 << 18


@dataclass(frozen=True, eq=False)
class InMemoryCloud:
    """Points (N, 3) in memory, as a `CloudSource`."""

    points: Floats

    @property
    def count(self) -> int:
        """How many points it holds."""
        return len(self.points)

    def pieces(self, points: int) -> Iterator[Cloud]:
        """Yield all points, in pieces of at most `points`."""
        for start in range(0, len(self.points), points):
            yield Cloud(self.points[start : start + points])


@dataclass(frozen=True, eq=False)
class TransformedCloud:
    """A cloud brought into another frame, without points of too little confidence."""

    source: CloudSource
    transform: Similarity
    confidence_above: float | None

    @property
    def count(self) -> int:
        """How many points it holds at most."""
        return self.source.count

    def pieces(self, points: int) -> Iterator[Cloud]:
        """Yield all points, in pieces of at most `points`."""
        for piece in self.source.pieces(points):
            kept = piece.points
            if self.confidence_above is not None and piece.confidence is not None:
                kept = kept[piece.confidence > self.confidence_above]
            # What is infinite becomes NaN at worst, and is counted where the cloud is prepared.
            with np.errstate(invalid="ignore", over="ignore"):
                yield Cloud(self.transform.apply(kept))


@dataclass(frozen=True, eq=False)
class DepthMaps:
    """Depth maps of N views.

    Attributes
    ----------
    depth : (N, H, W) float array
        Along the camera's z axis. 0, negative, NaN and infinite stand for no surface.
    cameras : Cameras
        N, at the size of the maps.
    poses : Poses
        N, in the frame of the prediction.
    confidence : (N, H, W) float array or None
    """

    depth: FloatMaps
    cameras: Cameras
    poses: Poses
    confidence: FloatMaps | None = None

    def take(self, rows: Ints) -> DepthMaps:
        """Return the maps of some views."""
        return DepthMaps(
            self.depth[rows],
            self.cameras.take(rows),
            self.poses.take(rows),
            None if self.confidence is None else self.confidence[rows],
        )


@dataclass(frozen=True, eq=False)
class PointMaps:
    """Point maps of N views.

    Attributes
    ----------
    points : (N, H, W, 3) float array
        In the frame of the prediction; not finite for no surface.
    confidence : (N, H, W) float array or None
    """

    points: FloatMaps
    confidence: FloatMaps | None = None


@dataclass(frozen=True, eq=False)
class DepthCloud:
    """The cloud of all pixels of depth maps that have a surface; a `CloudSource`.

    Attributes
    ----------
    transform : Similarity
        Into the frame of the truth; depths grow by its scale.
    max_depth : float
        In units of the truth. A surface beyond it is none.
    confidence_above : float or None
        Pixels need a higher one; None takes all, as do maps without confidence.
    """

    maps: DepthMaps
    transform: Similarity
    max_depth: float
    confidence_above: float | None

    @cached_property
    def count(self) -> int:
        """How many points there are."""
        return sum(int((self._depth(row) > 0.0).sum()) for row in range(len(self.maps.depth)))

    def pieces(self, points: int) -> Iterator[Cloud]:
        """Yield all points, view by view and row by row, in pieces of at most `points`."""
        poses = self.transform.apply_poses(self.maps.poses)
        for row in range(len(self.maps.depth)):
            depth = self._depth(row).ravel()
            for pixels in _parts(depth > 0.0, points):
                yield self._lift(poses, row, depth[pixels], pixels)

    def _depth(self, row: int) -> Floats:
        return surface_depth(
            self.maps,
            row,
            scale=self.transform.scale,
            max_depth=self.max_depth,
            confidence_above=self.confidence_above,
        )

    def _lift(self, poses: Poses, row: int, depth: Floats, pixels: Ints) -> Cloud:
        places = np.stack(np.divmod(pixels, self.maps.depth.shape[2])[::-1], axis=-1) + 0.5
        rays = back_project(self.maps.cameras.take(row), places[None])[0]
        local = rays * (depth / rays[:, 2])[:, None]
        world = apply_matrix(poses.rotation[row].T, local) + poses.centres[row]
        return Cloud(world)


@dataclass(frozen=True, eq=False)
class PointMapCloud:
    """The cloud of all pixels of point maps that have a surface; a `CloudSource`.

    `transform` leads into the frame of the truth; on `confidence_above` see `DepthCloud`.
    """

    maps: PointMaps
    transform: Similarity
    confidence_above: float | None

    @cached_property
    def count(self) -> int:
        """How many points there are."""
        return sum(int(self._surface(row).sum()) for row in range(len(self.maps.points)))

    def pieces(self, points: int) -> Iterator[Cloud]:
        """Yield all points, view by view and row by row, in pieces of at most `points`."""
        for row in range(len(self.maps.points)):
            flat = self.maps.points[row].reshape(-1, 3)
            for pixels in _parts(self._surface(row), points):
                world = self.transform.apply(flat[pixels].astype(np.float64))
                yield Cloud(world)

    def _surface(self, row: int) -> Bools:
        finite: Bools = np.isfinite(self.maps.points[row]).all(axis=-1)
        return (finite & _trusted(self.maps.confidence, row, self.confidence_above)).ravel()


def surface_depth(
    maps: DepthMaps,
    row: int,
    *,
    scale: float,
    max_depth: float,
    confidence_above: float | None,
) -> Floats:
    """Return the depth map (H, W) of one view, 0 where it has no surface that counts."""
    with np.errstate(invalid="ignore"):  # of NaN, which compares false
        depth = maps.depth[row].astype(np.float64) * scale
    surface = (depth > 0.0) & (depth <= max_depth)
    surface &= _trusted(maps.confidence, row, confidence_above)
    return np.where(surface, depth, 0.0)


def _trusted(confidence: FloatMaps | None, row: int, above: float | None) -> Bools | np.bool_:
    if confidence is None or above is None:
        return np.True_
    return np.asarray(confidence[row] > above)


def _parts(surface: Bools, points: int) -> Iterator[Ints]:
    pixels = np.flatnonzero(surface)
    size = min(points, _BLOCK_PIXELS)
    for start in range(0, len(pixels), size):
        yield pixels[start : start + size]


class EvenSample:
    """Every n-th point of a cloud, the same for any pieces.

    Parameters
    ----------
    count, most : int
        Points of the cloud; n is the largest whole number that leaves at least `most`.
    """

    def __init__(self, count: int, most: int) -> None:
        self._step, self._seen = max(1, count // most), 0
        self._parts = [np.zeros((0, 3))]

    def add(self, points: Floats) -> None:
        """Take what belongs to the sample from the next points (N, 3) of the cloud."""
        self._parts.append(points[-self._seen % self._step :: self._step].copy())
        self._seen += len(points)

    def points(self) -> Floats:
        """Return the sample (S, 3)."""
        return np.concatenate(self._parts)


@runtime_checkable
class Sampled(Protocol):
    """A cloud of which some points are known before it is read."""

    @property
    def sample(self) -> Floats:
        """Finite points (S, 3) from all of it; none where it is not known."""


def finite_rows(points: Floats) -> Bools:
    """Whether each of points (N, 3) has coordinates whose squares are numbers."""
    finite: Bools = np.all(np.abs(points) < _ENDLESS, axis=1)
    return finite


def finite_pieces(source: CloudSource, points: int) -> Iterator[Floats]:
    """Yield the finite points (N, 3) of a cloud, in pieces of at most `points`."""
    for piece in source.pieces(points):
        finite = finite_rows(piece.points)
        yield piece.points if finite.all() else piece.points[finite]


def concatenated(pieces: Iterable[Floats]) -> Floats:
    """Put pieces (N, 3), of which there may be none, under each other."""
    return np.concatenate([np.zeros((0, 3)), *pieces])
