"""Answers of the retrieval track, collected: ranked tiles, or descriptors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from airzoo_bench.api.arrays import in_order, same_index
from airzoo_bench.api.benchmark import BlindScene
from airzoo_bench.api.claims import Fields, coordinates, index_of
from airzoo_bench.api.row_file import RowFile
from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.retrieval.predictions import (
    RankedIds,
    RetrievalPredictions,
    deep_validation_errors,
    validation_errors,
)
from airzoo_bench.retrieval.similarity import Metric, check_norms

__all__ = ["DescribedClaims", "RankedClaims"]

_NO_TILE = -1


class RankedClaims:
    """Ranked tiles of queries.

    Parameters
    ----------
    scenes : sequence of BlindScene
        Of the protocol.
    depth : int
        Shorter lists are filled up to this length with empty ids.
    """

    def __init__(self, scenes: Sequence[BlindScene], depth: int) -> None:
        self._queries, self._tiles = _queries(scenes), _tiles(scenes)
        self._depth = depth
        self._lists: dict[int, tuple[list[int], NDArray[np.float64] | None]] = {}
        self._way = 0.0

    def add(self, name: str, fields: Fields) -> None:
        """Check and keep a list; see `Claims.add`."""
        row = index_of(name, self._queries, "query of the benchmark")
        same_index(fields)
        ids = [str(tile) for tile in in_order("ranked_ids", fields["ranked_ids"])]
        tiles = [index_of(tile, self._tiles, "tile of the gallery") for tile in ids]
        scores = self._scores(fields.get("scores"), len(ids))
        _refuse_faults(name, ids, scores)
        self._way = self._way or _way(scores)
        self._lists[row] = tiles, scores

    def _scores(self, given: ArrayLike | None, count: int) -> NDArray[np.float64] | None:
        first = next(iter(self._lists.values()), None)
        if first is not None and (first[1] is None) != (given is None):
            raise PredictionError(
                "scores with some queries only", expected="scores with every query, or with none"
            )
        if given is None:
            return None
        scores = coordinates("scores", given, (count,)).astype(np.float64)
        if self._way * _way(scores) < 0:
            raise PredictionError(
                "scores rise here and fall in the answers before, or the other way round",
                expected="similarities, which fall along a list, or distances, which rise, in all",
            )
        return scores

    def missing(self) -> tuple[str, ...]:
        """Return the queries without a list."""
        return tuple(name for name, row in self._queries.items() if row not in self._lists)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the fields of the prediction file."""
        rows = sorted(self._lists)
        longest = max([self._depth, *(len(tiles) for tiles, _ in self._lists.values())])
        tiles = np.full((len(rows), longest), _NO_TILE)
        scores = np.zeros((len(rows), longest))
        for place, row in enumerate(rows):
            ranked, given = self._lists[row]
            tiles[place, : len(ranked)] = ranked
            if given is not None and len(given):
                scores[place] = np.append(given, np.repeat(given[-1], longest - len(given)))
        names = np.array([*self._tiles, ""], dtype=str)
        arrays = {"query_ids": np.array([*self._queries], dtype=str)[rows]}
        arrays["ranked_ids"] = names[tiles]
        scored = any(given is not None for _, given in self._lists.values())
        return {**arrays, "scores": scores} if scored else arrays


class DescribedClaims:
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
        self._queries, self._tiles = _queries(scenes), _tiles(scenes)
        self._metric = metric
        self._asked = RowFile(folder / "queries", "descriptor", len(self._queries), axes=1)
        self._gallery = RowFile(folder / "gallery", "descriptor", len(self._tiles), axes=1)

    def add(self, name: str, fields: Fields) -> None:
        """Check and keep the descriptor of a query or tile; see `Claims.add`."""
        given = fields["descriptor"]
        for rows, kept, other in (
            (self._queries, self._asked, self._gallery),
            (self._tiles, self._gallery, self._asked),
        ):
            if name in rows:
                descriptor = other.check(kept.check(given))
                _refuse_unrankable(name, descriptor, self._metric)
                kept.put(rows[name], descriptor)
                return
        index_of(name, self._queries | self._tiles, "query or tile of the benchmark")

    def missing(self) -> tuple[str, ...]:
        """Return the queries and tiles without a descriptor."""
        return (*_lacking(self._queries, self._asked), *_lacking(self._tiles, self._gallery))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the fields of the prediction file, descriptors still on disk.

        Raises
        ------
        PredictionError
            A tile has no descriptor, or no query has one.
        """
        lacking = _lacking(self._tiles, self._gallery)
        if lacking:
            raise PredictionError(
                f"no descriptor of tiles: {first_of(lacking, len(self._tiles))}",
                expected="every tile of the gallery: leaving some out would make the task easier",
                fix="add the descriptor of each tile of scene.tiles(), in every scene",
            )
        if not self._asked.there.any():
            raise PredictionError("no query has a descriptor", expected="at least one")
        ids = np.array([*self._queries], dtype=str)
        return {
            "query_ids": ids[self._asked.there],
            "query_descriptors": self._asked.packed(),
            "gallery_ids": np.array([*self._tiles], dtype=str),
            "gallery_descriptors": self._gallery.packed(),
        }


def _queries(scenes: Sequence[BlindScene]) -> dict[str, int]:
    ids = [photo.id for scene in scenes for photo in scene.queries()]
    return {name: row for row, name in enumerate(ids)}


def _tiles(scenes: Sequence[BlindScene]) -> dict[str, int]:
    ids = [tile.id for scene in scenes for tile in scene.tiles()]
    return {name: row for row, name in enumerate(ids)}


def _lacking(rows: Mapping[str, int], kept: RowFile) -> list[str]:
    return [name for name, row in rows.items() if not kept.there[row]]


def _refuse_faults(name: str, ids: list[str], scores: NDArray[np.float64] | None) -> None:
    """Hold one list to all that is asked of a file of lists."""
    claim = RankedIds(np.array([ids], dtype=str), None if scores is None else scores[None])
    one = RetrievalPredictions(Path(name), None, np.array([name]), claim)
    for fault in (
        *validation_errors(one, 0),
        *deep_validation_errors(one, "l2", [name.partition("/")[0]]),
    ):
        raise PredictionError(fault.what, expected=fault.expected, fix=fault.fix)


def _refuse_unrankable(name: str, descriptor: NDArray[Any], metric: Metric) -> None:
    norms = np.linalg.norm(descriptor[None].astype(np.float64), axis=1)
    finite = np.array([np.isfinite(descriptor).all()])
    check_norms(norms, lambda _: finite, "descriptor", metric, [name])


def _way(scores: NDArray[np.float64] | None) -> float:
    """Return 1 where scores rise, -1 where they fall, 0 where there is no telling."""
    steps = np.diff(np.zeros(0) if scores is None else scores)
    moving = steps[steps != 0]
    return float(np.sign(moving[0])) if moving.size else 0.0
