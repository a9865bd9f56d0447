"""What functions of the face return that score queries."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from airzoo_bench.core.shown import Shown, number

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["QueryScores"]


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
