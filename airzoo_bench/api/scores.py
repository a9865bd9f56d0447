"""What functions of the face return that score queries."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

from airzoo_bench.api.arrays import choice, listed, whole
from airzoo_bench.core.errors import ArgumentError
from airzoo_bench.core.shown import Shown, number
from airzoo_bench.geometry.arrays import Bools
from airzoo_bench.retrieval import metrics
from airzoo_bench.retrieval.ranking import Ranking
from airzoo_bench.retrieval.scoring import hit_columns
from airzoo_bench.retrieval.settings import ApVariant
from airzoo_bench.retrieval.truth import Positives

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Asked", "QueryScores", "WithoutPositive", "rank_scores"]


@dataclass(frozen=True, eq=False, repr=False)
class QueryScores(Shown):
    """Scores of queries, and the rows that they are averages of.

    Attributes
    ----------
    scores : dict of str to float
        By the names that the tracks' results have; shares are 0 to 1, errors metres or degrees.
        ``found["recall@1"]`` is short for ``found.scores["recall@1"]``.
    records : DataFrame
        A row a query, with a column for each score.
    counts : dict of str to int
        Queries, and which of them a reader should know of.
    """

    scores: dict[str, float]
    records: pd.DataFrame
    counts: dict[str, int]

    def __getitem__(self, name: str) -> float:
        return self.scores[name]

    def _shown(self) -> Mapping[str, object]:
        return self.counts | {name: number(value) for name, value in self.scores.items()}


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

    hits = metrics.hit_matrix(ranking.tiles, positives.offsets, positives.tiles, n_tiles)
    columns = hit_columns(
        hits,
        positives.counts,
        asked.ks,
        dict.fromkeys(asked.ks, (asked.ap,)),
        asked.ks,
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
