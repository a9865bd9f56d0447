"""Intervals of the numbers on a board, and why some have none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.comparison import score_intervals
from airzoo_bench.statistics.intervals import Interval
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.method_table import OVERALL, MethodTable, as_shown
from airzoo_bench.tables.model import Between, Uncertainty
from airzoo_bench.tables.wording import brackets_note, resampled

__all__ = ["with_intervals"]

_ONE_RECORD = "a scene has one record"


@dataclass(frozen=True)
class _Missing:
    """A number without an interval."""

    scene: str
    method: str
    score: str


def with_intervals(
    board: MethodTable, methods: Sequence[Scored], plan: ResamplingConfig, shown: Sequence[str]
) -> MethodTable:
    """Put intervals beside the numbers of a board, and notes how they were made, or why not.

    Parameters
    ----------
    board : MethodTable
        Of the same results, in their order, and no others.
    methods : sequence of Scored
    plan : ResamplingConfig
    shown : sequence of str
        The scenes, or `OVERALL`, whose intervals the notes are about.
    """
    entries = []
    missing: dict[str, list[_Missing]] = {}
    seen: list[Interval] = []
    for entry, method in zip(board.entries, methods, strict=True):
        held = {column.key for column in method.result.columns}
        scores = [score for score in board.scores if score.key in held]
        found = score_intervals(method, scores, plan)
        parts = {OVERALL: found.overall} | found.groups
        spans = {scene: _spans(scores, intervals) for scene, intervals in parts.items()}
        entries.append(replace(entry, uncertainties=spans))
        for scene in shown:
            seen += parts.get(scene, [])
            for score, reason in _reasons(scores, parts.get(scene)):
                missing.setdefault(reason, []).append(_Missing(scene, entry.method, score.title))
    notes = [
        f"no interval for {_places(board, those)}: {reason}" for reason, those in missing.items()
    ]
    made = brackets_note(seen, plan, resampled(methods[0].result.unit))
    return replace(board, entries=tuple(entries)).noted(*made, *notes)


def _spans(scores: Sequence[ScoreColumn], intervals: Sequence[Interval]) -> dict[str, Uncertainty]:
    return {
        score.key: Between(as_shown(score, interval.low), as_shown(score, interval.high))
        for score, interval in zip(scores, intervals, strict=True)
        if interval.low is not None and interval.high is not None
    }


def _reasons(
    scores: Sequence[ScoreColumn], intervals: Sequence[Interval] | None
) -> list[tuple[ScoreColumn, str]]:
    if intervals is None:
        return [(score, _ONE_RECORD) for score in scores]
    pairs = zip(scores, intervals, strict=True)
    return [(score, interval.reason) for score, interval in pairs if interval.low is None]


def _places(board: MethodTable, missing: Sequence[_Missing]) -> str:
    """Name numbers in as few words as tell which they are: scenes, in them methods and scores."""
    titles = {**board.scenes, OVERALL: "the average"}
    by_scene: dict[str, dict[str, list[str]]] = {}
    for one in missing:
        by_scene.setdefault(one.scene, {}).setdefault(one.method, []).append(one.score)
    parts: dict[str, list[str]] = {}
    for scene, by_method in by_scene.items():
        parts.setdefault(_which(board, by_method), []).append(titles[scene])
    return "; ".join(", ".join(scenes) + which for which, scenes in parts.items())


def _which(board: MethodTable, by_method: Mapping[str, list[str]]) -> str:
    by_scores: dict[str, list[str]] = {}
    for method, scores in by_method.items():
        every = len(scores) == len(board.scores)
        by_scores.setdefault("" if every else ", ".join(scores), []).append(method)
    parts = []
    for titles, methods in by_scores.items():
        # Of all methods, as of one alone, their names go without saying.
        names = "" if len(methods) == len(board.entries) else ", ".join(methods)
        parts.append(f"{names}: {titles}" if names and titles else names or titles)
    said = "; ".join(filter(None, parts))
    return f" ({said})" if said else ""
