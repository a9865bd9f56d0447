"""Faults of predictions that need no truth, and notes on what readers of scores must know."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, agreeing, counted, first_of
from airzoo_bench.core.ids import check_ids, scene_of
from airzoo_bench.evaluation.queries import errors_of
from airzoo_bench.evaluation.track import Scored
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.retrieval.descriptors import Metric, Rows, check_descriptors
from airzoo_bench.retrieval.metrics import hit_matrix
from airzoo_bench.retrieval.predictions import Descriptors, RankedIds, RetrievalPredictions
from airzoo_bench.retrieval.ranking import Ranking
from airzoo_bench.retrieval.scoring import retrieval_scores
from airzoo_bench.retrieval.settings import ImageScores, RetrievalProtocol, RetrievalScores
from airzoo_bench.retrieval.truth import UNANSWERED, RetrievalTruth

__all__ = [
    "deep_validation_errors",
    "list_errors",
    "list_facts",
    "retrieval_notes",
    "validation_errors",
]

_CELLS = 1 << 20  # ranks at a time
_SHOWN_LETTERS = 80


def validation_errors(predictions: RetrievalPredictions) -> Iterator[PredictionError]:
    """Yield the errors of predictions that can be found without truth, and quickly."""
    content, where = predictions.content, f"{predictions.path}, field "
    yield from errors_of([partial(check_ids, predictions.query_ids, f"{where}'query_ids'")])
    if isinstance(content, RankedIds):
        for error in list_errors(content.ids, content.scores, predictions.query_ids):
            yield error.inside(predictions.path)
        return
    yield from errors_of([partial(check_ids, content.gallery_ids, f"{where}'gallery_ids'")])
    if content.queries.shape[1] != content.gallery.shape[1]:
        yield PredictionError(
            f"query descriptors have {content.queries.shape[1]} dimensions, gallery descriptors "
            f"{content.gallery.shape[1]}",
            where=f"{predictions.path}, fields 'query_descriptors' and 'gallery_descriptors'",
            expected="the same number",
            fix="describe photos and tiles with the same model",
        )


def list_errors(
    ids: NDArray[Any], scores: Floats | None, names: Sequence[object] | NDArray[Any]
) -> Iterator[PredictionError]:
    """Yield what is wrong with ranked lists (Q, K) of ids, or of indices as the Python face has.

    An empty id, or -1, ends a list.
    """
    ended = "" if ids.dtype.kind == "U" else -1
    numbers = np.zeros((len(ids), 0)) if scores is None else scores

    def interrupted(part: slice) -> Any:
        empty = ids[part] == ended
        return empty[:, :-1] & ~empty[:, 1:]

    def repeated(part: slice) -> Any:
        order = np.sort(ids[part], axis=1)
        return (order[:, 1:] == order[:, :-1]) & (order[:, 1:] != ended)

    def unusable(part: slice) -> Any:
        bad = np.isnan(numbers[part]) if ended == -1 else ~np.isfinite(numbers[part])
        return bad & (ids[part] != ended)[:, : bad.shape[1]]

    def turning(part: slice, sign: int) -> Any:
        with np.errstate(invalid="ignore"):
            steps = sign * numbers[part, 1:] > sign * numbers[part, :-1]
        return steps & (ids[part, 1:] != ended)[:, : steps.shape[1]]

    for test, field, what, expected, fix in (
        (
            *(interrupted, "ranked_ids", "an empty id before a tile in the lists of"),
            "empty ids only at the end of a list that is shorter than the others",
            "move the empty ids to the end",
        ),
        (
            *(repeated, "ranked_ids", "a tile is ranked more than once in the lists of"),
            *("each tile once a query", "keep each tile's best rank"),
        ),
        (
            *(unusable, "scores", "NaN or infinite scores in the rows of"),
            "a finite number for each ranked tile",
            "look for a division by zero or half precision, or leave the scores out",
        ),
    ):
        rows = _rows_where(ids, test)
        if rows.size:
            what = f"{what} {_name_queries(names, rows)}"
            yield PredictionError(what, where=f"field '{field}'", expected=expected, fix=fix)
    rises, falls = (_rows_where(ids, partial(turning, sign=sign)) for sign in (1, -1))
    if rises.size and falls.size:  # the direction of most rows is meant
        yield PredictionError(
            f"scores are not in order for {_name_queries(names, min(rises, falls, key=len))}",
            where="field 'scores'",
            expected="similarities that never rise along a row, or distances that never fall, in "
            "all rows alike",
            fix="sort each query's tiles by its scores, best first",
        )


def _rows_where(ids: NDArray[Any], test: Callable[[slice], Any]) -> NDArray[np.intp]:
    """Find the rows with a place where a test holds; it sees a part of the rows at a time."""
    step = max(1, _CELLS // max(1, ids.shape[1]))
    parts = [test(slice(start, start + step)).any(axis=1) for start in range(0, len(ids), step)]
    return np.flatnonzero(np.concatenate([np.zeros(0, np.bool_), *parts]))


def _name_queries(names: Sequence[object] | NDArray[Any], rows: NDArray[np.intp]) -> str:
    return first_of((names[row] for row in rows.tolist()), len(names), noun="query")


def deep_validation_errors(
    predictions: RetrievalPredictions, metric: Metric, scenes: Sequence[str]
) -> Iterator[PredictionError]:
    """Yield further errors, which scoring would find by itself."""
    content, ids = predictions.content, predictions.query_ids
    if isinstance(content, RankedIds):
        checks = [partial(_check_scenes, content.ids, ids, scenes)]
    else:  # a query of zeros ties with every tile, whatever the metric
        queries, gallery = Rows.join(content.queries), content.gallery
        checks = [
            partial(check_descriptors, queries, "query_descriptors", "l2", ids),
            partial(check_descriptors, gallery, "gallery_descriptors", metric, content.gallery_ids),
        ]
    for error in errors_of(checks):
        yield error.inside(predictions.path)


def _check_scenes(
    ranked: NDArray[np.str_], query_ids: NDArray[np.str_], scenes: Sequence[str]
) -> None:
    """Refuse lists that rank tiles of another scene."""
    own = scene_of(query_ids)[:, None]
    known = np.isin(own, scenes)

    def strange(part: slice) -> Any:
        return (scene_of(ranked[part]) != own[part]) & (ranked[part] != "") & known[part]

    rows = _rows_where(ranked, strange)
    if rows.size:
        one = slice(rows[0], rows[0] + 1)
        tile, scene = str(ranked[one][strange(one)][0]), own[rows[0], 0]
        raise PredictionError(
            f"tiles of another scene are ranked for {_name_queries(query_ids, rows)}; the first is "
            f"{tile!r}",
            where="field 'ranked_ids'",
            expected=f"tiles of the query's own scene, such as {scene}/...",
            fix="rank each query against the gallery of its own scene only"
            if "/" in tile
            else f"put the scene before each tile: {scene}/{tile}",
        )


def list_facts(
    truth: RetrievalTruth,
    ranking: Ranking,
    answered: Bools,
    settings: RetrievalScores | ImageScores,
) -> dict[str, Any]:
    """Count the queries without a ranking, and by rank the lists that end before it.

    Counted are lists that do not hold all positives, so that a score of that depth misses some.
    """
    positives, n_tiles = truth.positives, len(truth.tiles)
    lengths = np.count_nonzero(ranking.tiles >= 0, axis=1)
    facts = {"flat": int((answered & (lengths == 0)).sum())}
    if isinstance(settings, ImageScores):
        unranked = np.bincount(positives.queries, ranking.hit_ranks == 0, positives.n_queries) > 0
        return facts | {
            "shorter": {str(settings.ranks_kept): int((unranked & (lengths > 0)).sum())}
        }
    hits = hit_matrix(ranking.tiles, positives.offsets, positives.tiles, n_tiles)
    lacking = (lengths > 0) & (np.count_nonzero(hits, axis=1) < positives.counts)
    depths = (settings.ranks_kept, *settings.ndcg_at, *settings.recall_at, settings.ap_at)
    ends = {str(k): int((lacking & (lengths < min(k, n_tiles))).sum()) for k in depths}
    return facts | {"shorter": ends}


def retrieval_notes(
    predictions: RetrievalPredictions,
    truths: Sequence[RetrievalTruth],
    scored: Sequence[Scored],
    protocol: RetrievalProtocol,
) -> list[str]:
    """Return what `eval` and `check` note besides the scores."""
    sums: Counter[str] = Counter()
    shorter: Counter[str] = Counter()
    for scene in scored:
        sums.update(scene.counts | {"flat": scene.facts["flat"]})
        shorter.update(scene.facts["shorter"])
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
    return notes + _short_lists(shorter, protocol.scores)


def _short_lists(shorter: Counter[str], scores: RetrievalScores | ImageScores) -> list[str]:
    """Name the scores that read ranks beyond the ends of lists; the paper's do not."""
    n = shorter[str(scores.ranks_kept)]
    if not n:
        return []
    ending = counted(n, "list ends", "lists end")
    if isinstance(scores, ImageScores):
        return [
            f"{ending} without all positives: to AP and MRR the others are not found, which they "
            "are where the whole gallery is ranked"
        ]
    titles = [score.title for score in retrieval_scores(scores) if score.headline]
    reach = {f"nDCG@{k}": k for k in scores.ndcg_at}
    reach |= dict(zip(titles, (*scores.recall_at, scores.ap_at), strict=True))
    cut = ["mAP", "MRR", *(title for title, k in reach.items() if shorter[str(k)])]
    whole = [title for title in titles if title not in cut]
    others = f"; {_and(whole)} {agreeing(len(whole), 'does', 'do')} not look that far"
    return [
        f"{ending} before rank {scores.ranks_kept} without all positives: to {_and(cut)} the "
        f"others are not found{others * bool(whole)}"
    ]


def _and(names: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))
