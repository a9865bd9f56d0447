"""Whether some weights of the scenes explain several averages."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.audit.average_checks import Averaged, check_averages, has_common_weights
from airzoo_bench.tables.printed.numbers import Interval, mean_interval
from tests.audit.honest import Manner, honest
from tests.audit.support import published, rows_of


def averaged(folder: Path, scenes: tuple[str, ...], average: str) -> Averaged:
    values = {f"S{i}": {"R@1": value} for i, value in enumerate(scenes)}
    *parts, cell = published(folder, rows_of({"A": values | {"Average": {"R@1": average}}})).cells
    mean = mean_interval(part.number.interval for part in parts)
    everywhere = Interval(mean.low - 100, mean.high + 100)
    value = sum((part.number.value for part in parts), mean.low * 0) / len(parts)
    return Averaged(cell, tuple(parts), mean, everywhere, value, is_weighed=False)


@pytest.mark.parametrize(
    ("average", "possible"), [("8", False), ("9", True), ("10", True), ("11", True), ("12", False)]
)
def test_the_digits_leave_room(tmp_path: Path, average: str, possible: bool) -> None:
    assert has_common_weights([averaged(tmp_path, ("10", "10", "10"), average)]) is possible


@pytest.mark.parametrize(("last", "possible"), [("5.00", True), ("5.10", False)])
def test_weights_are_common_to_all(tmp_path: Path, last: str, possible: bool) -> None:
    # With weights of 1/4, 1/4 and 1/2.
    made = [
        averaged(tmp_path, ("10.00", "20.00", "40.00"), "27.50"),
        averaged(tmp_path, ("10.00", "30.00", "20.00"), "20.00"),
        averaged(tmp_path, ("0.00", "0.00", "10.00"), last),
    ]
    assert has_common_weights(made) is possible


def test_scenes_of_like_size_printed_coarsely(tmp_path: Path) -> None:
    # Most of these averages over queries happen to be means over scenes as well.
    manner = Manner(280, (314, 397, 399), "ROUND_DOWN", 0, pooled=True, all_bold=False)
    outcome = check_averages(published(tmp_path, honest(manner)), {}, {})
    assert not [finding for finding in outcome.findings if finding.grade.value != "rounding"]
    assert "--counts" in outcome.left
