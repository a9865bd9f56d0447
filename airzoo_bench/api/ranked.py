"""From rankings to scores of queries."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from airzoo_bench.api.arrays import choice, floats, listed, whole
from airzoo_bench.api.ids import Ids, id_row
from airzoo_bench.api.scores import QueryScores
from airzoo_bench.core.errors import ArgumentError
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.retrieval import metrics
from airzoo_bench.retrieval.pairs import Positives, hit_matrix
from airzoo_bench.retrieval.scores import hit_columns
from airzoo_bench.retrieval.settings import ApVariant
from airzoo_bench.retrieval.ties import Ranking

__all__ = ["Asked", "WithoutPositive", "gallery_row", "rank_scores", "score_rows"]

WithoutPositive = Literal["exclude", "miss"]


@dataclass(frozen=True)
class Asked:
    """Which scores are asked for."""

    ks: tuple[int, ...]
    ap: ApVariant
    without_positive: WithoutPositive

    @classmethod
    def checked(cls, ks: Iterable[int], ap: ApVariant, without_positive: WithoutPositive) -> Asked:
        """Refuse ranks below 1, and settings that there are not."""
        choice("ap", ap, get_args(ApVariant))
        choice("without_positive", without_positive, get_args(WithoutPositive))
        depths = tuple(dict.fromkeys(whole("ks", k) for k in listed("ks", ks)))
        if not depths:
            raise ArgumentError("is empty", where="ks", expected="ranks such as (1, 5, 10)")
        return cls(depths, ap, without_positive)

    @property
    def depth(self) -> int:
        """The deepest rank of all."""
        return max(self.ks)


def gallery_row(ids: Any, count: int) -> Ids:
    """Return the ids of so many tiles, which are their numbers where they have none."""
    if ids is None:
        return np.arange(count)
    found = id_row("gallery_ids", ids)
    if len(found) != count:
        raise ArgumentError(
            f"has {len(found)} ids", where="gallery_ids", expected=f"{count}, one for each tile"
        )
    return found


def score_rows(scores: Any, ranked: Ints) -> Floats:
    """Return scores in the shape of the lists; what stands beyond a list's end does not count."""
    lists = [
        floats(f"scores[{place}]", row, (None,))
        for place, row in enumerate(listed("scores", scores))
    ]
    filled = np.full(ranked.shape, np.nan)
    lengths = [len(row) for row in lists]
    least = (ranked >= 0).sum(axis=1).tolist()
    fits = len(lists) == len(ranked) and all(
        low <= length <= ranked.shape[1] for low, length in zip(least, lengths, strict=True)
    )
    if not fits:
        raise ArgumentError(
            f"has {len(lists)} rows of {sorted(set(lengths))[:3]} numbers",
            where="scores",
            expected=f"{len(ranked)} rows, a number for each ranked id",
        )
    for row, values in zip(filled, lists, strict=True):
        row[: len(values)] = values
    return filled


def rank_scores(
    names: list[Any],
    ranking: Ranking,
    positives: Positives,
    answered: Bools,
    n_tiles: int,
    asked: Asked,
) -> QueryScores:
    """Score a ranking of the gallery for Q queries, with the track's own metrics."""
    import pandas as pd

    hits = hit_matrix(ranking.tiles, positives.offsets, positives.tiles, n_tiles)
    columns = hit_columns(
        hits,
        positives.counts,
        recall_at=asked.ks,
        ap_at=dict.fromkeys(asked.ks, (asked.ap,)),
        ndcg_at=asked.ks,
    )
    records = pd.DataFrame(
        {
            "query": names,
            "answered": answered,
            "positives": positives.counts,
            "tie_dependent": ranking.tie_dependent,
            "first_hit_rank": metrics.first_hit_rank(hits),
            **columns,
        }
    )
    lacking = int((positives.counts == 0).sum())
    if lacking == len(records):
        raise ArgumentError(
            f"hold nothing for any of {lacking} queries",
            where="positives",
            expected="at least one query that can be answered",
        )
    if asked.without_positive == "exclude":
        records = records[records["positives"] > 0].reset_index(drop=True)
    counts = {
        "queries": len(records),
        "without_positive": lacking,
        "without_answer": int((~records["answered"]).sum()),
        "tie_dependent": int(records["tie_dependent"].sum()),
    }
    return QueryScores({name: float(records[name].mean()) for name in columns}, records, counts)
