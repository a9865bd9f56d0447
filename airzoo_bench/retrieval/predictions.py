"""Prediction files of the retrieval track, ranked tile ids or descriptors, and their faults."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.core.ids import check_ids
from airzoo_bench.evaluation.queries import Fields, QueryPredictions, read_fields
from airzoo_bench.formats.arrays import Arrays, check_length, numbers, open_arrays, texts
from airzoo_bench.geometry.arrays import Floats

Texts = NDArray[np.str_]

_CELLS = 1 << 20  # ranks at a time
_COLUMNS = ("protocol", "query_ids", "ranked_ids", "scores")  # of a table
_EXPECTED = "query_ids with ranked_ids, or with gallery_descriptors, gallery_ids, query_descriptors"


_FAULTS_OF_LISTS = (  # field, what, expected, fix
    (
        *("ranked_ids", "an empty id before a tile in the lists of"),
        "empty ids only at the end of a list that is shorter than the others",
        "move the empty ids to the end",
    ),
    (
        *("ranked_ids", "a tile is ranked more than once in the lists of"),
        *("each tile once a query", "keep each tile's best rank"),
    ),
    (
        *("scores", "NaN or infinite scores in the rows of"),
        "a finite number for each ranked tile",
        "look for a division by zero or half precision, or leave the scores out",
    ),
    (
        *("scores", "scores are not in order for"),
        "similarities that never rise along a row, or distances that never fall, in all rows alike",
        "sort each query's tiles by its scores, best first",
    ),
)


@dataclass(frozen=True)
class RankedIds:
    """Ranked tile ids of each query, best first."""

    kind: ClassVar[str] = "ranked_ids"

    ids: Texts  # (Q, K), empty where a list is shorter than K
    scores: Floats | None  # (Q, K), similarities or distances; equal ones are ties


@dataclass(frozen=True)
class Descriptors:
    """Descriptors of queries (Q, D) and of tiles (G, D)."""

    kind: ClassVar[str] = "descriptors"

    queries: NDArray[np.floating[Any]]
    gallery_ids: Texts
    gallery: NDArray[Any]  # may be mapped


RetrievalPredictions = QueryPredictions[RankedIds | Descriptors]
"""A prediction file of the retrieval track, as read."""


def read_retrieval(path: Path, limit_bytes: int) -> RetrievalPredictions:
    """Read a prediction file of the retrieval track."""
    return read_fields(open_arrays(path, limit_bytes, _COLUMNS), _FORMS, _EXPECTED)


def _read_ranked(arrays: Arrays, query_ids: Texts) -> RankedIds | Descriptors:
    ids = texts(arrays, "ranked_ids", 2)
    check_length(arrays, "ranked_ids", ids, len(query_ids))
    if not ids.shape[1]:
        where = f"{arrays.path}, field 'ranked_ids'"
        expected = "tiles of each query, best first"
        raise PredictionError("ranks no tile", where=where, expected=expected)
    if "scores" not in arrays.names():
        return RankedIds(ids, None)
    scores = numbers(arrays, "scores", (None, None))
    if scores.shape != ids.shape:
        raise PredictionError(
            f"field 'scores' has shape {scores.shape}",
            where=arrays.path,
            expected=f"the shape of ranked_ids, {ids.shape}",
            fix="give a score for each ranked tile",
        )
    return RankedIds(ids, scores.astype(np.float64))


def _read_descriptors(arrays: Arrays, query_ids: Texts) -> RankedIds | Descriptors:
    gallery_ids = texts(arrays, "gallery_ids", 1)
    queries = numbers(arrays, "query_descriptors", (None, None))
    gallery = numbers(arrays, "gallery_descriptors", (None, None), mapped=True)
    check_length(arrays, "query_descriptors", queries, len(query_ids))
    check_length(arrays, "gallery_descriptors", gallery, len(gallery_ids))
    return Descriptors(queries, gallery_ids, gallery)


_FORMS = (
    Fields("ranked_ids", ("ranked_ids",), ("scores",), _read_ranked),
    Fields(
        "query_descriptors",
        ("query_descriptors", "gallery_ids", "gallery_descriptors"),
        (),
        _read_descriptors,
    ),
)


def check_predictions(predictions: RetrievalPredictions) -> None:
    """Refuse predictions for faults that can be found without truth, and quickly."""
    content, where = predictions.content, f"{predictions.path}, field "
    check_ids(predictions.query_ids, f"{where}'query_ids'")
    if isinstance(content, RankedIds):
        try:
            check_lists(content.ids, content.scores, predictions.query_ids)
        except PredictionError as error:
            raise error.inside(predictions.path) from error
        return
    check_ids(content.gallery_ids, f"{where}'gallery_ids'")
    if content.queries.shape[1] != content.gallery.shape[1]:
        raise PredictionError(
            f"query descriptors have {content.queries.shape[1]} dimensions, gallery descriptors "
            f"{content.gallery.shape[1]}",
            where=f"{predictions.path}, fields 'query_descriptors' and 'gallery_descriptors'",
            expected="the same number",
            fix="describe photos and tiles with the same model",
        )


def check_lists(
    ids: NDArray[Any], scores: Floats | None, names: Sequence[object] | NDArray[Any]
) -> None:
    """Refuse faulty ranked lists (Q, K) of ids, or of indices as the Python face has.

    An empty id, or -1, ends a list. Scores may rise or fall, and the fewer rows are at fault.
    """
    interrupted, repeated, unusable, rises, falls = flags = np.zeros((5, len(ids)), np.bool_)
    ended = "" if ids.dtype.kind == "U" else -1
    step = max(1, _CELLS // max(1, ids.shape[1]))
    for part in (slice(start, start + step) for start in range(0, len(ids), step)):
        order, there = np.sort(ids[part], axis=1), ids[part] != ended
        interrupted[part] = (~there[:, :-1] & there[:, 1:]).any(axis=1)
        same = (order[:, 1:] == order[:, :-1]) & (order[:, 1:] != ended)
        repeated[part] = same.any(axis=1)
        if scores is not None:
            values = scores[part]
            finite = ~np.isnan(values) if ended == -1 else np.isfinite(values)
            unusable[part] = (~finite & there).any(axis=1)
            rises[part] = ((values[:, 1:] > values[:, :-1]) & there[:, 1:]).any(axis=1)
            falls[part] = ((values[:, 1:] < values[:, :-1]) & there[:, 1:]).any(axis=1)
    flags[3] = min(rises, falls, key=np.count_nonzero)
    for rows, (field, what, expected, fix) in zip(flags[:4], _FAULTS_OF_LISTS, strict=True):
        if rows.any():
            named = (names[row] for row in np.flatnonzero(rows).tolist())
            what = f"{what} {first_of(named, len(names), noun='query')}"
            raise PredictionError(what, where=f"field '{field}'", expected=expected, fix=fix)
