"""What a retrieval method claims: ranked tile ids, or descriptors to be ranked.

The checks here need no truth; they are what ``airzoo-bench check`` runs and what ``eval`` runs
first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.core.ids import check_ids, scene_of
from airzoo_bench.retrieval.descriptor_rows import as_float32
from airzoo_bench.retrieval.similarity import Metric, check_norms, norms_of

__all__ = [
    "Descriptors",
    "RankedIds",
    "RetrievalPredictions",
    "deep_validation_errors",
    "validation_errors",
]

Texts = NDArray[np.str_]
Bools = NDArray[np.bool_]

_BLOCK_BYTES = 1 << 26
_CELLS = 1 << 20  # ranks at a time


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


def validation_errors(
    predictions: RetrievalPredictions, ranks_needed: int
) -> Iterator[PredictionError]:
    """Yield everything that is wrong with predictions and can be seen without truth.

    Parameters
    ----------
    predictions : RetrievalPredictions
        As read.
    ranks_needed : int
        How many ranks the protocol's scores read.
    """
    claim = predictions.claim
    where = f"{predictions.path}, field '%s_ids'"
    checks = [partial(check_ids, predictions.query_ids, where % "query")]
    if isinstance(claim, RankedIds):
        checks.append(partial(_check_depth, predictions, claim, ranks_needed))
        checks += [
            partial(check, predictions, claim)
            for check in (_check_gaps, _check_repeats, _check_scores, _check_order)
        ]
    else:
        checks.append(partial(check_ids, claim.gallery_ids, where % "gallery"))
        checks.append(partial(_check_descriptors, predictions, claim))
    yield from _raised(checks)


def deep_validation_errors(
    predictions: RetrievalPredictions, metric: Metric, scenes: Sequence[str]
) -> Iterator[PredictionError]:
    """Yield what else can be seen without truth, and what scoring finds by itself.

    Reads descriptors through, which for a mapped gallery takes as long as its file is large.

    Parameters
    ----------
    predictions : RetrievalPredictions
        As read.
    metric : Metric
        The protocol's, for descriptors.
    scenes : sequence of str
        The protocol's; queries of others are left aside.
    """
    claim = predictions.claim
    if isinstance(claim, RankedIds):
        yield from _raised([partial(_check_scenes, predictions, claim, scenes)])
        return
    queries = ("query_descriptors", claim.queries, predictions.query_ids)
    gallery = ("gallery_descriptors", claim.gallery, claim.gallery_ids)
    parts = (queries, gallery)
    yield from _raised([partial(_check_rankable, predictions, metric, *part) for part in parts])


def _raised(checks: Sequence[Callable[[], None]]) -> Iterator[PredictionError]:
    for check in checks:
        try:
            check()
        except PredictionError as error:
            yield error


def _check_depth(predictions: RetrievalPredictions, claim: RankedIds, needed: int) -> None:
    if claim.ids.shape[1] < needed:
        raise PredictionError(
            f"ranks only {claim.ids.shape[1]} tiles a query",
            where=f"{predictions.path}, field 'ranked_ids'",
            expected=f"at least {needed}, the deepest rank that the protocol scores; where the "
            "gallery is smaller, fill with empty ids",
            fix="write more of the ranked list",
        )


def _check_gaps(predictions: RetrievalPredictions, claim: RankedIds) -> None:
    def gapped(ids: Texts) -> Bools:
        empty = ids == ""
        found: Bools = (empty[:, :-1] & ~empty[:, 1:]).any(axis=1)
        return found

    gaps = _rows_where(claim, lambda part: gapped(claim.ids[part]))
    if gaps.size:
        raise PredictionError(
            f"an empty id before a tile in the lists of {_rows(predictions, gaps)}",
            where=f"{predictions.path}, field 'ranked_ids'",
            expected="empty ids only at the end of a list that is shorter than the others",
            fix="close the gaps",
        )


def _check_repeats(predictions: RetrievalPredictions, claim: RankedIds) -> None:
    def repeated(ids: Texts) -> Texts:
        ordered = np.sort(ids, axis=1)
        same = (ordered[:, 1:] == ordered[:, :-1]) & (ordered[:, 1:] != "")
        return np.where(same, ordered[:, 1:], "")

    rows = _rows_where(claim, lambda part: (repeated(claim.ids[part]) != "").any(axis=1))
    if rows.size:
        twice = repeated(claim.ids[rows[:1]])[0]
        raise PredictionError(
            f"a tile is ranked more than once in the lists of {_rows(predictions, rows)}; "
            f"the first repeats {twice[twice != ''][0]}",
            where=f"{predictions.path}, field 'ranked_ids'",
            expected="each tile once a query",
            fix="keep each tile's best rank",
        )


def _check_scores(predictions: RetrievalPredictions, claim: RankedIds) -> None:
    if claim.scores is None:
        return
    scores = claim.scores
    rows = _rows_where(
        claim,
        lambda part: (~np.isfinite(scores[part]) & (claim.ids[part] != "")).any(axis=1),
    )
    if rows.size:
        raise PredictionError(
            f"NaN or infinite scores in the rows of {_rows(predictions, rows)}",
            where=f"{predictions.path}, field 'scores'",
            expected="a finite number for each ranked tile",
            fix="look for a division by zero or half precision, or leave the scores out",
        )


def _check_scenes(
    predictions: RetrievalPredictions, claim: RankedIds, scenes: Sequence[str]
) -> None:
    own = scene_of(predictions.query_ids)[:, None]
    known = np.isin(own, scenes)

    def strange(part: slice | NDArray[np.intp]) -> Bools:
        other = (scene_of(claim.ids[part]) != own[part]) & (claim.ids[part] != "")
        found: Bools = other & known[part]
        return found

    rows = _rows_where(claim, lambda part: np.any(strange(part), axis=1))
    if rows.size:
        tile, scene = str(claim.ids[rows[0]][strange(rows[:1])[0]][0]), own[rows[0], 0]
        raise PredictionError(
            f"tiles of another scene are ranked for {_rows(predictions, rows)}; the first is "
            f"{tile!r}",
            where=f"{predictions.path}, field 'ranked_ids'",
            expected=f"tiles of the query's own scene, such as {scene}/...",
            fix="rank each query against the gallery of its own scene only"
            if "/" in tile
            else f"put the scene before each tile: {scene}/{tile}",
        )


def _check_order(predictions: RetrievalPredictions, claim: RankedIds) -> None:
    if claim.scores is None:
        return
    scores = claim.scores

    def turning(part: slice, *, rising: bool) -> Bools:
        before, after = scores[part, :-1], scores[part, 1:]
        steps = after > before if rising else after < before
        found: Bools = (steps & (claim.ids[part, 1:] != "")).any(axis=1)
        return found

    rises = _rows_where(claim, lambda part: turning(part, rising=True))
    falls = _rows_where(claim, lambda part: turning(part, rising=False))
    if not (rises.size and falls.size):
        return
    raise PredictionError(
        f"scores are not in order for {_rows(predictions, min(rises, falls, key=len))}",
        where=f"{predictions.path}, field 'scores'",
        expected="similarities that never rise along a row, or distances that never fall, in all "
        "rows alike",
        fix="sort each query's tiles by its scores, best first",
    )


def _check_rankable(
    predictions: RetrievalPredictions,
    metric: Metric,
    field: str,
    rows: NDArray[np.floating[Any]],
    ids: Texts,
) -> None:
    step = max(1, _BLOCK_BYTES // max(1, rows.shape[1] * rows.itemsize))
    norms = np.empty(len(rows))
    for start in range(0, len(rows), step):
        some = rows[start : start + step]
        norms[start : start + step] = norms_of(some, as_float32(some))
    try:
        check_norms(norms, lambda bad: np.isfinite(rows[bad]).all(axis=1), field, metric, ids)
    except PredictionError as error:
        raise error.inside(predictions.path) from error


def _check_descriptors(predictions: RetrievalPredictions, claim: Descriptors) -> None:
    if claim.queries.shape[1] != claim.gallery.shape[1]:
        raise PredictionError(
            f"query descriptors have {claim.queries.shape[1]} dimensions, gallery descriptors "
            f"{claim.gallery.shape[1]}",
            where=f"{predictions.path}, fields 'query_descriptors' and 'gallery_descriptors'",
            expected="the same number",
            fix="describe photos and tiles with the same model",
        )


def _rows(predictions: RetrievalPredictions, rows: NDArray[np.intp]) -> str:
    ids = predictions.query_ids
    return first_of(ids[rows], len(ids), noun="query")


def _rows_where(claim: RankedIds, test: Callable[[slice], Bools]) -> NDArray[np.intp]:
    """Find the rows for which a test holds; it sees a part of them at a time."""
    step = max(1, _CELLS // max(1, claim.ids.shape[1]))
    parts = [test(slice(start, start + step)) for start in range(0, len(claim.ids), step)]
    return np.flatnonzero(np.concatenate([np.zeros(0, np.bool_), *parts]))
