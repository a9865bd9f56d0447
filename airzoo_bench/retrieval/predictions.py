"""Prediction files of the retrieval track: ranked tile ids, or descriptors."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.queries import Fields, QueryPredictions, read_fields
from airzoo_bench.formats.arrays import (
    Arrays,
    check_length,
    numbers,
    open_arrays,
    texts,
)
from airzoo_bench.geometry.arrays import Floats

Texts = NDArray[np.str_]

_COLUMNS = ("protocol", "query_ids", "ranked_ids", "scores")  # of a table
_EXPECTED = "query_ids with ranked_ids, or with gallery_descriptors, gallery_ids, query_descriptors"


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
