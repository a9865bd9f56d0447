"""What the page's script is told of its charts and cells."""

from __future__ import annotations

import math

import numpy as np
import pytest

from airzoo_bench.report.chart import marker, tints, vertical_axis
from airzoo_bench.report.figures import series_style
from tests.statistics.support import ERROR, HIT


@pytest.mark.parametrize(
    ("score", "values", "log", "texts"),
    [
        (HIT, [0.0, 0.345], False, ["0", "10", "20", "30", "40"]),
        (HIT, [1.0, 0.001], False, ["0", "25", "50", "75", "100"]),  # shares never by decades
        (ERROR, [3.0, 290.0], False, ["0", "100", "200", "300"]),
        (ERROR, [0.7, math.inf, 300.0], True, ["0.1", "1", "10", "100", "1000"]),
        (ERROR, [2.0, 300.0], True, ["1", "2", "5", "10", "20", "50", "100", "200", "500", "1000"]),
        (ERROR, [0.001, 900.0], True, ["0.001", "0.01", "0.1", "1", "10", "100", "1000"]),
        (ERROR, [0.0, 900.0], False, ["0", "250", "500", "750", "1000"]),
        (ERROR, [math.inf, math.nan], False, []),
    ],
)
def test_axes(score: object, values: list[float], log: bool, texts: list[str]) -> None:
    made = vertical_axis(score, np.array([values]))  # type: ignore[arg-type]
    assert made["log"] is log
    found = [text for _, text in made["ticks"]]
    assert found[: len(texts)] == texts
    heights = [height for height, _ in made["ticks"]]
    assert heights == sorted(heights)
    assert heights[:1] + heights[-1:] == [0.0, 1.0][: 2 * len(heights)]


def test_a_mark_stands_at_its_value() -> None:
    made = vertical_axis(ERROR, np.array([[1.0, 10.0, 1000.0, math.inf, math.nan]]))
    assert made["heights"][0] == pytest.approx(
        [0, 1 / 3, 1, math.inf, math.nan], abs=1e-4, nan_ok=True
    )
    assert vertical_axis(HIT, np.array([[0.1, 0.4]]))["heights"][0].tolist() == [0.25, 1.0]


def test_better_cells_are_darker() -> None:
    values = np.array([[0.1, 0.9], [0.5, math.nan]])
    assert tints(HIT, values).tolist() == [[0.0, 0.42], [0.21, 0.0]]
    assert tints(ERROR, np.array([1.0, 100.0, 10000.0, math.inf])).tolist() == [0.42, 0.21, 0, 0]
    # What is nearly alike looks alike.
    assert np.ptp(tints(HIT, np.array([0.5, 0.51]))) < 0.05


def test_marks_are_those_of_pictures() -> None:
    made = [marker(number) for number in range(14)]
    colours = [series_style(number)["color"] for number in range(6)]
    assert [one["colour"] for one in made[:7]] == [*colours, "currentColor"]
    assert len({one["path"] for one in made[:7]}) == 7
    assert len({(one["colour"], one["path"]) for one in made}) == 14
    assert made[1]["path"] == "M-5.5 5.5L5.5 5.5L5.5 -5.5L-5.5 -5.5Z"  # a square
