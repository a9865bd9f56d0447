"""Whether results measure the same: one protocol, one truth; and if not, in what they differ."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal

from airzoo_bench.core.errors import ResultError, UsageError, first_of
from airzoo_bench.core.plurals import counted
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import Result, ScoreColumn

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
    _check(names, results, "protocol")
    _check(names, results, "truth")
    _check_meanings(names, results)


def _check_meanings(names: Sequence[str], results: Sequence[Result]) -> None:
    """Refuse scores of one key that are called, counted or averaged differently."""
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


def _check(
    names: Sequence[str], results: Sequence[Result], what: Literal["protocol", "truth"]
) -> None:
    prints = [getattr(result, what).fingerprint for result in results]
    others = [place for place, found in enumerate(prints) if found != prints[0]]
    if not others:
        return
    second = others[0]
    why = {"protocol": _other_settings, "truth": _other_truth}[what](results[0], results[second])
    made = {"protocol": "made with different protocols", "truth": "compared with different truths"}
    raise ResultError(
        f"{names[0]} and {names[second]} were {made[what]} "
        f"({prints[0][:12]} and {prints[second][:12]}): {why}"
        + _how_many([names[place] for place in others], len(results)),
        expected={
            "protocol": "one protocol: a difference would be its doing as well as the methods'",
            "truth": "one truth: the same queries with the same answers",
        }[what],
        fix=_fix(results[0], results[second], what),
    )


def _fix(first: Result, other: Result, what: Literal["protocol", "truth"]) -> str:
    if what == "truth":
        return "score all predictions again with the same benchmark folder"
    if first.protocol.name != other.protocol.name:
        # They ask different things, often of different predictions: one is no slip for the other.
        return "name results of one protocol only; `airzoo-bench table` takes several"
    return (
        "score all predictions again with the same --protocol, or name results of one protocol only"
    )


def _how_many(others: list[str], number: int) -> str:
    if len(others) == 1:
        return ""
    return f"; {len(others)} of {number} results differ from the first: {first_names(others)}"


def _other_settings(first: Result, other: Result) -> str:
    one, two = first.protocol, other.protocol
    names = f"{one.name} v{one.version} against {two.name} v{two.version}"
    if one.name != two.name:
        return names
    found = list(_different(one.settings, two.settings))
    if one.version != two.version:
        found.insert(0, names)
    return _some_of(found)


def other_settings(one: Mapping[str, Any], two: Mapping[str, Any]) -> str:
    """Say in what the settings of two protocols differ, see `Protocol.settings`."""
    return _some_of(list(_different(one, two)))


def _some_of(found: Sequence[str]) -> str:
    more = len(found) - _SHOWN
    return "; ".join(found[:_SHOWN]) + (
        f"; and {counted(more, 'more setting')}" if more > 0 else ""
    )


def _different(one: Any, two: Any, key: str = "") -> Iterator[str]:
    """Yield the settings that differ, with both values."""
    if isinstance(one, dict) and isinstance(two, dict):
        for name in dict.fromkeys([*one, *two]):
            inner = f"{key}.{name}" if key else str(name)
            yield from _different(one.get(name), two.get(name), inner)
    elif one != two:
        yield f"{key} is {_short(one)} against {_short(two)}"


def _short(value: Any) -> str:
    text = "absent" if value is None else str(value)
    return text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."


def _other_truth(first: Result, other: Result) -> str:
    one, two = first.truth, other.truth
    names = [f"{truth.benchmark} v{truth.version}" for truth in (one, two)]
    differ = names[0] != names[1]
    why = f"benchmark {names[0]}" + (f" against {names[1]}" if differ else ", prepared anew")
    for scene in one.scene_titles:
        counts = [r.counts[scene]["queries"] for r in (first, other) if scene in r.counts]
        if len(set(counts)) > 1:
            return f"{why}; scene {scene}: {counts[0]} against {counted(counts[1], 'query')}"
    return why


def check_same_queries(methods: Sequence[Scored]) -> None:
    """Refuse results whose numbers do not measure the same on the same queries."""
    check_comparable([m.name for m in methods], [m.result for m in methods])
    for other in methods[1:]:
        _check_queries(methods[0], other)


def _check_queries(first: Scored, other: Scored) -> None:
    if first.records["query"].equals(other.records["query"]):
        return
    one, two = set(first.records["query"]), set(other.records["query"])
    if one == two:
        return
    lonely = first_of(sorted(one ^ two), len(one | two))
    shared = f"only {counted(len(one & two), 'query')}" if one & two else "no query"
    raise ResultError(
        f"{first.name} and {other.name} have {shared} in common; not in both: {lonely}",
        expected="results on the same queries",
        fix="score all predictions again with the same benchmark folder",
    )


def apart_in(methods: Sequence[Scored], column: str) -> Scored | None:
    """Return the first method whose records have a column otherwise than the first one's, if any.

    Parameters
    ----------
    methods : sequence of Scored
        On the same queries, see `check_same_queries`.
    column : str
        Of the first one's records.
    """
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
