"""The rank of a method among those of the board, before the board is built."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from airzoo_bench.leaderboard.artifact import SceneScores, Shown, Standing
from airzoo_bench.leaderboard.board import Place
from airzoo_bench.leaderboard.board_json import alike, headline_first
from airzoo_bench.leaderboard.entries import Entry, read_entries
from airzoo_bench.leaderboard.git import BoardError
from airzoo_bench.leaderboard.measured import OVERALL, Measured
from airzoo_bench.leaderboard.ranking import rank

__all__ = ["standing_of"]


def standing_of(place: Place, runs: Path, cache: Path) -> dict[str, Any]:
    """Return the rows and the standing of a method, as an artifact has them."""
    cache.mkdir(parents=True, exist_ok=True)
    entries = read_entries(runs, cache, lambda _: None)
    own = next((entry for entry in entries if entry.place == place), None)
    if own is None or own.measured is None:
        raise BoardError(f"no run of {place.path} that can be read: {own.reason if own else ''}")
    measures = own.measured.measures
    members = [e for e in entries if e.measured is not None and e.measured.measures == measures]
    before = own.older[0].measured if own.older else None
    if before is not None and before.measures != measures:
        before = None
    return {
        "rows": tuple(_rows(own.measured, before)),
        "standing": _standing(sorted(members, key=lambda one: one.method), own),
    }


def _rows(measured: Measured, before: Measured | None) -> Iterator[SceneScores]:
    columns = [column for column in measured.score_columns if column.headline]
    parts = {one["id"]: (one["title"], one["queries"]) for one in measured.scenes}
    every = ("average", sum(queries for _, queries in parts.values()))
    for scene, (title, queries) in (parts | {OVERALL: every}).items():
        scores = {}
        for column in columns:
            value, low, high, _ = measured.scores[scene][column.key]
            last = None if before is None else before.scores[scene].get(column.key)
            scores[column.key] = Shown(
                value=_finite(value),
                low=_finite(low),
                high=_finite(high),
                before=None if last is None else _finite(last[0]),
            )
        yield SceneScores(title=title, queries=queries, scores=scores)


def _standing(members: list[Entry], own: Entry) -> Standing | None:
    """Rank a method as the board does; None where it is on other queries than the others."""
    methods, _ = alike(members)
    if own not in methods:
        return None
    measured = [one.measured for one in methods if one.measured is not None]
    column, place = headline_first(measured)[0], methods.index(own)
    ranked = rank(measured, column)
    first, last = ranked.ranges[place].tolist()
    others = [n for n in range(len(methods)) if n != place and not ranked.apart[place, n]]
    return Standing(
        score=column.title,
        first=first,
        last=last,
        methods=len(methods),
        alike=tuple(sorted(methods[n].method for n in others)),
    )


def _finite(value: float | None) -> float | None:
    return None if value is None or math.isinf(value) else float(value)
