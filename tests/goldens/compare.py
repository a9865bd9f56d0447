"""Compares what commands leave with what was recorded: numbers to 1e-9, poses by their rule."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

TOLERANCE = 1e-9
# Poses depend on the C library's cbrt, acos and cos in their last digits.
POSE_TOLERANCE = 1e-6
SOLVED = ("matches", "pairs")


def compare(old: dict[str, Any], new: dict[str, Any], here: bool) -> tuple[list[str], list[str]]:
    """Return differences that break a golden, and those that another machine may show.

    Parameters
    ----------
    here : bool
        Whether this machine recorded it.
    """
    broken: list[str] = []
    allowed: list[str] = []
    for command, values in old.items():
        if command not in new:
            broken.append(f"{command}: is no more")
        elif values.get("kind") in SOLVED:
            found, may_move = _solved(command, values, new[command], here)
            (allowed if may_move else broken).extend(found)
        else:
            broken += differences(command, values, new[command], TOLERANCE)
    return broken, allowed


def _solved(
    command: str, old: dict[str, Any], new: dict[str, Any], here: bool
) -> tuple[list[str], bool]:
    """Return differences of a result whose poses were solved, and whether so many may be.

    On another machine k queries may move, and the scores with them.
    """
    rows = [*differences(f"{command}: records", old["records"], new["records"], POSE_TOLERANCE)]
    moved = {line.partition("[")[2].partition("]")[0] for line in rows}
    count = len(old["records"]["query"])
    most = 0 if here else max(1, count // 1000)
    may_move = 0 < len(moved) <= most and "" not in moved
    old, new = ({k: v for k, v in one.items() if k != "records"} for one in (old, new))
    return [*rows, *differences(command, old, new, POSE_TOLERANCE)], may_move


def differences(place: str, old: Any, new: Any, tolerance: float) -> Iterator[str]:
    """Yield a line for every recorded value that is another one now, or missing.

    What is there now and was not recorded is no difference.
    """
    if isinstance(old, dict) and isinstance(new, dict):
        for key, value in old.items():
            if key in new:
                yield from differences(f"{place}: {key}", value, new[key], tolerance)
            else:
                yield f"{place}: {key}: is no more"
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for number, (one, other) in enumerate(zip(old, new, strict=True)):
            yield from differences(f"{place}[{number}]", one, other, tolerance)
    elif not _same(old, new, tolerance):
        yield f"{place}: {_short(old)} -> {_short(new)}"


def _same(old: Any, new: Any, tolerance: float) -> bool:
    if all(isinstance(one, int | float) for one in (old, new)):
        return bool(abs(old - new) <= tolerance * max(1.0, abs(old)))
    return bool(old == new)


def _short(value: Any) -> str:
    return f"{len(value)} values" if isinstance(value, list) else repr(value)
