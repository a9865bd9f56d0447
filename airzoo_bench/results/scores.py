"""What a score is, and how records become one number a scene and one for the benchmark."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from airzoo_bench.geometry.arrays import Bools

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Score", "Summary", "concatenate", "summarise"]


@dataclass(frozen=True)
class Score:
    """A score: a column of the records and the way its rows are averaged.

    Attributes
    ----------
    column : str
        The column of the records, which is also the score's key in results.
    title : str
        What tables call it.
    unit : {"share", "m", "deg"}
        Shares are 0 to 1 in records and results, and percent in tables.
    average : {"mean", "median"}
        Over the rows of a scene.
    headline : bool
        Whether tables show it without being asked.
    """

    column: str
    title: str
    unit: Literal["share", "m", "deg"]
    higher_is_better: bool
    average: Literal["mean", "median"]
    headline: bool = False

    @classmethod
    def share(cls, column: str, title: str, *, headline: bool = False) -> Score:
        """Return a score whose rows are shares, the more the better, and averaged by their mean."""
        return cls(column, title, "share", higher_is_better=True, average="mean", headline=headline)


@dataclass(frozen=True)
class Summary:
    """Scores by name: for each scene, over scenes, and over all rows.

    Attributes
    ----------
    overall : dict of str to float
        The unweighted mean over scenes, of medians too, as the paper has it.
    pooled : dict of str to float
        Over all rows, whatever their scene.
    """

    scenes: dict[str, dict[str, float]]
    overall: dict[str, float]
    pooled: dict[str, float]


def concatenate(parts: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Put the records of scenes under each other; those of a single one are not copied."""
    import pandas as pd

    return parts[0] if len(parts) == 1 else pd.concat(parts, ignore_index=True)


def summarise(records: pd.DataFrame, scores: list[Score], scenes: list[str]) -> Summary:
    """Average records."""
    per_scene = {
        scene: _average(records, (records["scene"] == scene).to_numpy(np.bool_), scores)
        for scene in scenes
    }
    overall = {
        score.column: float(np.mean([values[score.column] for values in per_scene.values()]))
        for score in scores
    }
    return Summary(per_scene, overall, _average(records, slice(None), scores))


def _average(records: pd.DataFrame, rows: Bools | slice, scores: list[Score]) -> dict[str, float]:
    return {score.column: _average_one(records, rows, score) for score in scores}


def _average_one(records: pd.DataFrame, rows: Bools | slice, score: Score) -> float:
    values = records[score.column].to_numpy(np.float64)[rows]
    if values.size == 0 or np.isnan(values).any():
        raise ValueError(f"{score.column}: no record, or NaN, in {values.size} rows")
    return float(np.median(values) if score.average == "median" else np.mean(values))
