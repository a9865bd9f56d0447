"""Answers of retrieval and matching while they are collected."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from airzoo_bench.api.arrays import coordinates, floats, in_order
from airzoo_bench.api.collectors import Collector, Fields, QueryCollector, RowFile, index_of
from airzoo_bench.api.photos import Photo
from airzoo_bench.api.scene import BlindScene
from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.evaluation.prediction_files import write_predictions
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.rotations import check_rotations
from airzoo_bench.retrieval.predictions import (
    RankedIds,
    RetrievalPredictions,
    deep_validation_errors,
    validation_errors,
)
from airzoo_bench.retrieval.similarity import Metric, check_norms

__all__ = ["DescriptorCollector", "MatchCollector", "PoseCollector", "RankedCollector"]

_NO_TILE = -1
_SLACK_PX = 1.0  # sub-pixel refinement oversteps a picture's border


class RankedCollector(QueryCollector[tuple[list[int], Floats | None]]):
    """Ranked tiles of queries.

    Parameters
    ----------
    scenes : sequence of BlindScene
        Of the protocol.
    depth : int
        Shorter lists are filled up to this length with empty ids.
    """

    def __init__(self, scenes: Sequence[BlindScene], depth: int) -> None:
        super().__init__(_queries(scenes))
        self._tiles = {name: row for row, name in enumerate(_tiles(scenes))}
        self._depth, self._way = depth, 0.0

    def checked(self, name: str, row: int, fields: Fields) -> tuple[list[int], Floats | None]:
        """See `QueryCollector.checked`."""
        ids = [str(tile) for tile in in_order("ranked_ids", fields["ranked_ids"])]
        tiles = [index_of(tile, self._tiles, "tile of the gallery") for tile in ids]
        scores = self._scores(fields.get("scores"), len(ids))
        _refuse_bad_list(name, ids, scores)
        self._way = self._way or _way(scores)
        return tiles, scores

    def _scores(self, given: ArrayLike | None, count: int) -> Floats | None:
        first = next(iter(self._answers.values()), None)
        if first is not None and (first[1] is None) != (given is None):
            raise PredictionError(
                "scores with some queries only", expected="scores with every query, or with none"
            )
        if given is None:
            return None
        scores = floats("scores", given, (count,))
        if self._way * _way(scores) < 0:
            raise PredictionError(
                "scores rise here and fall in the answers before, or the other way round",
                expected="similarities, which fall along a list, or distances, which rise, in all",
            )
        return scores

    def fields(self, answers: list[tuple[list[int], Floats | None]]) -> dict[str, NDArray[Any]]:
        """See `QueryCollector.fields`."""
        longest = max([self._depth, *(len(tiles) for tiles, _ in answers)])
        tiles = np.full((len(answers), longest), _NO_TILE)
        scores = np.zeros((len(answers), longest))
        for row, (ranked, given) in enumerate(answers):
            tiles[row, : len(ranked)] = ranked
            if given is not None and len(given):
                scores[row] = np.append(given, np.repeat(given[-1], longest - len(given)))
        ranked_ids = np.array([*self._tiles, ""], dtype=str)[tiles]
        scored = any(given is not None for _, given in answers)
        return {"ranked_ids": ranked_ids} | ({"scores": scores} if scored else {})


class DescriptorCollector(Collector):
    """Descriptors of queries and of all tiles.

    Parameters
    ----------
    scenes : sequence of BlindScene
        Of the protocol.
    metric : str
        The protocol's, which says what a descriptor must not be.
    folder : Path
        Keeps them until they are written.
    """

    def __init__(self, scenes: Sequence[BlindScene], metric: Metric, folder: Path) -> None:
        self._metric = metric
        self._queries = _Described(_queries(scenes), folder / "queries")
        self._tiles = _Described(_tiles(scenes), folder / "gallery")

    def add(self, name: str, fields: Fields) -> None:
        """See `Collector.add`."""
        for mine, other in ((self._queries, self._tiles), (self._tiles, self._queries)):
            if name in mine.rows:
                descriptor = other.kept.check(mine.kept.check(fields["descriptor"]))
                norms = np.linalg.norm(descriptor[None].astype(np.float64), axis=1)
                finite = np.array([np.isfinite(descriptor).all()])
                check_norms(norms, lambda _: finite, "descriptor", self._metric, [name])  # noqa: B023
                mine.kept.put(mine.rows[name], descriptor)
                return
        index_of(name, self._queries.rows | self._tiles.rows, "query or tile of the benchmark")

    def missing(self) -> tuple[str, ...]:
        """See `Collector.missing`; of queries and tiles."""
        return (*self._queries.missing(), *self._tiles.missing())

    def write(self, path: Path, protocol: str) -> None:
        """See `Collector.write`: a tile has no descriptor, or no query has one."""
        lacking = self._tiles.missing()
        if lacking:
            raise PredictionError(
                f"no descriptor of tiles: {first_of(lacking, len(self._tiles.rows))}",
                expected="every tile of the gallery: leaving some out would make the task easier",
                fix="add the descriptor of each tile of scene.tiles(), in every scene",
            )
        if not self._queries.kept.there.any():
            raise PredictionError("no query has a descriptor", expected="at least one")
        ids = np.array([*self._queries.rows], dtype=str)
        arrays = {
            "query_ids": ids[self._queries.kept.there],
            "query_descriptors": self._queries.kept.packed(),
            "gallery_ids": np.array([*self._tiles.rows], dtype=str),
            "gallery_descriptors": self._tiles.kept.packed(),
        }
        write_predictions(path, protocol, arrays)


class _Described:
    """Ids, and the descriptors that are there."""

    def __init__(self, ids: Sequence[str], path: Path) -> None:
        self.rows = {name: row for row, name in enumerate(ids)}
        self.kept = RowFile(path, "descriptor", len(ids), axes=1)

    def missing(self) -> list[str]:
        return [name for name, row in self.rows.items() if not self.kept.there[row]]


class MatchCollector(QueryCollector[tuple[Floats, Floats]]):
    """Matches of queries with pixels of the map, or with points of the scene.

    Parameters
    ----------
    scenes : sequence of BlindScene
        Of the protocol.
    target : str
        ``map_xy`` or ``points3d``.
    """

    def __init__(self, scenes: Sequence[BlindScene], target: str) -> None:
        self._photos = _matched(scenes)
        super().__init__(photo.id for photo in self._photos)
        self._target, self._axes = target, 2 if target == "map_xy" else 3

    def checked(self, name: str, row: int, fields: Fields) -> tuple[Floats, Floats]:
        """See `QueryCollector.checked`."""
        query_xy = coordinates("query_xy", fields["query_xy"], (None, 2), any_history=True)
        _refuse_outside(query_xy, self._photos[row])
        shape = (None, self._axes)
        there = coordinates(self._target, fields[self._target], shape, any_history=True)
        if len(there) != len(query_xy):
            raise PredictionError(
                f"{self._target} has {len(there):,} rows, query_xy has {len(query_xy):,}",
                expected="a row a match in both",
            )
        return query_xy, there

    def fields(self, answers: list[tuple[Floats, Floats]]) -> dict[str, NDArray[Any]]:
        """See `QueryCollector.fields`."""
        lengths = [len(query_xy) for query_xy, _ in answers]
        query_xy = [np.zeros((0, 2)), *(query_xy for query_xy, _ in answers)]
        there = [np.zeros((0, self._axes)), *(there for _, there in answers)]
        return {
            "offsets": np.cumsum([0, *lengths], dtype=np.int64),
            "query_xy": np.concatenate(query_xy),
            self._target: np.concatenate(there),
        }


class PoseCollector(QueryCollector[tuple[Floats, Floats]]):
    """Poses of queries.

    Parameters
    ----------
    scenes : sequence of BlindScene
        Of the protocol.
    """

    def __init__(self, scenes: Sequence[BlindScene]) -> None:
        super().__init__(photo.id for photo in _matched(scenes))

    def checked(self, name: str, row: int, fields: Fields) -> tuple[Floats, Floats]:
        """See `QueryCollector.checked`."""
        rotation = coordinates("rotation", fields["rotation"], (3, 3), any_history=True)
        check_rotations(rotation[None], [name])
        return rotation, coordinates("centre", fields["centre"], (3,), any_history=True)

    def fields(self, answers: list[tuple[Floats, Floats]]) -> dict[str, NDArray[Any]]:
        """See `QueryCollector.fields`."""
        return {
            "rotations": np.array([rotation for rotation, _ in answers]).reshape(-1, 3, 3),
            "centres": np.array([centre for _, centre in answers]).reshape(-1, 3),
        }


def _queries(scenes: Sequence[BlindScene]) -> list[str]:
    return [photo.id for scene in scenes for photo in scene.queries()]


def _tiles(scenes: Sequence[BlindScene]) -> list[str]:
    return [tile.id for scene in scenes for tile in scene.tiles()]


def _matched(scenes: Sequence[BlindScene]) -> list[Photo]:
    return [crop.query for scene in scenes for crop in scene.crops()]


def _refuse_bad_list(name: str, ids: list[str], scores: Floats | None) -> None:
    """Check one list for all that is asked of a file of lists."""
    ranked = RankedIds(np.array([ids], dtype=str), None if scores is None else scores[None])
    one = RetrievalPredictions(Path(name), None, np.array([name]), ranked)
    scene = name.partition("/")[0]
    for error in chain(validation_errors(one, 0), deep_validation_errors(one, "l2", [scene])):
        raise PredictionError(error.what, expected=error.expected, fix=error.fix)


def _way(scores: Floats | None) -> float:
    """Return 1 where scores rise, -1 where they fall, 0 where there is no telling."""
    steps = np.diff(np.zeros(0) if scores is None else scores)
    moving = steps[steps != 0]
    return float(np.sign(moving[0])) if moving.size else 0.0


def _refuse_outside(query_xy: Floats, photo: Photo) -> None:
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
