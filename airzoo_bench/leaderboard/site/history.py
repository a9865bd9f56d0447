"""The versions of a method, the newest first, and what changed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from airzoo_bench.leaderboard.site.api import Version
from airzoo_bench.leaderboard.site.entries import Entry
from airzoo_bench.leaderboard.site.measured import OVERALL, Measured
from airzoo_bench.leaderboard.site.rows import Scored, overall_scores
from airzoo_bench.tables.method_table import as_shown
from airzoo_bench.tables.model import show_number

__all__ = ["Older", "versions"]

Older = Sequence[tuple[Entry, Measured]]
"""Earlier versions of a method, the newest first."""
_Ids = Mapping[tuple[Any, ...], str]
_UNITS = {"share": "points", "m": "m", "deg": "deg"}


def versions(scored: Scored, older: Older, ids: _Ids) -> Iterator[Version]:
    """Yield the versions of a method."""
    every = [(scored.entry, scored.measured), *older]
    for place, (entry, measured) in enumerate(every):
        before = every[place + 1][1] if place + 1 < len(every) else None
        given = entry.submission
        yield Version(
            entry.number,
            entry.name or scored.id,
            measured.method if given is None else given.method,
            None if given is None else given.date.isoformat(),
            entry.scored,
            measured.made_with,
            ids.get(measured.measures, ""),
            overall_scores(measured),
            "" if before is None else _changes(measured, before),
            entry.place,
        )


def _changes(new: Measured, old: Measured) -> str:
    if new.measures != old.measures:
        return "the version before was measured with another protocol or truth"
    said = []
    for column in new.score_columns:
        pair = [one.values[OVERALL].get(column.key) for one in (new, old)]
        now, before = (None if value is None else as_shown(column, value) for value in pair)
        if column.headline and now is not None and before is not None and now != before:
            said.append(f"{column.title} {show_number(now - before, 2, '+')} {_UNITS[column.unit]}")
    return ", ".join(said) or "the same scores"
