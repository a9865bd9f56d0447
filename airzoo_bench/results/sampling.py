"""Results as samples: every score of every method a variable, queries or scenes the units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.intervals import SampleIntervals
from airzoo_bench.statistics.sample_intervals import sample_intervals
from airzoo_bench.statistics.samples import ResamplingConfig, Sample

if TYPE_CHECKING:  # records need pandas, which tables of results do without
    from airzoo_bench.results.records import Scored

__all__ = ["is_hit", "is_share", "make_sample", "pooled_sample", "score_intervals"]

_HITS = {"retrieval": ("recall@", "distance<", "ma@"), "matching": ("within_",)}
"""How the columns of scores begin that say of a query whether it is answered well enough."""


def make_sample(
    methods: Sequence[Scored], scores: Sequence[ScoreColumn], scene: str | None = None
) -> Sample:
    """Gather variables, score by score and in each method by method."""
    whole = pooled_sample(methods, scores)
    [values] = whole.values
    of_unit = methods[0].records["scene"].to_numpy(str)
    if whole.unit == "scene":
        return whole if scene is None else replace(whole, values=(values[:, of_unit == scene],))
    scenes = tuple(name for name in methods[0].result.scenes if scene in (None, name))
    parts = tuple(np.ascontiguousarray(values[:, of_unit == name]) for name in scenes)
    return replace(whole, groups=scenes, values=parts)


def pooled_sample(methods: Sequence[Scored], scores: Sequence[ScoreColumn]) -> Sample:
    """Gather variables as `make_sample` does, of all records as one group, in their order."""
    unit = methods[0].result.unit
    columns = [m.records[s.key].to_numpy(np.float64) for s in scores for m in methods]
    values = np.array(columns).reshape(len(columns), -1)
    # One record a scene: their mean over scenes, whatever the average within a scene.
    medians = [unit == "query" and s.average == "median" for s in scores for _ in methods]
    shares = [is_share(s) for s in scores for _ in methods]
    return Sample(unit, ("",), (values,), np.array(medians, np.bool_), np.array(shares, np.bool_))


def score_intervals(
    method: Scored,
    scores: Sequence[ScoreColumn],
    resampling: ResamplingConfig,
    scene: str | None = None,
) -> SampleIntervals:
    """Take the interval of every score, of each scene and of the mean over scenes."""
    sample = make_sample([method], scores, scene)
    found = sample_intervals(sample, resampling)
    return found if sample.unit == "query" else replace(found, groups={})


def is_hit(track: str, score: ScoreColumn) -> bool:
    """Whether a score is 0 or 1 for each query by its definition, whatever its values are."""
    return score.unit == "share" and score.key.startswith(_HITS.get(track, ()))


def is_share(score: ScoreColumn) -> bool:
    """Whether a score is a mean of shares from 0 to 1."""
    return score.unit == "share" and score.average == "mean"
