"""Scores and scenes of results, as people name them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from airzoo_bench.core.errors import ResultError, UsageError
from airzoo_bench.core.validation import nearest
from airzoo_bench.results.result import Result, ScoreColumn

if TYPE_CHECKING:  # records need pandas, which tables of results do without
    from airzoo_bench.results.records import Scored

__all__ = ["check_score", "choose_scores", "find_scene", "named_scores", "score_keys"]


def find_scene(titles: Mapping[str, str], wanted: str) -> str:
    """Return the id of a scene that is named by id or title; an id goes before a title."""
    if wanted in titles:
        return wanted
    found = [scene for scene, title in titles.items() if title == wanted]
    if not found:
        known = list(dict.fromkeys([*titles, *titles.values()]))
        raise ResultError(
            f"there is no scene {wanted!r} in the results{nearest(wanted, known)}",
            expected="one of " + ", ".join(titles),
        )
    if len(found) > 1:
        raise ResultError(
            f"{len(found)} scenes have the title {wanted!r}", expected="one of " + ", ".join(found)
        )
    return found[0]


def named_scores(scores: Iterable[ScoreColumn]) -> dict[str, ScoreColumn]:
    """Return scores by key and by title, as people name them."""
    listed = list(scores)
    return {score.key: score for score in listed} | {score.title: score for score in listed}


def check_score(name: str, scores: Sequence[ScoreColumn], option: str, fix: str = "") -> None:
    """Refuse the name of a score that is none of these."""
    known = named_scores(scores)
    if name not in known:
        # Titles hold commas, such as @1m,1°.
        titles = "; ".join(dict.fromkeys(score.title for score in scores))
        raise UsageError(
            f"no score here is called {name[:80]!r}{nearest(name[:80], list(known))}",
            where=option,
            expected=f"one of: {titles}",
            fix=fix or None,
        )


def choose_scores(
    methods: Sequence[Scored], wanted: Sequence[str], *, every: bool = False
) -> list[ScoreColumn]:
    """Find scores by key or title; where none is wanted, the headline ones that all have."""
    shared = [
        column
        for column in methods[0].result.columns
        if all(column in other.result.columns for other in methods[1:])
    ]
    if not wanted:
        found = [column for column in shared if every or column.headline]
        if not found:
            raise ResultError(
                "the results have no score in common",
                expected="results of one track, with the same scores",
                fix="score all predictions again with the same version and protocol",
            )
        return found
    some = named_scores(column for method in methods for column in method.result.columns)
    for name in wanted:
        lacking = "leave out the results that lack it: not all have it" * (name in some)
        check_score(name, shared, "--score", lacking)
    by_name = named_scores(shared)
    return list({by_name[name].key: by_name[name] for name in wanted}.values())


def score_keys(result: Result, wanted: Sequence[str], *, every: bool = False) -> set[str]:
    """Return the keys of the scores that `choose_scores` can choose, before records are read."""
    return {
        column.key
        for column in result.columns
        if every or {column.key, column.title} & set(wanted) or (not wanted and column.headline)
    }
