"""What is said of intervals is what was made, wherever they stand."""

from __future__ import annotations

import numpy as np
import pytest

from airzoo_bench.core.errors import counted, plural
from airzoo_bench.statistics.intervals import Interval
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.interval_layout import with_intervals
from airzoo_bench.tables.method_table import OVERALL, method_table
from airzoo_bench.tables.wording import brackets_note, intervals_made, resampled
from tests.statistics.support import CHAMFER, ERROR, HIT, made_method

NONE = Interval(None, None, "", "why")
BCA, PERCENTILE = Interval(0.0, 1.0, "bca"), Interval(0.0, 1.0, "percentile")


@pytest.mark.parametrize(
    ("intervals", "kinds"),
    [
        ([BCA], "BCa"),
        ([PERCENTILE, NONE], "percentile"),
        ([PERCENTILE, BCA, PERCENTILE], "BCa or percentile"),
    ],
)
def test_kinds_that_were_made(intervals: list[Interval], kinds: str) -> None:
    resampling = ResamplingConfig(500, seed=3, confidence=0.9)
    made = f"90 % intervals, {kinds}, 500 resamples of scenes, seed 3"
    assert intervals_made(intervals, resampling, resampled("scene")) == made
    assert brackets_note(intervals, resampling, resampled("scene")) == [
        f"in square brackets: {made}"
    ]


def test_where_there_are_none_nothing_is_said() -> None:
    assert intervals_made([NONE], ResamplingConfig(), "scenes") == ""
    assert brackets_note([], ResamplingConfig(), "scenes") == []


def test_units() -> None:
    assert resampled("query") == "queries within scenes"
    assert [plural("query"), plural("scene")] == ["queries", "scenes"]
    assert [counted(1, "query"), counted(0, "scene")] == ["1 query", "0 scenes"]
    assert made_method({"s": {"recall@1": [1.0]}}).result.unit == "query"
    assert made_method({"s": {"chamfer_m": [1.0]}}, (CHAMFER,)).result.unit == "scene"


def test_a_board_names_the_kinds_that_it_shows() -> None:
    # All but one value are 3: no resample's median is above the average, and BCa does not exist.
    random = np.random.default_rng(0)
    scenes = {
        "east": {"recall@1": [1.0, 0.0] * 5, "error_m": random.random(10).tolist()},
        "west": {"recall@1": [1.0, 0.0] * 5, "error_m": [np.inf] * 3 + [1.0] * 7},
    }
    method = made_method(scenes, (HIT, ERROR))
    board = method_table([method.result])
    for shown, kinds in (
        (["east"], "Wilson over queries within scenes; BCa"),
        (["west"], "Wilson over queries within scenes; percentile"),
        (
            ["east", "west", OVERALL],
            "Wilson or MOVER over queries within scenes; BCa or percentile",
        ),
    ):
        note = with_intervals(board, [method], ResamplingConfig(500), shown).notes[0]
        assert f"95 % intervals, {kinds}, 500 resamples of queries within scenes" in note
