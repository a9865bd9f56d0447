"""Whether results measure the same: one protocol, one truth; and if not, in what they differ."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

from airzoo_bench.core.errors import ResultError, UsageError, counted, first_of
from airzoo_bench.results.result import Result, ScoreColumn

if TYPE_CHECKING:  # records need pandas, which tables of results do without
    from airzoo_bench.results.records import Scored

__all__ = [
    "apart_in",
    "check_comparable",
    "check_same_column",
    "check_same_queries",
    "first_names",
    "other_settings",
    "version_notes",
]

_SHOWN = 3
_LONGEST = 60


def check_comparable(names: Sequence[str], results: Sequence[Result]) -> None:
    """Refuse results whose numbers do not measure the same."""
    _check_alike(names, results, "protocol")
    _check_alike(names, results, "truth")
    known: dict[str, tuple[str, ScoreColumn]] = {}
    for name, result in zip(names, results, strict=True):
        for column in result.columns:
            whose, first = known.setdefault(column.key, (name, column))
            if column.model_copy(update={"headline": first.headline}) != first:
                raise ResultError(
                    f"{whose} and {name} mean different things by the score {column.key}",
                    expected="the same title, unit, direction and average, as one protocol gives",
                    fix="score all predictions again with the same version",
                )


def check_same_queries(methods: Sequence[Scored]) -> None:
    """Refuse results whose numbers do not measure the same on the same queries."""
    check_comparable([m.name for m in methods], [m.result for m in methods])
    first = methods[0]
    for other in methods[1:]:
        if first.records["query"].equals(other.records["query"]):
            continue
        one, two = set(first.records["query"]), set(other.records["query"])
        if one != two:
            lonely = first_of(sorted(one ^ two), len(one | two))
            shared = f"only {counted(len(one & two), 'query')}" if one & two else "no query"
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
    packages = dict.fromkeys(package for result in results for package in result.versions)
    found = []
    for package in packages:
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


def other_settings(one: Mapping[str, Any], two: Mapping[str, Any]) -> str:
    """Say in what the settings of two protocols differ, see `Protocol.settings`."""
    return _first_settings(list(_compare_settings(one, two)))


def _check_alike(
    names: Sequence[str], results: Sequence[Result], what: Literal["protocol", "truth"]
) -> None:
    prints = [getattr(result, what).fingerprint for result in results]
    others = [place for place, found in enumerate(prints) if found != prints[0]]
    if not others:
        return
    first, second = results[0], results[others[0]]
    if what == "protocol":
        made, why = "made with different protocols", _explain_protocols(first, second)
        expected = "one protocol: a difference would be its doing as well as the methods'"
        fix = "name results of one protocol only"
        # Of other names, they ask different things: one is no slip for the other.
        if first.protocol.name == second.protocol.name:
            fix = f"score all predictions again with the same --protocol, or {fix}"
        else:
            fix += "; `airzoo-bench table` takes several"
    else:
        made, why = "compared with different truths", _explain_truths(first, second)
        expected = "one truth: the same queries with the same answers"
        fix = "score all predictions again with the same benchmark folder"
    many = first_names([names[place] for place in others])
    raise ResultError(
        f"{names[0]} and {names[others[0]]} were {made} "
        f"({prints[0][:12]} and {prints[others[0]][:12]}): {why}"
        + f"; {len(others)} of {len(results)} results differ from the first: {many}"
        * (len(others) > 1),
        expected=expected,
        fix=fix,
    )


def _explain_protocols(first: Result, other: Result) -> str:
    one, two = first.protocol, other.protocol
    names = f"{one.name} v{one.version} against {two.name} v{two.version}"
    if one.name != two.name:
        return names
    found = list(_compare_settings(one.settings, two.settings))
    return _first_settings([names, *found] if one.version != two.version else found)


def _first_settings(found: Sequence[str]) -> str:
    more = len(found) - _SHOWN
    rest = f"; and {counted(more, 'more setting')}" if more > 0 else ""
    return "; ".join(found[:_SHOWN]) + rest


def _compare_settings(one: Any, two: Any, key: str = "") -> Iterator[str]:
    """Yield the settings that differ, with both values."""
    if isinstance(one, dict) and isinstance(two, dict):
        for name in dict.fromkeys([*one, *two]):
            inner = f"{key}.{name}" if key else str(name)
            yield from _compare_settings(one.get(name), two.get(name), inner)
    elif one != two:
        texts = ["absent" if value is None else str(value) for value in (one, two)]
        first, second = (t if len(t) <= _LONGEST else t[: _LONGEST - 3] + "..." for t in texts)
        yield f"{key} is {first} against {second}"


def _explain_truths(first: Result, other: Result) -> str:
    one, two = (f"{r.truth.benchmark} v{r.truth.version}" for r in (first, other))
    why = f"benchmark {one}" + (f" against {two}" if one != two else ", prepared anew")
    for scene in first.truth.scene_titles:
        counts = [r.counts[scene]["queries"] for r in (first, other) if scene in r.counts]
        if len(set(counts)) > 1:
            return f"{why}; scene {scene}: {counts[0]} against {counted(counts[1], 'query')}"
    return why
