"""The numbers of a report's section: intervals, breakdowns, values of queries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.report.chart import tints, vertical_axis
from airzoo_bench.report.packing import Blobs
from airzoo_bench.report.sections import Section
from airzoo_bench.report.standings import marks_of
from airzoo_bench.results.comparison import is_hit, make_sample
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.intervals import Interval, sample_intervals
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.breakdown import condition_title, group_averages, group_records
from airzoo_bench.tables.intervals import intervals_made, resampled, score_texts
from airzoo_bench.tables.model import Cell

__all__ = ["Intervals", "breakdowns", "intervals", "queries"]

Limits = list[list[float] | None]

_DECIMALS = ((1000.0, 0), (100.0, 1), (1.0, 2), (0.0, 4))  # for values from each size up
_MOST_RESAMPLES = 10_000
_FEWEST_RESAMPLES = 1_000
_WORK = 2.5e9  # resampled values: about five seconds


@dataclass(frozen=True)
class Intervals:
    """Intervals of a section.

    Attributes
    ----------
    overall : dict of str to list
        By score, the limits of each method's average over scenes, None where there are none.
    scenes : dict of str to dict
        The same of each scene.
    note : str
        How they were made, or why there are none.
    """

    overall: dict[str, Limits]
    scenes: dict[str, dict[str, Limits]]
    note: str

    def texts(self, scores: Sequence[ScoreColumn]) -> dict[str, Any]:
        """Return the intervals as texts, as the page shows them."""

        def written(found: dict[str, Limits]) -> dict[str, list[str | None]]:
            return {
                score.key: [
                    " to ".join(score_texts(score, limits)) if limits else None
                    for limits in found[score.key]
                ]
                for score in scores
                if score.key in found
            }

        scenes = {scene: written(found) for scene, found in self.scenes.items()}
        return {"overall": written(self.overall), "scenes": scenes, "note": self.note}


def intervals(section: Section) -> Intervals:
    """Compute 95 % intervals as `compare` does, for the scores and resamples that take seconds."""
    scores, resamples = _affordable(section)
    if not scores:
        return Intervals({}, {}, "no intervals: there are too many queries and methods")
    plan = ResamplingConfig(resamples)
    sample = make_sample(section.methods, scores)
    found = sample_intervals(sample, plan)
    scenes = found.groups if sample.unit == "query" else {}
    every = [interval for part in [found.overall, *scenes.values()] for interval in part]
    return Intervals(
        _by_score(section, scores, found.overall),
        {scene: _by_score(section, scores, part) for scene, part in scenes.items()},
        _note(section, scores, every, plan),
    )


def _note(
    section: Section,
    scores: Sequence[ScoreColumn],
    every: Sequence[Interval],
    plan: ResamplingConfig,
) -> str:
    """Say how the intervals were made, and why some are missing."""
    why = " / ".join(sorted({interval.reason for interval in every if interval.reason}))
    names = ", ".join(score.title for score in scores)
    made = intervals_made(every, plan, resampled(section.first.unit), f"intervals of {names}")
    if not made:
        return f"no intervals: {why}"
    others = "; of the other scores they would take too long"
    lacking = others if len(scores) < len(section.headline) else ""
    has_pooled = section.by_query and len(section.first.scenes) > 1
    pooled = "; of scenes and of the average over scenes, none of pooled values" * has_pooled
    return f"{made}{lacking}{f'; none where {why}' if why else ''}{pooled}"


def _affordable(section: Section) -> tuple[list[ScoreColumn], int]:
    values = len(section.methods) * len(section.methods[0].records)
    for scores in (section.headline, section.headline[:1]):
        resamples = min(_MOST_RESAMPLES, int(_WORK / (values * len(scores))))
        if resamples >= _FEWEST_RESAMPLES:
            return scores, resamples
    return [], 0


def _by_score(
    section: Section, scores: Sequence[ScoreColumn], found: Sequence[Interval]
) -> dict[str, Limits]:
    """Split intervals, ordered by score and then by method, into those of each score."""
    limits = [None if i.low is None or i.high is None else [i.low, i.high] for i in found]
    count = len(section.methods)
    return {
        score.key: limits[start : start + count]
        for score, start in zip(scores, range(0, len(limits), count), strict=True)
    }


def breakdowns(section: Section, blobs: Blobs) -> list[dict[str, Any]]:
    """Return every per-query score by every condition, over all scenes and in each one."""
    if not section.by_query:
        return []
    scores = section.query_scores
    values = _values(section, scores)
    medians = np.repeat([score.average == "median" for score in scores], len(section.methods))
    scenes = section.methods[0].records["scene"].to_numpy(str)
    parts = [np.ones(len(scenes), bool), *(scenes == scene for scene in section.first.scenes)]
    return [_breakdown(section, by, values, medians, parts, blobs) for by in section.conditions]


def _breakdown(
    section: Section,
    by: str,
    values: Floats,
    medians: NDArray[np.bool_],
    parts: Sequence[NDArray[np.bool_]],
    blobs: Blobs,
) -> dict[str, Any]:
    grouping = group_records(section.methods[0].records, by)
    groups = len(grouping.labels)
    found = [
        group_averages(values[:, part], medians, grouping.codes[part], groups) for part in parts
    ]
    counts = [np.bincount(grouping.codes[part], minlength=groups).tolist() for part in parts]
    shape = (len(section.query_scores), len(section.methods), groups)
    return {
        "by": by,
        "title": condition_title(by),
        "labels": list(grouping.labels),
        "counts": counts,
        "views": blobs.json(
            [
                [
                    _group_view(score, values)
                    for score, values in zip(section.query_scores, part.reshape(shape), strict=True)
                ]
                for part in found
            ]
        ),
    }


def _group_view(score: ScoreColumn, values: Floats) -> dict[str, Any]:
    """Return what table and chart show of a score; every entry by method, then by group."""
    return {
        "values": values,
        "texts": [score_texts(score, of_method) for of_method in values],
        "marks": np.transpose([marks_of(score, group.tolist()) for group in values.T]),
        "tints": tints(score, values),
        **vertical_axis(score, values),
    }


def _values(section: Section, scores: Sequence[ScoreColumn]) -> Floats:
    columns = [m.records[s.key].to_numpy(np.float64) for s in scores for m in section.methods]
    return np.array(columns).reshape(len(columns), len(section.methods[0].records))


def queries(section: Section, blobs: Blobs) -> dict[str, Any] | None:
    """Pack the table of queries; None if records are of scenes."""
    if not section.by_query:
        return None
    records = section.methods[0].records
    place = {scene: number for number, scene in enumerate(section.first.scenes)}
    scenes = np.array([place[scene] for scene in records["scene"]], np.int64)
    return {
        "count": len(records),
        "ids": blobs.json(records["query"].tolist()),
        "scene": blobs.array(scenes),
        "conditions": [_condition(section, name, blobs) for name in section.conditions],
        "scores": {
            score.key: blobs.numbers(
                _values(section, [score]), partial(_texts_of_one, section.track, score)
            )
            for score in section.query_scores
        },
    }


def _texts_of_one(track: str, score: ScoreColumn, values: Floats) -> list[str]:
    """Write values of single queries."""
    if is_hit(track, score):
        return ["✓ hit" if value == 1 else "✗ miss" for value in values]
    return score_texts(score, values)


def _texts_of_condition(values: Floats) -> list[str]:
    """Write numbers with decimals that suit the largest one."""
    finite = values[np.isfinite(values)]
    most = np.abs(finite).max(initial=0.0)
    decimals = next(digits for least, digits in _DECIMALS if most >= least)
    if (finite == np.round(finite)).all():
        decimals = 0
    return [Cell(value).text(decimals) for value in values.tolist()]


def _condition(section: Section, name: str, blobs: Blobs) -> dict[str, Any]:
    column = section.methods[0].records[name]
    numeric = column.dtype.kind in "iuf"
    packed = (
        blobs.numbers(column.to_numpy(np.float64), _texts_of_condition)
        if numeric
        else blobs.texts_of(
            "unknown" if missing else str(v)
            for v, missing in zip(column, column.isna(), strict=True)
        )
    )
    return {"name": name, "title": condition_title(name), "numeric": numeric, **packed}
