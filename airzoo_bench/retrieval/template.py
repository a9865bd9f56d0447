"""An example of a prediction file, with the benchmark's own ids."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.retrieval.truth import RetrievalTruth

__all__ = ["descriptor_template", "ranked_template"]

_DIMENSIONS = 8


def ranked_template(
    truths: Sequence[RetrievalTruth], ranks: int, seed: int
) -> dict[str, NDArray[Any]]:
    """Rank tiles at random for every query.

    Parameters
    ----------
    truths : sequence of RetrievalTruth
        The scenes.
    ranks : int
        Length of each list; lists of a smaller gallery end with empty ids.
    seed : int

    Returns
    -------
    dict of str to array
        ``query_ids`` (Q,) and ``ranked_ids`` (Q, ranks).
    """
    random = np.random.default_rng(seed)
    lists = []
    for truth in truths:
        tiles = truth.tiles["id"].to_numpy(str)
        for _ in range(len(truth.queries)):
            picked = random.permutation(tiles)[:ranks]
            lists.append([*picked, *[""] * (ranks - len(picked))])
    return {"query_ids": _query_ids(truths), "ranked_ids": np.array(lists, dtype=str)}


def descriptor_template(truths: Sequence[RetrievalTruth], seed: int) -> dict[str, NDArray[Any]]:
    """Describe every query and every tile at random.

    Returns
    -------
    dict of str to array
        ``query_ids`` (Q,), ``query_descriptors`` (Q, 8), ``gallery_ids`` (G,) and
        ``gallery_descriptors`` (G, 8).
    """
    random = np.random.default_rng(seed)
    queries = _query_ids(truths)
    gallery = np.concatenate([truth.tiles["id"].to_numpy(str) for truth in truths])
    return {
        "query_ids": queries,
        "query_descriptors": random.standard_normal((len(queries), _DIMENSIONS), np.float32),
        "gallery_ids": gallery,
        "gallery_descriptors": random.standard_normal((len(gallery), _DIMENSIONS), np.float32),
    }


def _query_ids(truths: Sequence[RetrievalTruth]) -> NDArray[np.str_]:
    return np.concatenate([truth.queries["id"].to_numpy(str) for truth in truths])
