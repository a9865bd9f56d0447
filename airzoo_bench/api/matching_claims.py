"""Answers of the matching track, collected: matches, 2D-3D pairs, or poses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.api.arrays import same_index
from airzoo_bench.api.benchmark import BlindScene
from airzoo_bench.api.claims import Fields, index_of, precise
from airzoo_bench.api.photos import Photo
from airzoo_bench.core.errors import PredictionError
from airzoo_bench.geometry.poses import check_rotations

__all__ = ["MatchClaims", "PoseClaims"]

_SLACK_PX = 1.0  # sub-pixel refinement oversteps a picture's border


class MatchClaims:
    """Matches of queries with pixels of the map, or with points of the scene.

    Parameters
    ----------
    scenes : sequence of BlindScene
        Of the protocol.
    target : str
        ``map_xy`` or ``points3d``.
    """

    def __init__(self, scenes: Sequence[BlindScene], target: str) -> None:
        self._photos = [crop.query for scene in scenes for crop in scene.crops()]
        self._queries = {photo.id: row for row, photo in enumerate(self._photos)}
        self._target, self._axes = target, 2 if target == "map_xy" else 3
        self._matches: dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]] = {}

    def add(self, name: str, fields: Fields) -> None:
        """Check and keep the matches of a query; see `Claims.add`."""
        row = index_of(name, self._queries, "query of the benchmark")
        same_index(fields)
        query_xy = precise("query_xy", fields["query_xy"], (None, 2))
        _refuse_outside(query_xy, self._photos[row])
        there = precise(self._target, fields[self._target], (None, self._axes))
        if len(there) != len(query_xy):
            raise PredictionError(
                f"{self._target} has {len(there):,} rows, query_xy has {len(query_xy):,}",
                expected="a row a match in both",
            )
        self._matches[row] = query_xy, there

    def missing(self) -> tuple[str, ...]:
        """Return the queries that were not added."""
        return tuple(name for name, row in self._queries.items() if row not in self._matches)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the fields of the prediction file."""
        rows = sorted(self._matches)
        matches = [self._matches[row] for row in rows]
        offsets = np.cumsum([0, *(len(query_xy) for query_xy, _ in matches)], dtype=np.int64)
        query_xy = [np.zeros((0, 2)), *(query_xy for query_xy, _ in matches)]
        there = [np.zeros((0, self._axes)), *(there for _, there in matches)]
        return {
            "query_ids": np.array([self._photos[row].id for row in rows], dtype=str),
            "offsets": offsets,
            "query_xy": np.concatenate(query_xy),
            self._target: np.concatenate(there),
        }


class PoseClaims:
    """Poses of queries.

    Parameters
    ----------
    scenes : sequence of BlindScene
        Of the protocol.
    """

    def __init__(self, scenes: Sequence[BlindScene]) -> None:
        ids = [crop.query.id for scene in scenes for crop in scene.crops()]
        self._queries = {name: row for row, name in enumerate(ids)}
        self._poses: dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]] = {}

    def add(self, name: str, fields: Fields) -> None:
        """Check and keep the pose of a query; see `Claims.add`."""
        row = index_of(name, self._queries, "query of the benchmark")
        rotation = precise("rotation", fields["rotation"], (3, 3))
        check_rotations(rotation[None], [name])
        self._poses[row] = rotation, precise("centre", fields["centre"], (3,))

    def missing(self) -> tuple[str, ...]:
        """Return the queries without a pose."""
        return tuple(name for name, row in self._queries.items() if row not in self._poses)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the fields of the prediction file."""
        rows = sorted(self._poses)
        return {
            "query_ids": np.array([*self._queries], dtype=str)[rows],
            "rotations": np.array([self._poses[row][0] for row in rows]).reshape(-1, 3, 3),
            "centres": np.array([self._poses[row][1] for row in rows]).reshape(-1, 3),
        }


def _refuse_outside(query_xy: NDArray[np.float64], photo: Photo) -> None:
    size = np.array((photo.camera.width, photo.camera.height))
    outside = ((query_xy < -_SLACK_PX) | (query_xy > size + _SLACK_PX)).any(axis=1)
    if outside.any():
        x, y = query_xy[outside][0]
        raise PredictionError(
            f"{int(outside.sum())} of {len(query_xy)} pixels of query_xy lie outside the photo, "
            f"such as ({x:.1f}, {y:.1f})",
            expected=f"pixels of the photo at its full size, {size[0]} x {size[1]} px, x before y",
            fix="scale pixels of a photo that was made smaller back up",
        )
