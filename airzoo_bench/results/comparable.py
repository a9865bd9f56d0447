"""Scenes and scores by name, and whether results measure the same."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import ResultError, UsageError, first_of
from airzoo_bench.core.validation import nearest
from airzoo_bench.results.result import Result, ScoreColumn

_SAME_FOLDER = "score all predictions again with the same benchmark folder"

if TYPE_CHECKING:  # records need pandas, which tables of results do without
    from airzoo_bench.results.records import Method


def find_scene(titles: Mapping[str, str], wanted: str) -> str:
    """Return the id of a scene that is named by id or title; an id goes before a title."""
    found = [wanted] if wanted in titles else [s for s, title in titles.items() if title == wanted]
    if len(found) == 1:
        return found[0]
    near = nearest(wanted, list(dict.fromkeys([*titles, *titles.values()])))
    what = f"{len(found)} scenes have the title {wanted!r}"
    if not found:
        what = f"there is no scene {wanted!r} in the results{near}"
    raise ResultError(what, expected="one of " + ", ".join(found or titles))


def scores_by_name(scores: Iterable[ScoreColumn]) -> dict[str, ScoreColumn]:
    """Return scores by key and by title, as people name them."""
    listed = list(scores)
    return {score.key: score for score in listed} | {score.title: score for score in listed}


def check_score(name: str, scores: Sequence[ScoreColumn], option: str) -> None:
    """Refuse the name of a score that is none of these."""
    known = scores_by_name(scores)
    if name not in known:
        # Titles hold commas, such as @1m,1°.
        titles = "; ".join(dict.fromkeys(score.title for score in scores))
        what = f"no score of all results is called {name[:80]!r}{nearest(name[:80], list(known))}"
        raise UsageError(what, where=option, expected=f"one of: {titles}")


def choose_scores(
    methods: Sequence[Method], wanted: Sequence[str], *, every: bool = False
) -> list[ScoreColumn]:
    """Find scores by key or title; where none is wanted, the headline ones that all have."""
    shared = [c for c in methods[0].result.columns if all(c in m.result.columns for m in methods)]
    if not wanted:
        found = [column for column in shared if every or column.headline]
        if not found:
            fix = "score all predictions again with the same version and protocol"
            raise ResultError("the results have no score in common", fix=fix)
        return found
    for name in wanted:
        check_score(name, shared, "--score")
    return list(dict.fromkeys(scores_by_name(shared)[name] for name in wanted))


def score_keys(result: Result, wanted: Sequence[str], *, every: bool = False) -> set[str]:
    """Return the keys of the scores that `choose_scores` can choose, before records are read."""
    return {
        column.key
        for column in result.columns
        if every or {column.key, column.title} & set(wanted) or (not wanted and column.headline)
    }


def check_comparable(names: Sequence[str], results: Sequence[Result]) -> None:
    """Refuse results of different protocols or truths."""
    first = results[0]
    for name, other in zip(names[1:], results[1:], strict=True):
        both, one, two = f"{names[0]} and {name}", first.protocol, other.protocol
        if two.fingerprint != one.fingerprint:
            said = f"{one.name} v{one.version} against {two.name} v{two.version}"
            said += f"; {other_settings(one.settings, two.settings)}" * (one.name == two.name)
            what = f"{both} were made with different protocols: {said}"
            fix = "score all predictions with the same --protocol, or name results of one only"
            raise ResultError(what, fix=fix)
        if other.truth.fingerprint != first.truth.fingerprint:
            prints = f"{first.truth.fingerprint[:12]} and {other.truth.fingerprint[:12]}"
            what = f"{both} were compared with different truths ({prints})"
            raise ResultError(f"{what} of {first.truth.benchmark}", fix=_SAME_FOLDER)


def other_settings(one: Mapping[str, Any], two: Mapping[str, Any]) -> str:
    """List the first settings in which two protocols differ."""

    def flatten(settings: Mapping[str, Any], section: str = "") -> Iterator[tuple[str, str]]:
        for key, value in settings.items():
            if isinstance(value, Mapping):
                yield from flatten(value, f"{section}{key}.")
            else:
                yield f"{section}{key}", str(value)[:60]

    first, second = dict(flatten(one)), dict(flatten(two))
    sides = {key: (first.get(key, "absent"), second.get(key, "absent")) for key in first | second}
    unlike = [f"{key} is {one} against {two}" for key, (one, two) in sides.items() if one != two]
    return first_names(unlike, separator="; ")


def check_same_queries(methods: Sequence[Method]) -> None:
    """Refuse results of different protocols, truths or queries."""
    check_comparable([m.name for m in methods], [m.result for m in methods])
    first = methods[0]
    for other in methods[1:]:
        one, two = ({*m.records["query"]} for m in (first, other))
        if one != two:
            both = f"{first.name} and {other.name} are not on the same queries"
            lonely = first_of(sorted(one ^ two), len(one | two))
            raise ResultError(f"{both}; not in both: {lonely}", fix=_SAME_FOLDER)


def same_in_all(methods: Sequence[Method], column: str) -> bool:
    """Whether all methods, on the same queries, have the same values in a column."""
    own = methods[0].records[column]
    return all(column in m.records and own.equals(m.records[column]) for m in methods)


def check_same_column(methods: Sequence[Method], by: str) -> None:
    """Refuse to put all methods' queries into groups that one of them made."""
    if by in methods[0].records and not same_in_all(methods, by):
        what = f"--by {by}: the results have other values of it"
        raise UsageError(what, expected="a condition of the queries", fix="name one result")


def first_names(names: Sequence[str], shown: int = 3, separator: str = ", ") -> str:
    """Return the first few names, and how many more there are."""
    more = len(names) - shown
    return separator.join(names[:shown]) + (f" and {more} more" if more > 0 else "")
