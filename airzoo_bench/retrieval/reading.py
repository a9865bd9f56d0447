"""Reading prediction files of the retrieval track."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.queries import Fields, read_fields
from airzoo_bench.formats.arrays import (
    Arrays,
    check_length,
    numbers,
    open_arrays,
    texts,
)
from airzoo_bench.retrieval.predictions import Descriptors, RankedIds, RetrievalPredictions

__all__ = ["read_retrieval"]

_COLUMNS = ("protocol", "query_ids", "ranked_ids", "scores")  # of a table
_EXPECTED = "query_ids with ranked_ids, or with gallery_descriptors, gallery_ids, query_descriptors"


def read_retrieval(path: Path, limit_bytes: int) -> RetrievalPredictions:
    """Read a prediction file of the retrieval track."""
    return read_fields(open_arrays(path, limit_bytes, _COLUMNS), _FORMS, _EXPECTED)


def _read_ranked(arrays: Arrays, query_ids: NDArray[np.str_]) -> RankedIds | Descriptors:
    ids = texts(arrays, "ranked_ids", 2)
    check_length(arrays, "ranked_ids", ids, len(query_ids))
    if not ids.shape[1]:
        raise PredictionError(
            "ranks no tile",
            where=f"{arrays.path}, field 'ranked_ids'",
            expected="tiles of each query, best first",
        )
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


def _read_descriptors(arrays: Arrays, query_ids: NDArray[np.str_]) -> RankedIds | Descriptors:
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
