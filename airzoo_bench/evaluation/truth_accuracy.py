"""Thresholds of a protocol that are finer than the truth that they are applied to."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from airzoo_bench.core.errors import agreeing, first_of
from airzoo_bench.protocol.model import Protocol

__all__ = ["FACTOR", "accuracy_notes"]

FACTOR = 3.0
"""Errors of method and truth add as squares: a truth that is wrong by a third of a threshold makes
an error there larger by 5 % (the root of 1 + 1/9); one that is wrong by half of it, by 12 %."""

# Settings that hold lengths in metres, by which predictions pass or fail.
_THRESHOLDS = (
    *("distance_below_m", "translation_below_m", "pose_below_m_deg", "auc_up_to_m"),
    *("f1_below_m", "headline_below_m"),
)


def accuracy_notes(protocol: Protocol, accuracy_m: Mapping[str, float | None]) -> list[str]:
    """Say which thresholds are finer than three times the stated accuracy of the truth."""
    wanted = {scene.id for scene in protocol.scenes}
    stated = {
        scene: value for scene, value in accuracy_m.items() if value is not None and scene in wanted
    }
    if not stated:
        return []
    worst = max(stated.values())
    fine = sorted({m for m in _lengths(protocol.settings()) if m < FACTOR * worst})
    if not fine:
        return []
    of = [scene for scene, value in stated.items() if FACTOR * value > fine[0]]
    return [
        f"the truth of {first_of(of, noun='scene')} is stated to be good to "
        f"{worst:g} m: {agreeing(len(fine), 'the threshold', 'the thresholds')} "
        f"{', '.join(f'{m:g}' for m in fine)} m of {protocol.name} "
        f"{agreeing(len(fine), 'is', 'are')} finer than {FACTOR:g} times that, and "
        f"{agreeing(len(fine), 'measures', 'measure')} errors of the truth too"
    ]


def _lengths(settings: Any) -> Iterator[float]:
    """Yield the metres of all thresholds."""
    for key, value in settings.items():
        if isinstance(value, Mapping):
            yield from _lengths(value)
        elif key in _THRESHOLDS:
            for one in value if isinstance(value, list | tuple) else [value]:
                yield float(one[0] if isinstance(one, list | tuple) else one)
