"""What a board takes of one result, its numbers and what they are of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.results.comparison import is_share
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.samples import ResamplingConfig, Sample

__all__ = ["OVERALL", "RESAMPLING", "Measured", "sample_of"]

OVERALL = ""
RESAMPLING = ResamplingConfig()

Parts = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class Measured:
    """The numbers of a result, and what they are of.

    Attributes
    ----------
    scenes : list of (id, title, queries)
    values, limits, errors : mapping of str to mapping of str
        By scene, `OVERALL` for the average, then by score: the value, its interval, its standard
        error. Infinite values are infinite.
    conditions : list of dict
        ``by``, ``title``, ``labels``, ``counts`` and ``values`` by score.
    groups : list of (name, units)
        What the values of a headline score are of, in their order.
    queries : str
        Hash of the names of all records.
    """

    track: str
    protocol: str
    protocol_version: int
    protocol_fingerprint: str
    benchmark: str
    benchmark_version: int
    truth: str
    sealed: bool
    unit: str
    method: str
    made_with: str
    columns: list[dict[str, Any]]
    scenes: list[list[Any]]
    notes: list[str]
    values: Parts
    limits: Parts
    errors: Parts
    interval_kinds: list[str]
    references: dict[str, Any]
    conditions: list[dict[str, Any]]
    groups: list[list[Any]]
    queries: str

    @property
    def measures(self) -> tuple[Any, ...]:
        """What must be alike of numbers that are ranked together."""
        return (
            self.protocol,
            self.protocol_version,
            self.protocol_fingerprint,
            self.truth,
            self.sealed,
        )

    @cached_property
    def score_columns(self) -> list[ScoreColumn]:
        """The scores, headline ones first."""
        found = [ScoreColumn(**column) for column in self.columns]
        return sorted(found, key=lambda column: not column.headline)

    def by_medians(self, column: ScoreColumn) -> bool:
        """Whether a score is averaged by the median of a scene's queries."""
        return self.unit == "query" and column.average == "median"

    def place(self, key: str) -> int:
        """Return which of the headline scores one is, in the order in which they are kept."""
        return [one["key"] for one in self.columns if one["headline"]].index(key)


def sample_of(first: Measured, rows: Sequence[Floats], column: ScoreColumn) -> Sample:
    """Put one headline score of many methods into a sample, as `make_sample` would."""
    ends = np.cumsum([0, *(units for _, units in first.groups)]).tolist()
    medians = np.full(len(rows), first.by_medians(column))
    shares = np.full(len(rows), is_share(column))
    groups = tuple(name for name, _ in first.groups)
    parts = tuple(np.stack([row[start:end] for row in rows]) for start, end in pairwise(ends))
    return Sample(first.unit, groups, parts, medians, shares)
