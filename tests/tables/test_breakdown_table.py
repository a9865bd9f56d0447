"""Breakdowns with bins that hold nothing."""

from __future__ import annotations

import numpy as np

from airzoo_bench.results.records import Scored
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.breakdown import breakdown_table
from tests.statistics.support import ERROR, HIT, random_methods


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


def test_unknown_is_a_row_only_where_there_is_some() -> None:
    table = breakdown_table(methods_at([20.0, np.nan]), [HIT], "altitude_m", bins=[30])
    assert [row.cells[:2] for row in table.rows][1][1].value == 0
    assert [row.cells[0].value for row in table.rows] == ["below 30", "30 and more", "unknown"]
    nowhere = breakdown_table(methods_at([np.nan]), [HIT], "altitude_m", bins=[30])
    assert [row.cells[1].value for row in nowhere.rows] == [0, 0, 20]
    assert len(nowhere.notes) == 1
