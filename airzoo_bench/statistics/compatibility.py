"""Whether results may be compared, and if not, why."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from airzoo_bench.errors import ResultError, first_of
from airzoo_bench.records import Scored
from airzoo_bench.result import ScoreColumn
from airzoo_bench.validation import nearest

__all__ = ["check_comparable", "choose_scores", "find_scene"]

_SHOWN = 3


def check_comparable(methods: Sequence[Scored]) -> None:
    """Refuse results whose numbers do not measure the same on the same queries.

    Raises
    ------
    ResultError
        Protocol, truth or queries of one differ from those of the first; it says in what.
    """
    first = methods[0]
    for other in methods[1:]:
        _check_protocol(first, other)
        _check_truth(first, other)
        _check_queries(first, other)


def _check_protocol(first: Scored, other: Scored) -> None:
    one, two = first.result.protocol, other.result.protocol
    if one.fingerprint == two.fingerprint:
        return
    found = list(_different(one.settings, two.settings))
    if (one.name, one.version) != (two.name, two.version):
        found.insert(0, f"{one.name} v{one.version} against {two.name} v{two.version}")
    raise ResultError(
        f"{first.name} and {other.name} were made with different protocols "
        f"({one.fingerprint[:12]} and {two.fingerprint[:12]}): "
        + "; ".join(found[:_SHOWN])
        + (f"; and {len(found) - _SHOWN} more settings" if len(found) > _SHOWN else ""),
        expected="one protocol: a difference would be its doing as well as the methods'",
        mend="score all predictions again with the same --protocol",
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
    return text if len(text) <= 60 else text[:57] + "..."


def _check_truth(first: Scored, other: Scored) -> None:
    one, two = first.result.truth, other.result.truth
    if one.fingerprint == two.fingerprint:
        return
    names = [f"{truth.benchmark} v{truth.version}" for truth in (one, two)]
    why = f"{names[0]} against {names[1]}" if names[0] != names[1] else f"{names[0]}, prepared anew"
    for scene in one.scene_titles:
        counts = [m.result.counts.get(scene, {}).get("queries") for m in (first, other)]
        if counts[0] != counts[1]:
            why += f"; scene {scene} has {counts[0]} queries against {counts[1]}"
            break
    raise ResultError(
        f"{first.name} and {other.name} were held against different truths "
        f"({one.fingerprint[:12]} and {two.fingerprint[:12]}): {why}",
        expected="one truth: the same queries with the same answers",
        mend="score all predictions again with the same benchmark folder",
    )


def _check_queries(first: Scored, other: Scored) -> None:
    one, two = set(first.records["query"]), set(other.records["query"])
    if one == two:
        return
    lonely = first_of(sorted(one ^ two), len(one | two))
    shared = f"only {len(one & two)} of their queries" if one & two else "none of their queries"
    raise ResultError(
        f"{first.name} and {other.name} have {shared} in common; not in both: {lonely}",
        expected="results on the same queries",
        mend="score all predictions again with the same benchmark folder",
    )


def choose_scores(methods: Sequence[Scored], wanted: Sequence[str]) -> list[ScoreColumn]:
    """Find scores by key or title; where none is wanted, the headline ones that all have.

    Raises
    ------
    ResultError
        A method has no such score.
    """
    shared = [
        column
        for column in methods[0].result.columns
        if all(column in other.result.columns for other in methods[1:])
    ]
    if not wanted:
        return [column for column in shared if column.headline]
    by_name = {column.title: column for column in shared} | {c.key: c for c in shared}
    for name in wanted:
        if name not in by_name:
            raise ResultError(
                f"no score {name!r} that all results have{nearest(name, list(by_name))}",
                expected="one of " + ", ".join(column.key for column in shared),
            )
    return list({by_name[name].key: by_name[name] for name in wanted}.values())


def find_scene(method: Scored, wanted: str | None) -> str | None:
    """Return the id of a scene named by id or title; None stays None.

    Raises
    ------
    ResultError
        There is no such scene.
    """
    titles = method.result.truth.scene_titles
    by_name = {title: scene for scene, title in titles.items()} | {scene: scene for scene in titles}
    if wanted is not None and wanted not in by_name:
        raise ResultError(
            f"there is no scene {wanted!r} in the results{nearest(wanted, list(titles))}",
            expected="one of " + ", ".join(titles),
        )
    return None if wanted is None else by_name[wanted]
