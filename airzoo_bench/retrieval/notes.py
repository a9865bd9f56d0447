"""Notes of the retrieval track: what a reader of its scores must know."""

from __future__ import annotations

from collections.abc import Sequence

from airzoo_bench.core.errors import first_of
from airzoo_bench.core.plurals import agreeing, counted
from airzoo_bench.retrieval.predictions import RetrievalPredictions
from airzoo_bench.retrieval.scene_predictions import ScenePredictions, strange_tiles
from airzoo_bench.retrieval.scores import retrieval_scores
from airzoo_bench.retrieval.settings import ImageScores, RetrievalProtocol, RetrievalScores
from airzoo_bench.retrieval.truth import UNANSWERED, RetrievalTruth

__all__ = ["retrieval_notes"]

_SHOWN_LETTERS = 80


def retrieval_notes(
    predictions: RetrievalPredictions,
    scenes: Sequence[ScenePredictions],
    protocol: RetrievalProtocol,
) -> list[str]:
    """Return what `eval` and `check` note besides the scores."""
    counts = [scene.counts for scene in scenes]
    empty = sum(count["empty_lists"] for count in counts)
    tied = sum(count["tie_dependent"] for count in counts)
    flat = sum(int((scene.answered & (scene.lengths == 0)).sum()) for scene in scenes)
    dropped = sum(count["dropped_tiles"] for count in counts)
    left_out = protocol.gallery.dropped
    kinds = (
        (empty, "query has", "queries have", "an empty list, scored as if it were missing"),
        (tied, "query depends", "queries depend", "on ties, which were broken against the method"),
        (flat, "query gives", "queries give", "all tiles the same score: no ranking, no hit"),
        (dropped, f"tile {left_out} is", f"tiles {left_out} are", "in no gallery"),
    )
    return [
        *(f"{counted(n, one, many)} {what}" for n, one, many, what in kinds if n),
        *_unanswered([scene.truth for scene in scenes]),
        *_strange_tiles(predictions, [scene.truth for scene in scenes]),
        *_short_lists(scenes, protocol.scores),
    ]


def _unanswered(truths: Sequence[RetrievalTruth]) -> list[str]:
    tables = [truth.excluded for truth in truths]
    named = [one for some in tables for one in some["id"][some["reason"] == UNANSWERED]]
    return [f"queries that no tile answers, left out: {first_of(named)}"] if named else []


def _strange_tiles(
    predictions: RetrievalPredictions, truths: Sequence[RetrievalTruth]
) -> list[str]:
    strange = strange_tiles(predictions, truths)
    # Cut, since ids of a file may be long, and notes stand under tables.
    named = first_of(name[:_SHOWN_LETTERS] for name in strange.tolist())
    return [f"described tiles that are in no gallery, left aside: {named}"] if strange.size else []


def _short_lists(
    scenes: Sequence[ScenePredictions], scores: RetrievalScores | ImageScores
) -> list[str]:
    """Name the scores that read ranks beyond the ends of lists; the paper's do not."""
    n = sum(scene.shorter(scores.ranks_kept) for scene in scenes)
    if not n:
        return []
    if isinstance(scores, ImageScores):
        return [
            f"{counted(n, 'list ends', 'lists end')} without all positives: to AP and MRR the "
            "others are not found, which they are where the whole gallery is ranked"
        ]
    depths = [k for k in scores.ndcg_at if any(scene.shorter(k) for scene in scenes)]
    titles = [score.title for score in retrieval_scores(scores) if score.headline]
    reach = zip(titles, (*scores.recall_at, scores.ap_at), strict=True)
    cut = [title for title, k in reach if any(scene.shorter(k) for scene in scenes)]
    names = _and(["mAP", "MRR", *(f"nDCG@{k}" for k in depths), *cut])
    whole = [title for title in titles if title not in cut]
    others = f"; {_and(whole)} {agreeing(len(whole), 'does', 'do')} not look that far"
    return [
        f"{counted(n, 'list ends', 'lists end')} before rank {scores.ranks_kept} without all "
        f"positives: to {names} the others are not found{others * bool(whole)}"
    ]


def _and(names: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))
