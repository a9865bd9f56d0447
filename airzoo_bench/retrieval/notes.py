"""Notes of the retrieval track: what a reader of its scores must know."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from airzoo_bench.core.errors import agreeing, counted, first_of
from airzoo_bench.evaluation.track import Scored
from airzoo_bench.retrieval.predictions import RetrievalPredictions
from airzoo_bench.retrieval.scene_predictions import ScenePredictions, strange_tiles
from airzoo_bench.retrieval.scores import retrieval_scores
from airzoo_bench.retrieval.settings import ImageScores, RetrievalProtocol, RetrievalScores
from airzoo_bench.retrieval.truth import UNANSWERED, RetrievalTruth

__all__ = ["list_facts", "retrieval_notes"]

_SHOWN_LETTERS = 80


def list_facts(
    predicted: ScenePredictions, scores: RetrievalScores | ImageScores
) -> dict[str, Any]:
    """Count the queries without a ranking, and by rank the lists that end before it."""
    flat = int((predicted.answered & (predicted.lengths == 0)).sum())
    ends = {scores.ranks_kept: predicted.shorter(scores.ranks_kept)}
    if isinstance(scores, RetrievalScores) and ends[scores.ranks_kept]:
        depths = [*scores.ndcg_at, *scores.recall_at, scores.ap_at]
        ends |= {k: predicted.shorter(k) for k in depths}
    return {"flat": flat, "shorter": {str(k): n for k, n in ends.items()}}


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
    left_out = protocol.gallery.dropped
    kinds = (
        ("empty_lists", "query has", "queries have", "an empty list, scored as if it were missing"),
        (
            *("tie_dependent", "query depends", "queries depend"),
            "on ties, which were broken against the method",
        ),
        ("flat", "query gives", "queries give", "all tiles the same score: no ranking, no hit"),
        ("dropped_tiles", f"tile {left_out} is", f"tiles {left_out} are", "in no gallery"),
    )
    return [
        *(f"{counted(sums[n], one, many)} {what}" for n, one, many, what in kinds if sums[n]),
        *_unanswered(truths),
        *_strange_tiles(predictions, truths),
        *_short_lists(shorter, protocol.scores),
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


def _short_lists(shorter: Mapping[str, int], scores: RetrievalScores | ImageScores) -> list[str]:
    """Name the scores that read ranks beyond the ends of lists; the paper's do not."""
    n = shorter[str(scores.ranks_kept)]
    if not n:
        return []
    if isinstance(scores, ImageScores):
        return [
            f"{counted(n, 'list ends', 'lists end')} without all positives: to AP and MRR the "
            "others are not found, which they are where the whole gallery is ranked"
        ]
    depths = [k for k in scores.ndcg_at if shorter[str(k)]]
    titles = [score.title for score in retrieval_scores(scores) if score.headline]
    reach = zip(titles, (*scores.recall_at, scores.ap_at), strict=True)
    cut = [title for title, k in reach if shorter[str(k)]]
    names = _and(["mAP", "MRR", *(f"nDCG@{k}" for k in depths), *cut])
    whole = [title for title in titles if title not in cut]
    others = f"; {_and(whole)} {agreeing(len(whole), 'does', 'do')} not look that far"
    return [
        f"{counted(n, 'list ends', 'lists end')} before rank {scores.ranks_kept} without all "
        f"positives: to {names} the others are not found{others * bool(whole)}"
    ]


def _and(names: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))
