"""Which results, scenes and scores are meant, and whether results measure the same."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import ResultError, UsageError, first_of
from airzoo_bench.core.validation import nearest
from airzoo_bench.results.result import Result, ScoreColumn

_SAME_FOLDER = "score all predictions again with the same benchmark folder"

if TYPE_CHECKING:  # records need pandas, which tables of results do without
    from airzoo_bench.results.records import Scored


def find_scene(titles: Mapping[str, str], wanted: str) -> str:
    """Return the id of a scene that is named by id or title; an id goes before a title."""
    found = [wanted] if wanted in titles else [s for s, title in titles.items() if title == wanted]
    if len(found) == 1:
        return found[0]
    near = nearest(wanted, list(dict.fromkeys([*titles, *titles.values()])))
    raise ResultError(
        f"{len(found)} scenes have the title {wanted!r}"
        if found
        else f"there is no scene {wanted!r} in the results{near}",
        expected="one of " + ", ".join(found or titles),
    )


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
    shared = [c for c in methods[0].result.columns if all(c in m.result.columns for m in methods)]
    if not wanted:
        found = [column for column in shared if every or column.headline]
        if not found:
            fix = "score all predictions again with the same version and protocol"
            raise ResultError("the results have no score in common", fix=fix)
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


def check_comparable(names: Sequence[str], results: Sequence[Result]) -> None:
    """Refuse results of different protocols or truths."""
    first = results[0]
    for name, other in zip(names[1:], results[1:], strict=True):
        both, one, two = f"{names[0]} and {name}", first.protocol, other.protocol
        if two.fingerprint != one.fingerprint:
            said = f"{one.name} v{one.version} against {two.name} v{two.version}"
            said += f"; {other_settings(one.settings, two.settings)}" * (one.name == two.name)
            raise ResultError(
                f"{both} were made with different protocols: {said}",
                expected="one protocol: a difference would be its doing as well as the methods'",
                fix="score all predictions with the same --protocol, or name results of one only",
            )
        if other.truth.fingerprint != first.truth.fingerprint:
            prints = f"{first.truth.fingerprint[:12]} and {other.truth.fingerprint[:12]}"
            what = f"{both} were compared with different truths ({prints})"
            raise ResultError(f"{what} of {first.truth.benchmark}", fix=_SAME_FOLDER)


def other_settings(one: Mapping[str, Any], two: Mapping[str, Any]) -> str:
    """List the first settings in which two protocols differ."""

    def flat(given: Mapping[str, Any], section: str = "") -> Iterator[tuple[str, Any]]:
        for key, value in given.items():
            name = f"{section}{key}"
            yield from flat(value, f"{name}.") if isinstance(value, Mapping) else [(name, value)]

    first, second = dict(flat(one)), dict(flat(two))
    sides = {key: (first.get(key), second.get(key)) for key in dict.fromkeys([*first, *second])}
    shown = {
        key: " against ".join("absent" if one is None else str(one)[:60] for one in side)
        for key, side in sides.items()
        if side[0] != side[1]
    }
    return first_names([f"{key} is {said}" for key, said in shown.items()], separator="; ")


def check_same_queries(methods: Sequence[Scored]) -> None:
    """Refuse results of different protocols, truths or queries."""
    check_comparable([m.name for m in methods], [m.result for m in methods])
    first = methods[0]
    for other in methods[1:]:
        one, two = ({*m.records["query"]} for m in (first, other))
        if one != two:
            both = f"{first.name} and {other.name} are not on the same queries"
            lonely = first_of(sorted(one ^ two), len(one | two))
            raise ResultError(f"{both}; not in both: {lonely}", fix=_SAME_FOLDER)


def apart_in(methods: Sequence[Scored], column: str) -> Scored | None:
    """Return the first method, on the same queries, that has a column otherwise than the first."""
    own = methods[0].records[column]
    unlike = (m for m in methods if column not in m.records or not own.equals(m.records[column]))
    return next(unlike, None)


def check_same_column(methods: Sequence[Scored], by: str) -> None:
    """Refuse to put all methods' queries into groups that one of them made."""
    other = apart_in(methods, by) if by in methods[0].records else None
    if other is not None:
        raise UsageError(
            f"--by {by}: the column of {other.name} is not that of {methods[0].name}",
            expected="what is the same for all methods, such as a condition of the queries",
            fix="name one result at a time",
        )


def version_notes(names: Sequence[str], results: Sequence[Result]) -> list[str]:
    """Say which packages were of different versions, since a difference may be theirs."""
    found = []
    for package in dict.fromkeys(package for result in results for package in result.versions):
        users: dict[str, list[str]] = {}
        for name, result in zip(names, results, strict=True):
            users.setdefault(result.versions.get(package, "unknown"), []).append(name)
        if len(users) > 1:
            parts = ", ".join(f"{version} ({first_names(who)})" for version, who in users.items())
            found.append(f"{package}: {parts}")
    return [f"made with different versions of {'; '.join(found)}"] if found else []


def first_names(names: Sequence[str], shown: int = 3, separator: str = ", ") -> str:
    """Return the first few names, and how many more there are."""
    more = len(names) - shown
    return separator.join(names[:shown]) + (f" and {more} more" if more > 0 else "")
