"""Predictions of the retrieval track, ranked tile ids or descriptors, and their validation.

The checks here need no truth; ``airzoo-bench check`` runs them, and ``eval`` runs them first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.core.ids import check_ids, scene_of
from airzoo_bench.evaluation.queries import QueryPredictions, errors_of
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.retrieval.descriptor_rows import Rows, as_float32, rows_of
from airzoo_bench.retrieval.similarity import (
    Metric,
    finite_rows,
    norms_of,
    refuse_unusable,
    unusable,
)

__all__ = [
    "Descriptors",
    "RankedIds",
    "RetrievalPredictions",
    "deep_validation_errors",
    "validation_errors",
]

Texts = NDArray[np.str_]

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

    kind: ClassVar[str] = "ranked_ids"

    ids: Texts
    scores: Floats | None


@dataclass(frozen=True)
class Descriptors:
    """Descriptors of queries (Q, D) and of tiles (G, D).

    Those of tiles may be mapped from disk, or from several files.
    """

    kind: ClassVar[str] = "descriptors"

    queries: NDArray[np.floating[Any]]
    gallery_ids: Texts
    gallery: NDArray[np.floating[Any]] | Rows


RetrievalPredictions = QueryPredictions[RankedIds | Descriptors]
"""A prediction file of the retrieval track, as read."""


def validation_errors(predictions: RetrievalPredictions) -> Iterator[PredictionError]:
    """Yield the errors of predictions that can be found without truth."""
    content = predictions.content
    where = f"{predictions.path}, field "
    checks = [partial(check_ids, predictions.query_ids, f"{where}'query_ids'")]
    if isinstance(content, RankedIds):
        checks += [
            partial(check, predictions, content)
            for check in (_check_gaps, _check_repeats, _check_scores, _check_order)
        ]
    else:
        checks.append(partial(check_ids, content.gallery_ids, f"{where}'gallery_ids'"))
        checks.append(partial(_check_descriptors, predictions, content))
    yield from errors_of(checks)


def deep_validation_errors(
    predictions: RetrievalPredictions, metric: Metric, scenes: Sequence[str]
) -> Iterator[PredictionError]:
    """Yield further errors, which scoring would find by itself."""
    content = predictions.content
    if isinstance(content, RankedIds):
        yield from errors_of([partial(_check_scenes, predictions, content, scenes)])
        return
    queries = ("query_descriptors", content.queries, predictions.query_ids)
    gallery = ("gallery_descriptors", content.gallery, content.gallery_ids)
    parts = (queries, gallery)
    metrics: tuple[Metric, Metric] = ("l2", metric)  # a query of zeros ties with every tile
    yield from errors_of(
        [
            partial(_check_rankable, predictions, one, *part)
            for one, part in zip(metrics, parts, strict=True)
        ]
    )


def _check_gaps(predictions: RetrievalPredictions, ranked: RankedIds) -> None:
    def interrupted(ids: Texts) -> Bools:
        empty = ids == ""
        found: Bools = (empty[:, :-1] & ~empty[:, 1:]).any(axis=1)
        return found

    rows = _rows_where(ranked, lambda part: interrupted(ranked.ids[part]))
    if rows.size:
        raise PredictionError(
            f"an empty id before a tile in the lists of {_rows(predictions, rows)}",
            where=f"{predictions.path}, field 'ranked_ids'",
            expected="empty ids only at the end of a list that is shorter than the others",
            fix="move the empty ids to the end",
        )


def _check_repeats(predictions: RetrievalPredictions, ranked: RankedIds) -> None:
    def repeated(ids: Texts) -> Texts:
        ordered = np.sort(ids, axis=1)
        same = (ordered[:, 1:] == ordered[:, :-1]) & (ordered[:, 1:] != "")
        return np.where(same, ordered[:, 1:], "")

    rows = _rows_where(ranked, lambda part: (repeated(ranked.ids[part]) != "").any(axis=1))
    if rows.size:
        twice = repeated(ranked.ids[rows[:1]])[0]
        raise PredictionError(
            f"a tile is ranked more than once in the lists of {_rows(predictions, rows)}; "
            f"the first repeats {twice[twice != ''][0]}",
            where=f"{predictions.path}, field 'ranked_ids'",
            expected="each tile once a query",
            fix="keep each tile's best rank",
        )


def _check_scores(predictions: RetrievalPredictions, ranked: RankedIds) -> None:
    if ranked.scores is None:
        return
    scores = ranked.scores
    rows = _rows_where(
        ranked,
        lambda part: (~np.isfinite(scores[part]) & (ranked.ids[part] != "")).any(axis=1),
    )
    if rows.size:
        raise PredictionError(
            f"NaN or infinite scores in the rows of {_rows(predictions, rows)}",
            where=f"{predictions.path}, field 'scores'",
            expected="a finite number for each ranked tile",
            fix="look for a division by zero or half precision, or leave the scores out",
        )


def _check_scenes(
    predictions: RetrievalPredictions, ranked: RankedIds, scenes: Sequence[str]
) -> None:
    own = scene_of(predictions.query_ids)[:, None]
    known = np.isin(own, scenes)

    def strange(part: slice | NDArray[np.intp]) -> Bools:
        other = (scene_of(ranked.ids[part]) != own[part]) & (ranked.ids[part] != "")
        found: Bools = other & known[part]
        return found

    rows = _rows_where(ranked, lambda part: np.any(strange(part), axis=1))
    if rows.size:
        tile, scene = str(ranked.ids[rows[0]][strange(rows[:1])[0]][0]), own[rows[0], 0]
        raise PredictionError(
            f"tiles of another scene are ranked for {_rows(predictions, rows)}; the first is "
            f"{tile!r}",
            where=f"{predictions.path}, field 'ranked_ids'",
            expected=f"tiles of the query's own scene, such as {scene}/...",
            fix="rank each query against the gallery of its own scene only"
            if "/" in tile
            else f"put the scene before each tile: {scene}/{tile}",
        )


def _check_order(predictions: RetrievalPredictions, ranked: RankedIds) -> None:
    if ranked.scores is None:
        return
    scores = ranked.scores

    def turning(part: slice, *, rising: bool) -> Bools:
        before, after = scores[part, :-1], scores[part, 1:]
        steps = after > before if rising else after < before
        found: Bools = (steps & (ranked.ids[part, 1:] != "")).any(axis=1)
        return found

    rises = _rows_where(ranked, lambda part: turning(part, rising=True))
    falls = _rows_where(ranked, lambda part: turning(part, rising=False))
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
    rows: NDArray[np.floating[Any]] | Rows,
    ids: Texts,
) -> None:
    step = max(1, _BLOCK_BYTES // max(1, rows.shape[1] * rows.itemsize))
    faults = [unusable(np.zeros(0), np.isfinite, metric)]
    for start, some in rows_of(rows).blocks(step):
        norms = norms_of(some, as_float32(some))
        found = unusable(norms, partial(finite_rows, some), metric)
        faults.append({fault: bad + start for fault, bad in found.items()})
    every = {fault: np.concatenate([one[fault] for one in faults]) for fault in faults[0]}
    try:
        refuse_unusable(every, len(rows), field, ids)
    except PredictionError as error:
        raise error.inside(predictions.path) from error


def _check_descriptors(predictions: RetrievalPredictions, described: Descriptors) -> None:
    if described.queries.shape[1] != described.gallery.shape[1]:
        raise PredictionError(
            f"query descriptors have {described.queries.shape[1]} dimensions, gallery descriptors "
            f"{described.gallery.shape[1]}",
            where=f"{predictions.path}, fields 'query_descriptors' and 'gallery_descriptors'",
            expected="the same number",
            fix="describe photos and tiles with the same model",
        )


def _rows(predictions: RetrievalPredictions, rows: NDArray[np.intp]) -> str:
    ids = predictions.query_ids
    return first_of(ids[rows], len(ids), noun="query")


def _rows_where(ranked: RankedIds, test: Callable[[slice], Bools]) -> NDArray[np.intp]:
    """Find the rows for which a test holds; it sees a part of them at a time."""
    step = max(1, _CELLS // max(1, ranked.ids.shape[1]))
    parts = [test(slice(start, start + step)) for start in range(0, len(ranked.ids), step)]
    return np.flatnonzero(np.concatenate([np.zeros(0, np.bool_), *parts]))
