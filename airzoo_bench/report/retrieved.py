"""The tiles that methods retrieved first, and which of them are positives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.report.places import Place
from airzoo_bench.report.sections import Section, tile_columns
from airzoo_bench.retrieval.pairs import hit_matrix

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Retrieved", "retrieved"]


@dataclass(frozen=True, eq=False)
class Retrieved:
    """First tiles of M methods on Q queries of a scene, at D ranks.

    Attributes
    ----------
    tiles : (M, Q, D) int32
        Rows of the scene's tiles; -1 where a list is shorter, or records do not say.
    hits : (M, Q, D) bool
        Which of them are positives of the query.
    """

    tiles: NDArray[np.int32]
    hits: NDArray[np.bool_]


def retrieved(section: Section, place: Place, rows: NDArray[np.intp]) -> Retrieved | None:
    """Find the first tiles of queries in the truth of their scene.

    Parameters
    ----------
    section : Section
    place : Place
    rows : (Q,) array
        Of the records; queries of this scene.

    Returns
    -------
    Retrieved or None
        None where there are no tiles, or no records tell of any.
    """
    found = [tile_columns(method.records.columns) for method in section.methods]
    depth = max(map(len, found))
    if place.tiles is None or place.positives is None or not depth:
        return None
    import pandas as pd

    index = pd.Index(place.tiles["id"])
    known = {query: row for row, query in enumerate(place.queries)}
    order = np.array([known[q] for q in section.methods[0].records["query"].iloc[rows]], np.intp)
    tiles = np.full((len(section.methods), len(rows), depth), -1, np.int32)
    hits = np.zeros(tiles.shape, np.bool_)
    # In the order of the truth, whose positives are looked up; a query is in it once.
    ranked = np.full((len(place.queries), depth), -1, np.int32)
    for number, (method, columns) in enumerate(zip(section.methods, found, strict=True)):
        tiles[number, :, : len(columns)] = _indices(method.records, columns, rows, index)
        ranked[order] = tiles[number]
        offsets, positives = place.positives.offsets, place.positives.tiles
        hits[number] = hit_matrix(ranked, offsets, positives, len(index))[order]
    return Retrieved(tiles, hits)


def _indices(
    records: pd.DataFrame, columns: Sequence[str], rows: NDArray[np.intp], index: pd.Index[str]
) -> NDArray[np.int32]:
    import pandas as pd

    found = np.full((len(rows), len(columns)), -1, np.int32)
    for rank, name in enumerate(columns):
        found[:, rank] = index.get_indexer(pd.Index(records[name].iloc[rows]))
    return found
