"""Results as samples: every score of every method a variable, queries or scenes the units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.intervals import SampleIntervals
from airzoo_bench.statistics.sample_intervals import sample_intervals
from airzoo_bench.statistics.samples import ResamplingConfig, Sample

__all__ = ["is_hit", "is_share", "make_sample", "score_intervals"]

_HITS = {"retrieval": ("recall@", "distance<"), "matching": ("within_",)}
"""How the columns of scores begin that say of a query whether it is answered well enough."""


def make_sample(
    methods: Sequence[Scored], scores: Sequence[ScoreColumn], scene: str | None = None
) -> Sample:
    """Gather variables, score by score and in each method by method.

    Queries are the units, resampled within scenes. Where every scene has one record, scenes are.

    Parameters
    ----------
    methods : sequence of Scored
        On the same queries.
    scores : sequence of ScoreColumn
    scene : str, optional
        This scene's queries only.
    """
    of_unit = methods[0].records["scene"].to_numpy(str)
    scenes = tuple(scene_ for scene_ in methods[0].result.scenes if scene in (None, scene_))
    columns = [m.records[s.key].to_numpy(np.float64) for s in scores for m in methods]
    values = np.array(columns).reshape(len(columns), len(of_unit))
    medians = np.array([s.average == "median" for s in scores for _ in methods], np.bool_)
    if methods[0].result.unit == "scene":
        # One record a scene: their mean over scenes, whatever the average within a scene.
        chosen = values if scene is None else values[:, of_unit == scene]
        return Sample("scene", ("",), (chosen,), np.zeros_like(medians))
    parts = tuple(np.ascontiguousarray(values[:, of_unit == name]) for name in scenes)
    shares = np.array([is_share(s) for s in scores for _ in methods], np.bool_)
    return Sample("query", scenes, parts, medians, shares)


def score_intervals(
    method: Scored,
    scores: Sequence[ScoreColumn],
    resampling: ResamplingConfig,
    scene: str | None = None,
) -> SampleIntervals:
    """Take the interval of every score, of each scene and of the mean over scenes.

    Parameters
    ----------
    method : Scored
    scores : sequence of ScoreColumn
    resampling : ResamplingConfig
    scene : str, optional
        Of this scene's queries only.

    Returns
    -------
    SampleIntervals
        In the order of `scores`; without scenes where scenes are what is resampled.
    """
    sample = make_sample([method], scores, scene)
    found = sample_intervals(sample, resampling)
    return found if sample.unit == "query" else replace(found, groups={})


def is_hit(track: str, score: ScoreColumn) -> bool:
    """Whether a score is 0 or 1 for each query by its definition, whatever its values are."""
    return score.unit == "share" and score.key.startswith(_HITS.get(track, ()))


def is_share(score: ScoreColumn) -> bool:
    """Whether a score of queries is a mean of shares from 0 to 1."""
    return score.unit == "share" and score.average == "mean"
