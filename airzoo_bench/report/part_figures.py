"""The pictures of a part of the report."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.core.errors import UsageError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.report import draw
from airzoo_bench.report.curves import threshold_scores
from airzoo_bench.report.labels import axis_label, error_label
from airzoo_bench.report.numbers import Intervals
from airzoo_bench.report.overview import draw_intervals
from airzoo_bench.report.sections import Section
from airzoo_bench.results.result import ScoreColumn

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["part_figures"]

_MOST_ERRORS = 2


def part_figures(
    section: Section, found: Intervals, notes: list[str]
) -> Iterator[tuple[str, Figure]]:
    """Yield titles and pictures, those that the section's track has.

    Parameters
    ----------
    section : Section
    found : Intervals
    notes : list of str
        Takes which picture was left out, and why.
    """
    methods, main = section.methods, section.headline[0]
    yield _averages(section, found, main)
    if len(section.first.scenes) > 1:
        yield f"{axis_label(main)} by scene", draw.scenes(methods, main)
    if section.track == "retrieval":
        yield from _recall(section, notes)
    for score in _errors(section):
        title = f"Share of queries below a value of {error_label(score)}"
        yield title, draw.errors(methods, score)
    if threshold_scores(section.first.columns)["f1"]:
        yield "Precision, recall and F1 over the distance d", draw.thresholds(methods)


def _averages(section: Section, found: Intervals, score: ScoreColumn) -> tuple[str, Figure]:
    methods = section.methods
    limits = _limits(section, found, score)
    said = draw.over_what(methods)
    if np.isfinite(limits).any():
        said += " with its 95 % interval"
    values = np.array([method.result.overall[score.key] for method in methods])
    figure = draw_intervals([method.name for method in methods], values, limits, score, said)
    return f"{axis_label(score)}, {said}", figure


def _limits(section: Section, found: Intervals, score: ScoreColumn) -> Floats:
    """Return the limits (M, 2) of a score's intervals, NaN where there are none."""
    none = [None] * len(section.methods)
    limits = [limit or [np.nan, np.nan] for limit in found.overall.get(score.key, none)]
    return np.array(limits, np.float64)


def _recall(section: Section, notes: list[str]) -> Iterator[tuple[str, Figure]]:
    try:
        draw.kept_ranks(section.methods[0])
    except UsageError as error:
        notes.append(f"no picture of recall over K for {section.first.protocol.name}: {error}")
        return
    yield "Recall over the number of tiles looked at", draw.recall(section.methods)


def _errors(section: Section) -> list[ScoreColumn]:
    errors = [score for score in section.query_scores if score.unit != "share"]
    return errors[:_MOST_ERRORS] if section.by_query else []
