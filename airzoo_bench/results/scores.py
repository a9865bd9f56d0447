"""Scores, and the averages of records: one number a scene, and one for the benchmark."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from airzoo_bench.geometry.arrays import Bools

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Score:
    """A score: a column of the records and the way its rows are averaged over a scene.

    The column is also the score's key in results; the title is what tables call it, without being
    asked where it is a headline. Shares are 0 to 1 in records and results, and percent in tables.
    """

    column: str
    title: str
    unit: Literal["share", "m", "deg"]
    higher_is_better: bool
    average: Literal["mean", "median"]
    headline: bool = False

    @classmethod
    def share(cls, column: str, title: str, *, headline: bool = False) -> Score:
        """Return a score of shares, where higher is better, averaged by the mean."""
        return cls(column, title, "share", higher_is_better=True, average="mean", headline=headline)


@dataclass(frozen=True)
class Summary:
    """Scores by name: for each scene, over scenes, and pooled over all rows.

    Over scenes is the unweighted mean, of medians too, as the paper has it.
    """

    scenes: dict[str, dict[str, float]]
    overall: dict[str, float]
    pooled: dict[str, float]


def concatenate(parts: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Concatenate the records of scenes; a single scene is not copied."""
    import pandas as pd  # tracks name their scores without it

    return parts[0] if len(parts) == 1 else pd.concat(parts, ignore_index=True)


def summarise(records: pd.DataFrame, scores: list[Score], scenes: list[str]) -> Summary:
    """Average records."""
    of_row, keys = records["scene"].to_numpy(), [score.column for score in scores]
    per_scene = {scene: _average(records, np.asarray(of_row == scene), scores) for scene in scenes}
    overall = {key: float(np.mean([part[key] for part in per_scene.values()])) for key in keys}
    return Summary(per_scene, overall, _average(records, slice(None), scores))


def _average(records: pd.DataFrame, rows: Bools | slice, scores: list[Score]) -> dict[str, float]:
    found = {}
    for score in scores:
        values = records[score.column].to_numpy(np.float64)[rows]
        if values.size == 0 or np.isnan(values).any():
            raise ValueError(f"{score.column}: no record, or NaN, in {values.size} rows")
        average = np.median if score.average == "median" else np.mean
        found[score.column] = float(average(values))
    return found
