"""What a retrieval method claims: ranked tile ids, or descriptors to be ranked.

The checks here need no truth; they are what ``airzoo-bench check`` runs and what ``eval`` runs
first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.errors import PredictionError, first_of

__all__ = [
    "FIELDS",
    "Descriptors",
    "RankedIds",
    "RetrievalPredictions",
    "faults",
    "scene_of",
]

FIELDS = (
    "protocol",
    "query_ids",
    "ranked_ids",
    "scores",
    "query_descriptors",
    "gallery_ids",
    "gallery_descriptors",
)

Texts = NDArray[np.str_]


@dataclass(frozen=True)
class RankedIds:
    """Ranked tile ids of each query, best first.

    Attributes
    ----------
    ids : (Q, K) str
        Tile ids; an empty text where a list is shorter than K.
    scores : (Q, K) float, optional
        Similarities (falling) or distances (rising); equal ones are ties.
    """

    ids: Texts
    scores: NDArray[np.float64] | None


@dataclass(frozen=True)
class Descriptors:
    """Descriptors of queries and tiles.

    Attributes
    ----------
    queries : (Q, D) float
    gallery_ids : (G,) str
    gallery : (G, D) float
        May be mapped from disk.
    """

    queries: NDArray[np.floating[Any]]
    gallery_ids: Texts
    gallery: NDArray[np.floating[Any]]


@dataclass(frozen=True)
class RetrievalPredictions:
    """A prediction file of the retrieval track, as read.

    Attributes
    ----------
    path : Path
    protocol : str or None
        The protocol that the file names.
    query_ids : (Q,) str
        ``scene/name``.
    claim : RankedIds or Descriptors
    """

    path: Path
    protocol: str | None
    query_ids: Texts
    claim: RankedIds | Descriptors

    @property
    def kind(self) -> str:
        """What the claim is, for results."""
        return "ranked_ids" if isinstance(self.claim, RankedIds) else "descriptors"


def scene_of(ids: Texts) -> Texts:
    """Return the scene part of ids ``scene/name``."""
    return np.char.partition(ids, "/")[..., 0]


def faults(predictions: RetrievalPredictions, ranks_needed: int) -> Iterator[PredictionError]:
    """Yield everything that is wrong with predictions and can be seen without truth.

    Parameters
    ----------
    predictions : RetrievalPredictions
        As read.
    ranks_needed : int
        How many ranks the protocol's scores read.
    """
    claim = predictions.claim
    checks = [partial(_check_ids, predictions, "query_ids")]
    if isinstance(claim, RankedIds):
        checks.append(partial(_check_depth, predictions, claim, ranks_needed))
        checks += [
            partial(check, predictions, claim)
            for check in (_check_gaps, _check_repeats, _check_scores)
        ]
    else:
        checks.append(partial(_check_ids, predictions, "gallery_ids"))
        checks.append(partial(_check_descriptors, predictions, claim))
    for check in checks:
        try:
            check()
        except PredictionError as error:
            yield error


def _check_ids(predictions: RetrievalPredictions, field: str) -> None:
    claim = predictions.claim
    ids = predictions.query_ids
    if field == "gallery_ids" and isinstance(claim, Descriptors):
        ids = claim.gallery_ids
    where = f"{predictions.path}, field '{field}'"
    unscened = np.flatnonzero(np.char.find(ids, "/") <= 0)
    if unscened.size:
        raise PredictionError(
            f"ids without a scene: {first_of(ids[unscened], len(ids))}",
            where=where,
            expected="scene/name, such as City/DJI_0001",
        )
    unique, counts = np.unique(ids, return_counts=True)
    if unique.size < ids.size:
        raise PredictionError(
            f"ids more than once: {first_of(unique[counts > 1], len(unique))}",
            where=where,
            expected="each id once",
            mend="keep one row of each",
        )


def _check_depth(predictions: RetrievalPredictions, claim: RankedIds, needed: int) -> None:
    if claim.ids.shape[1] < needed:
        raise PredictionError(
            f"ranks only {claim.ids.shape[1]} tiles a query",
            where=f"{predictions.path}, field 'ranked_ids'",
            expected=f"at least {needed}, the deepest rank that the protocol scores; where the "
            "gallery is smaller, fill with empty ids",
            mend="write more of the ranked list",
        )


def _check_gaps(predictions: RetrievalPredictions, claim: RankedIds) -> None:
    empty = claim.ids == ""
    gaps = np.flatnonzero((empty[:, :-1] & ~empty[:, 1:]).any(axis=1))
    if gaps.size:
        raise PredictionError(
            f"an empty id before a tile in the lists of {_rows(predictions, gaps)}",
            where=f"{predictions.path}, field 'ranked_ids'",
            expected="empty ids only at the end of a list that is shorter than the others",
        )


def _check_repeats(predictions: RetrievalPredictions, claim: RankedIds) -> None:
    ordered = np.sort(claim.ids, axis=1)
    same = (ordered[:, 1:] == ordered[:, :-1]) & (ordered[:, 1:] != "")
    rows = np.flatnonzero(same.any(axis=1))
    if rows.size:
        tile = ordered[rows[0], 1:][same[rows[0]]][0]
        raise PredictionError(
            f"a tile is ranked more than once in the lists of {_rows(predictions, rows)}; "
            f"the first repeats {tile}",
            where=f"{predictions.path}, field 'ranked_ids'",
            expected="each tile once a query",
            mend="keep each tile's best rank",
        )


def _check_scores(predictions: RetrievalPredictions, claim: RankedIds) -> None:
    if claim.scores is None:
        return
    bad = ~np.isfinite(claim.scores) & (claim.ids != "")
    rows = np.flatnonzero(bad.any(axis=1))
    if rows.size:
        raise PredictionError(
            f"NaN or infinite scores in the rows of {_rows(predictions, rows)}",
            where=f"{predictions.path}, field 'scores'",
            expected="a finite number for each ranked tile",
        )


def _check_descriptors(predictions: RetrievalPredictions, claim: Descriptors) -> None:
    if claim.queries.shape[1] != claim.gallery.shape[1]:
        raise PredictionError(
            f"query descriptors have {claim.queries.shape[1]} dimensions, gallery descriptors "
            f"{claim.gallery.shape[1]}",
            where=predictions.path,
            expected="the same number",
        )


def _rows(predictions: RetrievalPredictions, rows: NDArray[np.intp]) -> str:
    return first_of(predictions.query_ids[rows], len(predictions.query_ids)) + " queries"
