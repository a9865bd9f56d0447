"""The rank of a method among those of the board, before the board is built."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from airzoo_bench.core.errors import UserError
from airzoo_bench.leaderboard.artifact import SceneScores, Shown, Standing
from airzoo_bench.leaderboard.board import Place
from airzoo_bench.leaderboard.git import BoardError
from airzoo_bench.leaderboard.site.entries import Entry, Faults, read_entries
from airzoo_bench.leaderboard.site.measured import OVERALL, Measured
from airzoo_bench.leaderboard.site.measuring import measure_all
from airzoo_bench.leaderboard.site.ranking import check_alike, headline_first, rank
from airzoo_bench.leaderboard.site.rows import Scored

__all__ = ["standing_of"]


def standing_of(place: Place, runs: Path, cache: Path) -> dict[str, Any]:
    """Return the rows and the standing of a method, as an artifact has them."""
    cache.mkdir(parents=True, exist_ok=True)
    try:
        shown, versions = _read(place, runs)
        found = _measured([*shown, *versions], cache)
        measured, *older = [found[one.digest][0] for one in versions]
        methods = [
            Scored(entry.name, entry, *found[entry.digest])
            for entry in shown
            if found[entry.digest][0].measures == measured.measures
        ]
        check_alike(methods)
    except UserError as error:
        raise BoardError(f"a run of the board cannot be read: {error}") from error
    before = older[0] if older and older[0].measures == measured.measures else None
    return {
        "rows": tuple(_rows(measured, before)),
        "standing": _standing(methods, place.folder),
    }


def _read(place: Place, runs: Path) -> tuple[list[Entry], list[Entry]]:
    """Return what the board shows, in its order; and the newest two versions of the method."""
    faults = Faults()
    shown = sorted(read_entries(runs, faults), key=lambda entry: (entry.name, entry.digest))
    faults.refuse()
    for entry in shown:
        if entry.name == place.folder:
            return shown, [entry, *entry.older][:2]
    raise BoardError(f"no run of {place.path}")


def _measured(entries: Sequence[Entry], cache: Path) -> dict[str, tuple[Measured, Path]]:
    found = {}
    for entry, one in zip(entries, measure_all(entries, cache), strict=True):
        if isinstance(one, UserError):
            raise one
        found[entry.digest] = one
    return found


def _rows(measured: Measured, before: Measured | None) -> Iterator[SceneScores]:
    columns = [column for column in measured.score_columns if column.headline]
    every = ("average", sum(queries for *_, queries in measured.scenes))
    parts = {scene: (title, queries) for scene, title, queries in measured.scenes}
    for scene, (title, queries) in (parts | {OVERALL: every}).items():
        scores = {}
        for column in columns:
            low, high = measured.limits[scene].get(column.key, (None, None))
            last = None if before is None else before.values[scene].get(column.key)
            scores[column.key] = Shown(
                value=_finite(measured.values[scene][column.key]),
                low=_finite(low),
                high=_finite(high),
                before=_finite(last),
            )
        yield SceneScores(title=title, queries=queries, scores=scores)


def _standing(methods: Sequence[Scored], folder: str) -> Standing:
    """Rank a method as the board does."""
    own = [one.id for one in methods].index(folder)
    column = headline_first(methods)[0]
    ranked = rank(methods, column)
    first, last = ranked.ranges[own].tolist()
    others = [n for n in range(len(methods)) if n != own and not ranked.apart[own, n]]
    return Standing(
        score=column.title,
        first=first,
        last=last,
        methods=len(methods),
        alike=tuple(sorted(methods[n].method for n in others)),
    )


def _finite(value: float | None) -> float | None:
    return None if value is None or math.isinf(value) else float(value)
