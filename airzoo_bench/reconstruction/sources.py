"""Clouds that are read in pieces: in memory or moved, their finite points, an even sample."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from airzoo_bench.formats.clouds.cloud import Cloud, CloudSource
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.reconstruction.alignment.similarity import Similarity

__all__ = [
    "EvenSample",
    "InMemoryCloud",
    "TransformedCloud",
    "concatenated",
    "finite_pieces",
    "finite_rows",
]

_ENDLESS = 1e150


@dataclass(frozen=True, eq=False)
class InMemoryCloud:
    """Points (N, 3) in memory, as a `CloudSource`."""

    points: Floats

    @property
    def count(self) -> int:
        """How many points it holds."""
        return len(self.points)

    def pieces(self, points: int) -> Iterator[Cloud]:
        """Yield all points, at most so many at a time."""
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
        """Yield all points, at most so many at a time."""
        for piece in self.source.pieces(points):
            kept = piece.points
            if self.confidence_above is not None and piece.confidence is not None:
                kept = kept[piece.confidence > self.confidence_above]
            # What is infinite becomes NaN at worst, and is counted where the cloud is prepared.
            with np.errstate(invalid="ignore", over="ignore"):
                yield Cloud(self.transform.apply(kept))


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


def finite_rows(points: Floats) -> Bools:
    """Whether each of points (N, 3) has coordinates whose squares are numbers."""
    finite: Bools = np.all(np.abs(points) < _ENDLESS, axis=1)
    return finite


def finite_pieces(source: CloudSource, points: int) -> Iterator[Floats]:
    """Yield the finite points (N, 3) of a cloud, at most so many at a time."""
    for piece in source.pieces(points):
        finite = finite_rows(piece.points)
        yield piece.points if finite.all() else piece.points[finite]


def concatenated(pieces: Iterable[Floats]) -> Floats:
    """Put pieces (N, 3), of which there may be none, under each other."""
    return np.concatenate([np.zeros((0, 3)), *pieces])
