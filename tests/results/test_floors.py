"""A method that is no better than chance, or than its prior, is marked and named on every face."""

from __future__ import annotations

from typing import Any

import pytest

from airzoo_bench.report.numbers import find, notes_by_method, summary_panes
from airzoo_bench.report.sections import Section
from airzoo_bench.results.comparison import FLOOR_MARK, compare, floor_note, score_intervals
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import Reference, ScoreColumn
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.comparison import comparison_table
from airzoo_bench.tables.layouts import methods_layout, scenes_table
from airzoo_bench.tables.method_table import method_table
from airzoo_bench.tables.render import render
from tests.statistics.support import ERROR, HIT, made_method

PLAN = ResamplingConfig(200)
HITS = {"east": 12, "west": 9}


def scored(
    name: str, floor: float, hits: dict[str, int], score: ScoreColumn = HIT, **parts: Any
) -> Scored:
    """Return hits on 20 queries of each scene beside a reference of one value everywhere."""
    scenes = {s: {score.key: [1.0] * n + [0.0] * (20 - n)} for s, n in hits.items()}
    method = made_method(scenes, (score,), name)
    part = {score.key: floor}
    reference = Reference(meaning="m", scenes=dict.fromkeys(hits, part), overall=part, pooled=part)
    update = {"references": {"Floor": reference}, **parts}
    return Scored(name, method.result.model_copy(update=update).with_checksum(), method.records)


@pytest.mark.parametrize("hits", [HITS, {"east": 12}])
def test_retrieval_is_no_better_where_its_interval_reaches_chance(hits: dict[str, int]) -> None:
    low = score_intervals(scored("a", 0.1, hits), [HIT], PLAN).overall[0].low
    assert low is not None
    assert floor_note(scored("a", low - 1e-9, hits).result) == ""
    note = floor_note(scored("a", low + 1e-9, hits).result)
    assert FLOOR_MARK in note
    assert "Floor" in note
    assert "R@1" in note


def test_matching_is_no_better_where_it_does_not_beat_the_prior() -> None:
    for floor, told in ((0.525, True), (0.52, False)):
        assert bool(floor_note(scored("a", floor, HITS, track="matching").result)) is told
        lower = scored("a", floor, HITS, ERROR, track="matching").result  # medians 0 and 1
        assert bool(floor_note(lower)) is False
    assert floor_note(scored("a", 0.5, HITS, ERROR, track="matching").result)


def test_every_face_marks_it_and_says_so() -> None:
    poor, good = scored("poor", 0.4, HITS), scored("good", 0.4, {"east": 19, "west": 18})
    note = floor_note(poor.result)
    compared = comparison_table(compare([good, poor], [HIT], resampling=PLAN))
    for table in (methods_layout(method_table([poor.result, good.result])), compared):
        assert f"poor: {note}" in table.notes
        assert [f"poor {FLOOR_MARK}" in row for row in table.texts()].count(True) == 1
        assert f"good {FLOOR_MARK}" not in str(table.texts())
    assert f"poor {FLOOR_MARK}" in render(compared, "markdown")
    alone = scenes_table(poor.result)
    assert note in alone.notes
    assert alone.texts()[-2][0] == f"Average {FLOOR_MARK}"
    section = Section([poor, good])
    assert f"poor: {note}" in notes_by_method(section)
    [table] = summary_panes(section, find(section))[0].tables
    names = [row[0] for row in table.texts()]
    assert names == [f"poor {FLOOR_MARK}", "good", "Floor"]
