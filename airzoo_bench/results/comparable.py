"""Which results, scenes and scores are meant, and whether results measure the same."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import ResultError, UsageError, counted, first_of
from airzoo_bench.core.validation import nearest
from airzoo_bench.results.result import Result, ScoreColumn

if TYPE_CHECKING:  # records need pandas, which tables of results do without
    from airzoo_bench.results.records import Scored

_SHOWN = 3
_LONGEST = 60


def find_scene(titles: Mapping[str, str], wanted: str) -> str:
    """Return the id of a scene that is named by id or title; an id goes before a title."""
    if wanted in titles:
        return wanted
    found = [scene for scene, title in titles.items() if title == wanted]
    if len(found) == 1:
        return found[0]
    known = list(dict.fromkeys([*titles, *titles.values()]))
    raise ResultError(
        f"{len(found)} scenes have the title {wanted!r}"
        if found
        else f"there is no scene {wanted!r} in the results{nearest(wanted, known)}",
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


def check_comparable(names: Sequence[str], results: Sequence[Result]) -> None:
    """Refuse results of different protocols, truths or meanings of a score."""
    for what, explain in (("protocol", _explain_protocols), ("truth", _explain_truths)):
        prints = [getattr(result, what).fingerprint for result in results]
        others = [place for place, found in enumerate(prints) if found != prints[0]]
        if others:
            first, second = results[0], results[others[0]]
            why, expected, fix = explain(first, second)
            if len(others) > 1:
                many = first_names([names[place] for place in others])
                why += f"; {len(others)} of {len(results)} results differ from the first: {many}"
            raise ResultError(
                f"{names[0]} and {names[others[0]]} were "
                f"{'made with' if what == 'protocol' else 'compared with'} different {what}s "
                f"({prints[0][:12]} and {prints[others[0]][:12]}): {why}",
                expected=expected,
                fix=fix,
            )
    known: dict[str, tuple[str, ScoreColumn]] = {}
    for name, result in zip(names, results, strict=True):
        for column in result.columns:
            whose, first_column = known.setdefault(column.key, (name, column))
            if column.model_copy(update={"headline": first_column.headline}) != first_column:
                raise ResultError(
                    f"{whose} and {name} mean different things by the score {column.key}",
                    expected="the same title, unit, direction and average, as one protocol gives",
                    fix="score all predictions again with the same version",
                )


def _explain_protocols(first: Result, other: Result) -> tuple[str, str, str]:
    """Return how two protocols differ, the expectation, and the remedy."""
    one, two = first.protocol, other.protocol
    expected = "one protocol: a difference would be its doing as well as the methods'"
    fix = "name results of one protocol only"
    names = f"{one.name} v{one.version} against {two.name} v{two.version}"
    if one.name != two.name:  # they ask different things: one is no slip for the other
        return names, expected, f"{fix}; `airzoo-bench table` takes several"
    said = [names] if one.version != two.version else []
    why = other_settings(one.settings, two.settings, *said)
    fix = f"score all predictions again with the same --protocol, or {fix}"
    return why, expected, fix


def _explain_truths(first: Result, other: Result) -> tuple[str, str, str]:
    one, two = (f"{r.truth.benchmark} v{r.truth.version}" for r in (first, other))
    why = f"benchmark {one}" + (f" against {two}" if one != two else ", prepared anew")
    for scene in first.truth.scene_titles:
        counts = [r.counts[scene]["queries"] for r in (first, other) if scene in r.counts]
        if len(set(counts)) > 1:
            why += f"; scene {scene}: {counts[0]} against {counted(counts[1], 'query')}"
            break
    fix = "score all predictions again with the same benchmark folder"
    return why, "one truth: the same queries with the same answers", fix


def other_settings(one: Mapping[str, Any], two: Mapping[str, Any], *said: str) -> str:
    """List the first settings in which two protocols differ, after what is said of them."""
    found = [*said, *_compare_settings(one, two)]
    more = len(found) - _SHOWN
    rest = f"; and {counted(more, 'more setting')}" if more > 0 else ""
    return "; ".join(found[:_SHOWN]) + rest


def _compare_settings(one: Any, two: Any, key: str = "") -> Iterator[str]:
    """Yield the settings that differ, with both values."""
    if isinstance(one, Mapping) and isinstance(two, Mapping):
        for name in dict.fromkeys([*one, *two]):
            inner = f"{key}.{name}" if key else str(name)
            yield from _compare_settings(one.get(name), two.get(name), inner)
    elif one != two:
        texts = ["absent" if value is None else str(value) for value in (one, two)]
        first, second = (t if len(t) <= _LONGEST else t[: _LONGEST - 3] + "..." for t in texts)
        yield f"{key} is {first} against {second}"


def check_same_queries(methods: Sequence[Scored]) -> None:
    """Refuse results of different protocols, truths or queries."""
    check_comparable([m.name for m in methods], [m.result for m in methods])
    first = methods[0]
    for other in methods[1:]:
        one, two = (m.records["query"] for m in (first, other))
        if one.equals(two) or set(one) == set(two):
            continue
        lonely = first_of(sorted({*one} ^ {*two}), len({*one} | {*two}))
        common = len({*one} & {*two})
        shared = f"only {counted(common, 'query')}" if common else "no query"
        raise ResultError(
            f"{first.name} and {other.name} have {shared} in common; not in both: {lonely}",
            expected="results on the same queries",
            fix="score all predictions again with the same benchmark folder",
        )


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


def first_names(names: Sequence[str], shown: int = _SHOWN) -> str:
    """Return the first few names, and how many more there are."""
    more = len(names) - shown
    return ", ".join(names[:shown]) + (f" and {more} more" if more > 0 else "")
