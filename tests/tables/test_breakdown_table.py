"""Breakdowns with bins that hold nothing."""

from __future__ import annotations

import numpy as np

from airzoo_bench.results.records import Scored
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.breakdown import group_records
from airzoo_bench.tables.breakdown_layout import breakdown_table
from tests.statistics.support import ERROR, HIT, SOFT, random_methods


def methods_at(altitudes: list[float], count: int = 2) -> list[Scored]:
    methods = random_methods(count, {"east": 20}, (HIT, ERROR))
    for method in methods:
        method.records["altitude_m"] = np.resize(altitudes, 20)
    return methods


def test_empty_bins_are_rows_without_values() -> None:
    for resampling in (None, ResamplingConfig(resamples=200)):
        table = breakdown_table(
            methods_at([61.5, 88.0]),
            [HIT, ERROR],
            "altitude_m",
            bins=[30, 60, 70, 80],
            resampling=resampling,
        )
        rows = [[cell.value for cell in row.cells] for row in table.rows]
        labels = ["below 30", "30 to 60", "60 to 70", "70 to 80", "80 and more"]
        assert [row[0] for row in rows] == labels
        assert [row[1] for row in rows] == [0, 0, 10, 0, 10]
        for row in rows:
            assert [value is None for value in row[2:]] == [row[1] == 0] * 4
        assert table.notes[1] == "bins without queries: altitude [m] is from 61.5 to 88"
        assert not any("fewer" in note for note in table.notes)


def test_full_bins_need_no_note() -> None:
    table = breakdown_table(methods_at([20.0, 88.0]), [HIT], "altitude_m", bins=[30])
    assert len(table.rows) == 2
    assert len(table.notes) == 1


def test_unknown_is_a_row_only_where_there_is_some() -> None:
    table = breakdown_table(methods_at([20.0, np.nan]), [HIT], "altitude_m", bins=[30])
    assert [row.cells[:2] for row in table.rows][1][1].value == 0
    assert [row.cells[0].value for row in table.rows] == ["below 30", "30 and more", "unknown"]
    nowhere = breakdown_table(methods_at([np.nan]), [HIT], "altitude_m", bins=[30])
    assert [row.cells[1].value for row in nowhere.rows] == [0, 0, 20]
    assert len(nowhere.notes) == 1


def test_bins_that_nobody_named_are_never_empty() -> None:
    records = methods_at([*np.linspace(1, 10, 13), 100.0], 1)[0].records
    found = group_records(records, "altitude_m", keep_empty=True)
    assert found.counts.all()
    assert not group_records(records, "altitude_m", [200, 300], keep_empty=True).counts[1:].any()
    assert len(group_records(records, "altitude_m", [200, 300]).labels) == 1


def test_many_scores_stand_side_by_side_where_a_page_takes_them() -> None:
    methods = random_methods(2, {"east": 20}, (HIT, ERROR, SOFT))
    table = breakdown_table(methods, [HIT, ERROR, SOFT], "scene")
    assert table.groups_per_block == 3
