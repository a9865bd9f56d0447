"""Every kind of fault that is put into an honest table is found, at a rate that is stated."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.audit.audit import audit
from tests.audit.honest import METHODS, Manner, honest
from tests.audit.support import Rows, published

SCENES = (97, 161, 190, 444)

Fault = Callable[[Rows, np.random.Generator], None]


def pick(rows: Rows, random: np.random.Generator, **having: object) -> dict[str, object]:
    found = [r for r in rows if all(r[key] == value for key, value in having.items())]
    return found[random.integers(len(found))]


def change_digit(text: object, random: np.random.Generator) -> str:
    """Replace one digit by another."""
    digits = list(str(text))
    places = [i for i, digit in enumerate(digits) if digit.isdigit()]
    place = places[random.integers(len(places))]
    digits[place] = str((int(digits[place]) + random.integers(1, 10)) % 10)
    return "".join(digits)


def digit_of(metric: str, scene: str) -> Fault:
    def fault(rows: Rows, random: np.random.Generator) -> None:
        row = pick(rows, random, metric=metric, scene=scene)
        row["value"] = change_digit(row["value"], random)

    return fault


def wrong_gain(rows: Rows, random: np.random.Generator) -> None:
    row = pick(rows, random, method=METHODS[-1])
    row["gain"] = change_digit(row["gain"], random)


def wrong_bold(rows: Rows, random: np.random.Generator) -> None:
    chosen = pick(rows, random, bold=0)
    for row in rows:
        if (row["scene"], row["metric"]) == (chosen["scene"], chosen["metric"]):
            row["bold"] = int(row is chosen)


# Least shares of tables in which a finding, of whatever grade, was not there without the fault:
# with the numbers of queries given, and without.
FAULTS: dict[str, tuple[Fault, float, float]] = {
    "a digit of R@3 in a scene": (digit_of("R@3", "S1"), 0.95, 0.95),
    "a digit of AP@5 in a scene": (digit_of("AP@5", "S1"), 0.9, 0.9),
    "a digit of a recall's average": (digit_of("R@3", "Average"), 0.99, 0.99),
    "a digit of a gain": (wrong_gain, 0.99, 0.99),
    "bold that is not the best": (wrong_bold, 0.99, 0.99),
}


def found_in(rows: Rows, counts: dict[str, int]) -> set[tuple[object, ...]]:
    with tempfile.TemporaryDirectory() as folder:
        table = published(Path(folder), rows)
    found = audit(table, counts)
    return {(f.grade, f.check, f.cell.method, f.cell.scene, f.cell.metric) for f in found.findings}


@cache
def found_before(manner: Manner, *, with_counts: bool) -> frozenset[tuple[object, ...]]:
    return frozenset(found_in(honest(manner), manner.counts if with_counts else {}))


def detection_rate(fault: Fault, *, with_counts: bool, trials: int) -> float:
    """Return in what share of honest tables a fault is found."""
    seen = 0
    for seed in range(trials):
        manner = Manner(seed, SCENES, gains="printed")
        counts = manner.counts if with_counts else {}
        rows = honest(manner)
        fault(rows, np.random.default_rng(seed))
        seen += bool(found_in(rows, counts) - found_before(manner, with_counts=with_counts))
    return seen / trials


USUAL = ("a digit of R@3 in a scene", "a digit of a recall's average", "a digit of a gain")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in USUAL else pytest.mark.slow) for name in FAULTS]
)
def test_a_fault_is_found(name: str) -> None:
    fault, given, alone = FAULTS[name]
    assert detection_rate(fault, with_counts=True, trials=4) >= given - 0.25
    assert detection_rate(fault, with_counts=False, trials=2) >= alone - 0.5
