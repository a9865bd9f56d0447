"""Which scores the retrieval track has, and their columns in the records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.results.scores import Score
from airzoo_bench.retrieval import metrics
from airzoo_bench.retrieval.settings import ApVariant, ImageScores, RetrievalScores

__all__ = [
    "AP_VARIANTS",
    "RANKED_TILE",
    "RECORDED",
    "ap_name",
    "hit_columns",
    "recall_at_share_name",
    "retrieval_scores",
]

RANKED_TILE = "tile@"
"""How the columns begin that name the first tiles of each list."""

RECORDED = frozenset(
    (
        *("scene", "query", "answered", "positives", "tie_dependent", "first_hit_rank", "ranked"),
        f"{RANKED_TILE}*",
        "first_tile",  # what records before the columns of `RANKED_TILE` have
    )
)
"""Columns of the records that are neither scores nor conditions of the queries."""

AP_VARIANTS: tuple[ApVariant, ...] = ("precision", "min", "trec", "hits")


def ap_name(k: int, variant: str) -> str:
    """Name an AP variant: plain ``ap@5`` is mean precision at 5, every other carries its name."""
    return f"ap@{k}" if variant == "precision" else f"ap@{k}/{variant}"


def recall_at_share_name(share: float) -> str:
    """Name the score: ``recall@1%``."""
    return f"recall@{100 * share:g}%"


def retrieval_scores(settings: RetrievalScores | ImageScores) -> list[Score]:
    """Return the scores that a protocol asks for, the paper's first."""
    return _image_scores(settings) if isinstance(settings, ImageScores) else _tile_scores(settings)


def _image_scores(settings: ImageScores) -> list[Score]:
    ap, other = ("ap/trapezoid", "map") if settings.ap == "trapezoid" else ("map", "ap/trapezoid")
    share = recall_at_share_name(settings.recall_at_share)
    scores = [Score.share(f"recall@{k}", f"R@{k}", headline=True) for k in settings.recall_at]
    scores.append(Score.share(share, share.replace("recall", "R"), headline=True))
    scores.append(Score.share(ap, "AP", headline=True))
    near = settings.distances
    if near is not None:
        scores += [Score.share(f"sdm@{k}", f"SDM@{k}", headline=True) for k in near.sdm_at]
        scores += [
            Score(f"dis@{k}", f"Dis@{k}", "m", False, "mean", headline=True) for k in near.dis_at
        ]
        scores += [Score.share(f"ma@{m:g}m", f"MA@{m:g}m") for m in near.ma_below_m]
    names = {"map": "mAP", "ap/trapezoid": "AP/trapezoid"}
    return [*scores, Score.share(other, names[other]), Score.share("mrr", "MRR")]


def _tile_scores(settings: RetrievalScores) -> list[Score]:
    headline = [Score.share(f"recall@{k}", f"R@{k}", headline=True) for k in settings.recall_at]
    ap = ap_name(settings.ap_at, settings.ap)
    headline.append(Score.share(ap, ap.replace("ap", "AP"), headline=True))
    others = [ap_name(settings.ap_at, variant) for variant in AP_VARIANTS]
    beyond = [Score.share(name, name.replace("ap", "AP")) for name in others if name != ap]
    beyond += [Score.share("map", "mAP"), Score.share("mrr", "MRR")]
    beyond += [Score.share(f"ndcg@{k}", f"nDCG@{k}") for k in settings.ndcg_at]
    beyond.append(Score("distance_m", "Distance", "m", higher_is_better=False, average="median"))
    beyond += [Score.share(f"distance<{m:g}m", f"D<{m:g}m") for m in settings.distance_below_m]
    beyond += [Score.share(f"sdm@{k}", f"SDM@{k}") for k in settings.sdm_at]
    beyond += [Score.share(f"pdm@{k}", f"PDM@{k}") for k in settings.pdm_at]
    return headline + beyond


def hit_columns(
    hits: Bools,
    n_positives: Ints,
    *,
    recall_at: Sequence[int],
    ap_at: Mapping[int, Sequence[ApVariant]],
    ndcg_at: Sequence[int],
) -> dict[str, Floats]:
    """Return the columns of the records that follow from which ranks are hits."""
    columns = {f"recall@{k}": metrics.recall_at(hits, k) for k in recall_at}
    for k, variants in ap_at.items():
        for variant in variants:
            found = metrics.average_precision_at(hits, n_positives, k, variant)
            columns[ap_name(k, variant)] = found
    columns["map"] = metrics.average_precision(hits, n_positives)
    columns["mrr"] = metrics.reciprocal_rank(hits)
    return columns | {f"ndcg@{k}": metrics.ndcg_at(hits, n_positives, k) for k in ndcg_at}
