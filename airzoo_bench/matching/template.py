"""An example of a prediction file of matches, with the benchmark's own ids."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.matching.truth import MatchingTruth

__all__ = ["match_template"]


def match_template(
    truths: Sequence[MatchingTruth], matches: int, seed: int
) -> dict[str, NDArray[Any]]:
    """Match random pixels of every query to random pixels of its crop.

    Parameters
    ----------
    truths : sequence of MatchingTruth
        The scenes.
    matches : int
        Of each query.
    seed : int

    Returns
    -------
    dict of str to array
        ``query_ids`` (Q,), ``offsets`` (Q + 1,), ``query_xy`` and ``map_xy`` (M, 2).
    """
    random = np.random.default_rng(seed)
    sizes = [np.stack([t.cameras.width, t.cameras.height], axis=1) for t in truths]
    size = np.repeat(np.concatenate(sizes), matches, axis=0)
    crop = np.repeat(np.concatenate([t.crops for t in truths]), matches, axis=0)
    ids = np.concatenate([t.queries["id"].to_numpy(str) for t in truths])
    return {
        "query_ids": ids,
        "offsets": np.arange(len(ids) + 1) * matches,
        "query_xy": random.uniform(0, size),
        "map_xy": crop[:, :2] + random.uniform(0, crop[:, 2:]),
    }
