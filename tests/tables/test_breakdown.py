"""Scores by condition: groups and their labels, averages, tables, and what is a condition."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.core.errors import UsageError
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.report.sections import Section
from airzoo_bench.results.records import Method, read_records
from airzoo_bench.results.result import Result, read_result
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.breakdown import (
    breakdown_table,
    condition_names,
    condition_title,
    even_edges,
    group_records,
    is_condition,
)
from tests.matching import world as matching_world
from tests.report.made import (
    reconstruction_method,
    retrieval_method,
    run,
    write_methods,
    write_photo_results,
)
from tests.statistics.support import ERROR, HIT, random_methods

NAN = np.nan
RECORDS = pd.DataFrame(
    {
        "altitude_m": [10.0, 50.0, 99.9, 100.0, NAN, 400.0],
        "weather": ["sunny", "rainy", None, "sunny", "foggy", "rainy"],
        "night": [True, False, True, True, False, False],
    }
)


@pytest.mark.parametrize(
    ("by", "bins", "groups"),
    [
        (
            *("altitude_m", [50, 100]),  # bins hold their lower edge
            {"below 50": [0], "50 to 100": [1, 2], "100 and more": [3, 5], "unknown": [4]},
        ),
        ("weather", None, {"foggy": [4], "rainy": [1, 5], "sunny": [0, 3], "unknown": [2]}),
        ("night", None, {"False": [1, 4, 5], "True": [0, 2, 3]}),
    ],
)
def test_groups(by: str, bins: list[float] | None, groups: dict[str, list[int]]) -> None:
    found = group_records(RECORDS, by, bins)
    rows = {name: np.flatnonzero(found == name).tolist() for name in found.categories}
    assert list(rows.items()) == list(groups.items())


@pytest.mark.parametrize(
    ("values", "labels"),
    [
        ([20240116, 20240115, 20240116], ["20240115", "20240116"]),
        # With an empty field they are read as floats.
        ([20240116.0, 20240115.0, NAN], ["20240115", "20240116", "unknown"]),
        ([2**60, 2**60 + 1, 2**60], [str(2**60), str(2**60 + 1)]),
        ([1 / 3, 2.0, 1 / 3], ["0.333333333333", "2"]),
        ([100.0001, 100.0002, 100.0], ["100", "100.0001", "100.0002"]),
        ([0.1 + 0.2, 0.3, 1.0], ["0.3", "1"]),
        ([1.5e300, np.inf, 0.0], ["0", "1.5e+300", "inf"]),
        (["zebra", "unknown", "fog"], ["fog", "zebra", "unknown"]),
        (["True", True, None], ["True", "unknown"]),
    ],
)
def test_labels_are_all_different(values: list[object], labels: list[str]) -> None:
    found = group_records(pd.DataFrame({"x": values}), "x")
    assert list(found.categories) == labels
    assert set(found) == set(labels)


@given(
    st.lists(st.floats(-1e6, 1e6, allow_subnormal=False), min_size=2, max_size=50),
    st.integers(2, 9),
)
def test_even_edges_are_few_round_and_inside(values: list[float], most: int) -> None:
    array = np.array(values)
    assert len(edges := even_edges(array, most)) < most
    assert edges == sorted(set(edges))
    assert all(array.min() < edge <= array.max() for edge in edges)
    found = [even_edges(np.array(ends)) for ends in ([12.0, 487.0], [3.0, 3.0])]
    assert found == [[100, 200, 300, 400], []]
    assert even_edges(np.repeat([71.8, 72, 80.1, 93, 99], [30, 1, 5, 2, 3]), least=5) == [75, 85]


def methods_at(altitudes: list[float]) -> list[Method]:
    methods = random_methods(2, {"east": 20}, (HIT, ERROR))
    for method in methods:
        method.records["altitude_m"] = np.resize(altitudes, 20)
    return methods


@pytest.mark.parametrize("plan", [None, ResamplingConfig(resamples=1_000)])
def test_empty_bins_are_rows_without_values(plan: ResamplingConfig | None) -> None:
    methods, bins = methods_at([61.5, 88.0]), [30, 60, 70, 80]
    table = breakdown_table(methods, [HIT, ERROR], "altitude_m", bins=bins, resampling=plan)
    rows = [[cell.value for cell in row.cells] for row in table.rows]
    labels = ["below 30", "30 to 60", "60 to 70", "70 to 80", "80 and more"]
    assert [row[:2] for row in rows] == [
        list(p) for p in zip(labels, [0, 0, 10, 0, 10], strict=True)
    ]
    for row in rows:
        assert [value is None for value in row[2:]] == [row[1] == 0] * 4
    assert not any("fewer" in note for note in table.notes)
    for altitudes, shown in (([20.0, NAN], [10, 0, 10]), ([NAN], [0, 0, 20])):
        found = breakdown_table(methods_at(altitudes), [HIT], "altitude_m", bins=[30]).rows
        assert [row.name for row in found] == ["below 30", "30 and more", "unknown"]
        assert [row.cells[1].value for row in found] == shown


def breakdown(*ask: object) -> Any:
    done = run("breakdown", *ask, "--format", "json")
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def test_tables_of_one_and_of_several_results(tmp_path: Path) -> None:
    methods = [retrieval_method("a", 0), retrieval_method("b", 1)]
    paths = write_methods(tmp_path, methods)
    ask = ("--by", "altitude_m", "--bins", "22,100", "--score", "R@1")
    one = breakdown(paths[0], *ask)
    assert [row[0] for row in one["rows"]] == ["below 22", "22 to 100", "100 and more"]
    [few, some, _] = [row[2] for row in one["uncertainties"]]
    assert few is None
    assert some["low"] < one["rows"][1][2] < some["high"]
    two = breakdown(*paths, "--by", "weather", "--score", "R@1", "--score", "Median")
    heads = [(column.get("group"), column["title"]) for column in two["columns"][2:]]
    assert heads == [(group, title) for group in ("R@1 [%]", "Median [m]") for title in ("a", "b")]
    text = run("breakdown", *paths, "--by", "scene", "--format", "markdown").stdout
    assert text.count("**") == 2  # both are alike in one scene, one is best in the other
    paths = write_methods(tmp_path, [reconstruction_method(name, 0) for name in "ab"])
    assert breakdown(*paths, "--by", "scene")["columns"][1]["title"] == "Scenes"


def test_groups_of_one_method_are_not_those_of_another(tmp_path: Path) -> None:
    """Conditions are no part of the truth: a benchmark whose weather was corrected has its own."""
    methods = [retrieval_method("a", 0), retrieval_method("b", 1)]
    methods[1].records["weather"] = methods[1].records["weather"].to_numpy()[::-1]
    paths = write_methods(tmp_path, methods)
    assert run("breakdown", paths[0], "--by", "first_hit_rank").exit_code == 0
    for by, ask in (
        ("first_hit_rank", ("breakdown", *paths)),
        ("weather", ("plot", "condition", *paths, "-o", tmp_path / "x.png")),
    ):
        done = run(*ask, "--by", by)
        assert isinstance(done.exception, UsageError)
        assert by in str(done.exception)
    assert Section(methods).conditions == ["altitude_m"]


def test_conditions_are_what_no_method_did(tmp_path: Path) -> None:
    assert condition_names(retrieval_method("a", 0)) == ["altitude_m", "weather"]
    titles = [condition_title(name) for name in ("altitude_m", "pitch_deg", "time_of_day")]
    assert titles == ["altitude [m]", "pitch [°]", "time of day"]
    for track, names in {
        "retrieval": ["scene", "query", "first_hit_rank", "tile@1", "tile@10"],
        "matching": ["status", "inliers"],
        "reconstruction": ["alignment"],
        "of a package that is not here": ["scene", "query", "answered"],
    }.items():
        assert [is_condition(name, track) for name in (*names, "weather")][-2:] == [False, True]
        assert not any(is_condition(name, track) for name in names)

    def left(result: Result, records: pd.DataFrame) -> set[str]:
        known = {column.key for column in result.columns}
        return {n for n in map(str, records) if n not in known and is_condition(n, result.track)}

    _, [path] = write_photo_results(tmp_path, ["one"])
    assert left(read_result(path), read_records(path)) == {"altitude_m", "pitch_deg"}
    world = matching_world.make_world(tmp_path / "world")
    for form in (world.matches(), world.poses()):
        found = evaluate(world.write(tmp_path / "method.npz", form), data=world.root)
        assert left(found.result, found.records) == {"altitude_m", "pitch_deg"}
