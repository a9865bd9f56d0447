"""Prediction files of the retrieval track, ranked tile ids or descriptors, and their faults."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.engines.engine import split
from airzoo_bench.evaluation.predictions import Fields, QueryPredictions, read_fields
from airzoo_bench.formats.arrays import Arrays, check_ids, check_length, numbers, open_arrays, texts
from airzoo_bench.geometry.arrays import Floats

_CELLS = 1 << 20  # ranks at a time
_EXPECTED = "query_ids with ranked_ids, or with gallery_descriptors, gallery_ids, query_descriptors"
_FAULTS_OF_LISTS = (  # field, what, expected
    ("ranked_ids", "an empty id before a tile", "empty ids only at the end of a shorter list"),
    ("ranked_ids", "a tile more than once", "each tile once a query, at its best rank"),
    ("scores", "NaN or infinite scores", "a finite number for each ranked tile"),
    ("scores", "scores that are not in order", "similarities that fall, or distances that rise"),
)


@dataclass(frozen=True)
class RankedIds:
    """Ranked tile ids of each query, best first."""

    kind: ClassVar[str] = "ranked_ids"

    ids: NDArray[np.str_]  # (Q, K), empty where a list is shorter than K
    scores: Floats | None  # (Q, K), similarities or distances; equal ones are ties


@dataclass(frozen=True)
class Descriptors:
    """Descriptors of queries (Q, D) and of tiles (G, D)."""

    kind: ClassVar[str] = "descriptors"

    queries: NDArray[np.floating[Any]]
    gallery_ids: NDArray[np.str_]
    gallery: NDArray[Any]  # may be mapped


RetrievalPredictions = QueryPredictions[RankedIds | Descriptors]
"""A prediction file of the retrieval track, as read."""


def _read_ranked(arrays: Arrays, query_ids: NDArray[np.str_]) -> RankedIds | Descriptors:
    ids = texts(arrays, "ranked_ids", 2)
    check_length(arrays, "ranked_ids", ids, len(query_ids))
    if not ids.shape[1]:
        raise PredictionError("ranks no tile", where=f"{arrays.path}, field 'ranked_ids'")
    scores = None
    if "scores" in arrays.names():
        scores = numbers(arrays, "scores", (None, ids.shape[1])).astype(np.float64)
        check_length(arrays, "scores", scores, len(ids))
    return RankedIds(ids, scores)


def _read_descriptors(arrays: Arrays, query_ids: NDArray[np.str_]) -> RankedIds | Descriptors:
    gallery_ids = texts(arrays, "gallery_ids", 1)
    queries = numbers(arrays, "query_descriptors", (None, None))
    gallery = numbers(arrays, "gallery_descriptors", (None, None), mapped=True)
    check_length(arrays, "query_descriptors", queries, len(query_ids))
    check_length(arrays, "gallery_descriptors", gallery, len(gallery_ids))
    return Descriptors(queries, gallery_ids, gallery)


def read_retrieval(path: Path, limit_bytes: int) -> RetrievalPredictions:
    """Read a prediction file of the retrieval track."""
    described = ("query_descriptors", "gallery_ids", "gallery_descriptors")
    forms = (
        Fields("ranked_ids", ("ranked_ids",), ("scores",), _read_ranked),
        Fields("query_descriptors", described, (), _read_descriptors),
    )
    columns = ("protocol", "query_ids", "ranked_ids", "scores")  # of a table
    return read_fields(open_arrays(path, limit_bytes, columns), forms, _EXPECTED)


def check_predictions(predictions: RetrievalPredictions) -> None:
    """Refuse predictions for faults that can be found without truth, and quickly."""
    content, path = predictions.content, predictions.path
    check_ids(predictions.query_ids, f"{path}, field 'query_ids'")
    if isinstance(content, RankedIds):
        try:
            check_lists(content.ids, content.scores, predictions.query_ids)
        except PredictionError as error:
            raise error.inside(path) from error
        return
    check_ids(content.gallery_ids, f"{path}, field 'gallery_ids'")
    asked, described = content.queries.shape[1], content.gallery.shape[1]
    if asked != described:
        raise PredictionError(
            f"query descriptors have {asked} dimensions, gallery descriptors {described}",
            where=f"{path}, fields 'query_descriptors' and 'gallery_descriptors'",
            fix="describe photos and tiles with the same model",
        )


def check_lists(
    ids: NDArray[Any], scores: Floats | None, names: Sequence[object] | NDArray[Any]
) -> None:
    """Refuse faulty ranked lists (Q, K) of ids, or of indices as the Python face has.

    An empty id, or -1, ends a list. Scores may rise or fall, and the fewer rows are at fault.
    """
    faults = np.zeros((5, len(ids)), np.bool_)
    ended = "" if ids.dtype.kind == "U" else -1
    for part in split(len(ids), max(1, _CELLS // max(1, ids.shape[1]))):
        order, there = np.sort(ids[part], axis=1), ids[part] != ended
        same = (order[:, 1:] == order[:, :-1]) & (order[:, 1:] != ended)
        of_part = [~there[:, :-1] & there[:, 1:], same]
        if scores is not None:
            better, worse = scores[part, :-1], scores[part, 1:]
            of_part.append(~np.isfinite(scores[part]) & there)
            of_part += [(worse > better) & there[:, 1:], (worse < better) & there[:, 1:]]
        for fault, cells in zip(faults, of_part, strict=False):
            fault[part] = cells.any(axis=1)
    faults[3] = min(faults[3], faults[4], key=np.count_nonzero)
    for rows, (field, what, expected) in zip(faults, _FAULTS_OF_LISTS, strict=False):
        if rows.any():
            named = first_of([names[row] for row in np.flatnonzero(rows).tolist()], len(names))
            what = f"{what} in the lists of queries: {named}"
            raise PredictionError(what, where=f"field '{field}'", expected=expected)
