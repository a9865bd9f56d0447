"""Which methods are no better than what scores without a method, such as chance or the prior."""

from __future__ import annotations

import numpy as np

from airzoo_bench.results.result import Reference, Result, ScoreColumn
from airzoo_bench.results.sampling import is_hit
from airzoo_bench.statistics.intervals import FEWEST
from airzoo_bench.statistics.shares import Rates, limits_of_rates

__all__ = ["FLOOR_MARK", "floor_note", "notes_of"]

FLOOR_MARK = "‡"
"""What stands behind the name of a method that is no better than a reference."""

_CONFIDENCE = 0.95


def notes_of(result: Result) -> tuple[str, ...]:
    """Return the notes of a result and `floor_note`, where there is one."""
    return (*result.notes, *filter(None, [floor_note(result)]))


def floor_note(result: Result) -> str:
    """Say by which headline scores a method is no better than a reference."""
    parts = []
    for name, reference in result.references.items():
        columns = [c for c in result.columns if c.headline and c.key in reference.overall]
        titles = [c.title for c in columns if _is_no_better(result, reference, c)]
        if titles:
            parts.append(f"no better than {name} on {', '.join(titles)}")
    if not parts:
        return ""
    why = ": its 95 % interval reaches that" if result.track == "retrieval" else ""
    return f"{FLOOR_MARK} {'; '.join(parts)}{why}"


def _is_no_better(result: Result, reference: Reference, column: ScoreColumn) -> bool:
    value, floor = result.overall[column.key], reference.overall[column.key]
    if result.track != "retrieval":
        return value <= floor if column.higher_is_better else value >= floor
    counts = [float(part["queries"]) for part in result.counts.values()]
    if not is_hit(result.track, column) or min(counts) < FEWEST:
        return False
    rates = [
        Rates(np.array([scores[column.key]]), np.array([count]))
        for scores, count in zip(result.scenes.values(), counts, strict=True)
    ]
    return bool(limits_of_rates(rates, _CONFIDENCE)[0, 0] <= floor)
