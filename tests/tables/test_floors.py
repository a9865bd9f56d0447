"""Rows of what scores without a method: set apart, in italics, never the best."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.results.result import Reference, Result, write_result
from airzoo_bench.tables.layouts import scenes_layout, scenes_table
from airzoo_bench.tables.marks import mark_best
from airzoo_bench.tables.method_table import method_table, with_floors
from tests.tables.two_results import made

NAME, MEANING = "Chance level", "the mean over all orders of the gallery."


def chance(city: float, rural: float) -> Reference:
    mean = {"recall@1": (city + rural) / 2}
    scenes = {"City": {"recall@1": city}, "Rural": {"recall@1": rural}}
    return Reference(meaning=MEANING, scenes=scenes, overall=mean, pooled=mean)


def scored(method: str, city: float, rural: float, **parts: Any) -> Result:
    scenes = {"City": {"recall@1": city}, "Rural": {"recall@1": rural}}
    return made(method, scenes, **({"references": {NAME: chance(0.75, 0.5)}} | parts))


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    paths = [tmp_path / f"{name}.json" for name in ("Mine", "Poor")]
    for path, city in zip(paths, (0.5, 0.25), strict=True):
        write_result(path, scored(path.stem, city, 0.25))
    return paths


def test_they_are_never_the_best_nor_second() -> None:
    results = [scored("Mine", 0.5, 0.25), scored("Poor", 0.25, 0.25)]
    table = mark_best(scenes_layout(with_floors(method_table(results), results)), second=True)
    *own, floor = table.rows
    assert floor.floor
    assert floor.is_apart(own[-1])
    assert not any(cell.best or cell.second for cell in floor.cells)
    assert [[cell.best for cell in row.cells[1:]] for row in own] == [
        [True, True, True],
        [False, True, False],
    ]


def test_one_result_by_scene() -> None:
    rows = scenes_table(scored("Mine", 0.5, 0.25), floors=True).rows
    found = [(row.cells[0].value, row.cells[2].value) for row in rows if row.floor]
    assert found == [(NAME, 62.5), ("in City", 75.0), ("in Rural", 50.0)]
    assert not any(row.floor for row in scenes_table(scored("Mine", 0.5, 0.25)).rows)
