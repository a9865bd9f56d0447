"""From a file to the retrieval track's prediction type."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.formats.arrays import (
    Arrays,
    check_fields,
    check_length,
    numbers,
    open_arrays,
    protocol_name,
    texts,
)
from airzoo_bench.retrieval.predictions import Descriptors, RankedIds, RetrievalPredictions

__all__ = ["read_retrieval"]

_COMMON = ("protocol", "query_ids")
_RANKED = ("ranked_ids", "scores")
_DESCRIPTORS = ("query_descriptors", "gallery_ids", "gallery_descriptors")
_EXPECTED = "query_ids with ranked_ids, or with " + ", ".join(sorted(_DESCRIPTORS))


def read_retrieval(path: Path, limit_bytes: int) -> RetrievalPredictions:
    """Read a prediction file of the retrieval track.

    Parameters
    ----------
    path : Path
        ``.npz`` or ``.parquet``.
    limit_bytes : int
        The most that the file's arrays may take in memory together.

    Raises
    ------
    PredictionError
        Another kind of file, a field is missing, or has a wrong type or shape.
    """
    arrays = open_arrays(path, limit_bytes, (*_COMMON, *_RANKED))
    described = "query_descriptors" in arrays.names()
    if described and "ranked_ids" in arrays.names():
        raise PredictionError(
            "holds both ranked_ids and query_descriptors, and they could disagree",
            where=path,
            fix="keep one of the two",
        )
    needed = ("query_ids", *(_DESCRIPTORS if described else ("ranked_ids",)))
    allowed = (*_COMMON, *(_DESCRIPTORS if described else _RANKED))
    check_fields(arrays, needed, allowed, _EXPECTED)
    query_ids = texts(arrays, "query_ids", 1)
    read = _read_descriptors if described else _read_ranked
    return RetrievalPredictions(
        path, protocol_name(arrays), query_ids, read(arrays, len(query_ids))
    )


def _read_ranked(arrays: Arrays, rows: int) -> RankedIds:
    ids = texts(arrays, "ranked_ids", 2)
    check_length(arrays, "ranked_ids", ids, rows)
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


def _read_descriptors(arrays: Arrays, rows: int) -> Descriptors:
    gallery_ids = texts(arrays, "gallery_ids", 1)
    queries = numbers(arrays, "query_descriptors", (None, None))
    gallery = numbers(arrays, "gallery_descriptors", (None, None), mapped=True)
    check_length(arrays, "query_descriptors", queries, rows)
    check_length(arrays, "gallery_descriptors", gallery, len(gallery_ids))
    return Descriptors(queries, gallery_ids, gallery)
