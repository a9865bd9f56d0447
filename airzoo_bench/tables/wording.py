"""Words and cells that the tables of statistics share."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from airzoo_bench.core.errors import plural
from airzoo_bench.results.comparable import first_names
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.intervals import Interval
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.method_table import UNITS, as_shown
from airzoo_bench.tables.model import Between, Cell, share_to_percent, show_number

__all__ = [
    "INTERVAL_NAMES",
    "brackets_note",
    "intervals_made",
    "notes_by_reason",
    "resampled",
    "score_cell",
    "score_texts",
    "score_title",
    "units_note",
]

INTERVAL_NAMES = {
    "wilson": "Wilson",
    "mover": "MOVER",
    "student": "Student's t",
    "lognormal": "log-normal",
    "bca": "BCa",
    "percentile": "percentile",
}
"""What readers call the kinds of intervals."""

_DRAWN = ("bca", "percentile")

_SHOWN = 6


def score_title(score: ScoreColumn) -> str:
    """Return title and unit of a score whose numbers stand in rows."""
    return f"{score.title} [{UNITS[score.unit]}]"


def units_note(scores: Sequence[ScoreColumn]) -> str:
    """Say the units of scores, whose columns stand under other titles."""
    by_unit: dict[str, dict[str, None]] = {}
    for score in scores:
        by_unit.setdefault(UNITS[score.unit], {})[score.title] = None
    most = max(by_unit, key=lambda unit: len(by_unit[unit]))
    rest = by_unit.pop(most)
    named = [f"{', '.join(titles)} in {unit}" for unit, titles in by_unit.items()]
    # Where units differ, naming those of the fewer scores is enough.
    others = "all other scores" if named else ", ".join(rest)
    return "; ".join([*named, f"{others} in {most}"])


def score_cell(score: ScoreColumn, value: float | None, interval: Interval | None = None) -> Cell:
    """Return a value as tables show it, with its interval where there is one."""
    if value is None:
        return Cell(None)
    if interval is None or interval.low is None or interval.high is None:
        return Cell(as_shown(score, value))
    limits = Between(as_shown(score, interval.low), as_shown(score, interval.high))
    return Cell(as_shown(score, value), uncertainty=limits)


def score_texts(score: ScoreColumn, values: Iterable[float | None]) -> list[str]:
    """Write values of a score as tables do."""
    return ["–" if v is None else show_number(as_shown(score, float(v)), 2) for v in values]


def notes_by_reason(
    entries: Iterable[tuple[str, ScoreColumn, str]], prefix: str = "", linked: str = "in"
) -> list[str]:
    """Say each reason once, with all that share it, named as shortly as they can be."""
    listed = list(entries)
    every_score = list(dict.fromkeys(score.title for _, score, _ in listed))
    every_member = tuple(dict.fromkeys(member for *_, member in listed))
    found: dict[str, dict[str, list[str]]] = {}
    for reason, score, member in listed:
        found.setdefault(reason, {}).setdefault(score.title, []).append(member)
    return [
        "; ".join(_named(scores, every_score, every_member, linked)) + f": {prefix}{reason}"
        for reason, scores in found.items()
        if reason
    ]


def _named(
    scores: dict[str, list[str]], every_score: list[str], every_member: tuple[str, ...], linked: str
) -> list[str]:
    by_members: dict[tuple[str, ...], list[str]] = {}
    for title, members in scores.items():
        by_members.setdefault(tuple(members), []).append(title)
    return [
        ("all scores" if titles == every_score and len(titles) > 1 else first_names(titles, _SHOWN))
        + ("" if members == every_member else f" {linked} {first_names(members)}")
        for members, titles in by_members.items()
    ]


def resampled(unit: str) -> str:
    """Say what is drawn for the average over scenes, within what."""
    return "queries within scenes" if unit == "query" else plural(unit)


def intervals_made(
    intervals: Iterable[Interval], resampling: ResamplingConfig, drawn: str, what: str = "intervals"
) -> str:
    """Say how intervals were made, by the kinds that there are; empty where there are none."""
    listed = list(intervals)
    made = {interval.method for interval in listed}
    closed, resampled = (
        " or ".join(INTERVAL_NAMES[key] for key in INTERVAL_NAMES if key in made and key in kinds)
        for kinds in (INTERVAL_NAMES.keys() - set(_DRAWN), _DRAWN)
    )
    how = [f"{closed} over {drawn}"] if closed else []
    if resampled:
        how.append(
            f"{resampled}, {resampling.resamples} resamples of {drawn}, seed {resampling.seed}"
        )
    if not how:
        return ""
    if any(one.method == "lognormal" and one.high == math.inf for one in listed):
        how.append("inf: the upper limit is not known, it is above ten times the mean")
    return f"{share_to_percent(resampling.confidence):g} % {what}, {'; '.join(how)}"


def brackets_note(
    intervals: Iterable[Interval], resampling: ResamplingConfig, drawn: str, what: str = "intervals"
) -> list[str]:
    """Say what stands in square brackets, if anything does; see `intervals_made`."""
    made = intervals_made(intervals, resampling, drawn, what)
    return [f"in square brackets: {made}"] if made else []
