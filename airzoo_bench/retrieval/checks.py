"""Faults of predictions that need no truth, and notes on what readers of scores must know."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.core.ids import check_ids
from airzoo_bench.evaluation.track import Scored
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.retrieval.metrics import hit_matrix
from airzoo_bench.retrieval.predictions import Descriptors, RankedIds, RetrievalPredictions
from airzoo_bench.retrieval.ranking import Ranking
from airzoo_bench.retrieval.settings import ImageScores, RetrievalProtocol, TileScores
from airzoo_bench.retrieval.truth import UNANSWERED, RetrievalTruth

_CELLS = 1 << 20  # ranks at a time
_SHOWN_LETTERS = 80
_FAULTS_OF_LISTS = (  # field, what, expected, fix
    (
        *("ranked_ids", "an empty id before a tile in the lists of"),
        "empty ids only at the end of a list that is shorter than the others",
        "move the empty ids to the end",
    ),
    (
        *("ranked_ids", "a tile is ranked more than once in the lists of"),
        *("each tile once a query", "keep each tile's best rank"),
    ),
    (
        *("scores", "NaN or infinite scores in the rows of"),
        "a finite number for each ranked tile",
        "look for a division by zero or half precision, or leave the scores out",
    ),
    (
        *("scores", "scores are not in order for"),
        "similarities that never rise along a row, or distances that never fall, in all rows alike",
        "sort each query's tiles by its scores, best first",
    ),
)


def check_predictions(predictions: RetrievalPredictions) -> None:
    """Refuse predictions for faults that can be found without truth, and quickly."""
    content, where = predictions.content, f"{predictions.path}, field "
    check_ids(predictions.query_ids, f"{where}'query_ids'")
    if isinstance(content, RankedIds):
        try:
            check_lists(content.ids, content.scores, predictions.query_ids)
        except PredictionError as error:
            raise error.inside(predictions.path) from error
        return
    check_ids(content.gallery_ids, f"{where}'gallery_ids'")
    if content.queries.shape[1] != content.gallery.shape[1]:
        raise PredictionError(
            f"query descriptors have {content.queries.shape[1]} dimensions, gallery descriptors "
            f"{content.gallery.shape[1]}",
            where=f"{predictions.path}, fields 'query_descriptors' and 'gallery_descriptors'",
            expected="the same number",
            fix="describe photos and tiles with the same model",
        )


def check_lists(
    ids: NDArray[Any], scores: Floats | None, names: Sequence[object] | NDArray[Any]
) -> None:
    """Refuse faulty ranked lists (Q, K) of ids, or of indices as the Python face has.

    An empty id, or -1, ends a list. Scores may rise or fall, and the fewer rows are at fault.
    """
    interrupted, repeated, unusable, rises, falls = flags = np.zeros((5, len(ids)), np.bool_)
    ended = "" if ids.dtype.kind == "U" else -1
    step = max(1, _CELLS // max(1, ids.shape[1]))
    for part in (slice(start, start + step) for start in range(0, len(ids), step)):
        order, there = np.sort(ids[part], axis=1), ids[part] != ended
        interrupted[part] = (~there[:, :-1] & there[:, 1:]).any(axis=1)
        same = (order[:, 1:] == order[:, :-1]) & (order[:, 1:] != ended)
        repeated[part] = same.any(axis=1)
        if scores is not None:
            values = scores[part]
            finite = ~np.isnan(values) if ended == -1 else np.isfinite(values)
            unusable[part] = (~finite & there).any(axis=1)
            rises[part] = ((values[:, 1:] > values[:, :-1]) & there[:, 1:]).any(axis=1)
            falls[part] = ((values[:, 1:] < values[:, :-1]) & there[:, 1:]).any(axis=1)
    flags[3] = min(rises, falls, key=np.count_nonzero)
    for rows, (field, what, expected, fix) in zip(flags[:4], _FAULTS_OF_LISTS, strict=True):
        if rows.any():
            named = (names[row] for row in np.flatnonzero(rows).tolist())
            what = f"{what} {first_of(named, len(names), noun='query')}"
            raise PredictionError(what, where=f"field '{field}'", expected=expected, fix=fix)


def list_facts(
    truth: RetrievalTruth,
    ranking: Ranking,
    answered: Bools,
    settings: TileScores | ImageScores,
) -> dict[str, Any]:
    """Count the queries without a ranking, and the lists that end without all positives.

    `reached` is the last rank of the shortest of these lists.
    """
    positives, n_tiles = truth.positives, len(truth.tiles)
    lengths = np.count_nonzero(ranking.tiles >= 0, axis=1)
    lacking = lengths > 0
    if isinstance(settings, ImageScores):
        lost = ranking.hit_ranks == 0
        lacking &= np.bincount(positives.queries, lost, positives.n_queries) > 0
    else:
        hits = hit_matrix(ranking.tiles, positives.offsets, positives.tiles, n_tiles)
        lacking &= np.count_nonzero(hits, axis=1) < positives.counts
        lacking &= lengths < min(settings.ranks_kept, n_tiles)
    return {
        "flat": int((answered & (lengths == 0)).sum()),
        "shorter": int(lacking.sum()),
        "reached": int(lengths[lacking].min(initial=n_tiles)),
    }


def retrieval_notes(
    predictions: RetrievalPredictions,
    truths: Sequence[RetrievalTruth],
    scored: Sequence[Scored],
    protocol: RetrievalProtocol,
) -> list[str]:
    """Return what `eval` and `check` note besides the scores."""
    sums: Counter[str] = Counter()
    for scene in scored:
        sums.update(scene.counts | scene.facts)
    left_out, against = protocol.gallery.dropped, "on ties, which were broken against the method"
    kinds = (
        ("empty_lists", "query has", "queries have", "an empty list, scored as if it were missing"),
        ("tie_dependent", "query depends", "queries depend", against),
        ("flat", "query gives", "queries give", "all tiles the same score: no ranking, no hit"),
        ("dropped_tiles", f"tile {left_out} is", f"tiles {left_out} are", "in no gallery"),
    )
    notes = [f"{counted(sums[n], one, many)} {what}" for n, one, many, what in kinds if sums[n]]
    tables = [truth.excluded for truth in truths]
    unanswered = [one for some in tables for one in some["id"][some["reason"] == UNANSWERED]]
    if unanswered:
        notes.append(f"queries that no tile answers, left out: {first_of(unanswered)}")
    if isinstance(predictions.content, Descriptors):
        given = predictions.content.gallery_ids
        known = np.concatenate([truth.tiles["id"].to_numpy(str) for truth in truths])
        # Cut, since ids of a file may be long, and notes stand under tables.
        strange = [name[:_SHOWN_LETTERS] for name in given[~np.isin(given, known)].tolist()]
        if strange:
            named = first_of(strange)
            notes.append(f"described tiles that are in no gallery, left aside: {named}")
    if sums["shorter"]:
        ending = counted(sums["shorter"], "list ends", "lists end")
        reached = min(scene.facts["reached"] for scene in scored if scene.facts["shorter"])
        notes.append(
            f"{ending} without all positives, the shortest after rank {reached}: to scores that "
            "read deeper (mAP, MRR) the others are not found"
        )
    return notes
