"""Scores by condition: groups, their labels and averages, and which columns are conditions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.core.errors import UsageError
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.results.records import read_records
from airzoo_bench.results.result import Result, read_result
from airzoo_bench.tables.breakdown import (
    condition_names,
    condition_title,
    even_edges,
    group_averages,
    group_records,
    is_condition,
)
from tests.matching import world as matching_world
from tests.report.made import retrieval_method, write_photo_results

RECORDS = pd.DataFrame(
    {
        "altitude_m": [10.0, 50.0, 99.9, 100.0, np.nan, 400.0],
        "weather": ["sunny", "rainy", None, "sunny", "foggy", "rainy"],
        "year": [2024, 2023, 2024, 2024, 2023, 2024],
        "night": [True, False, True, True, False, False],
    }
)


def groups(by: str, bins: list[float] | None = None) -> dict[str, list[int]]:
    found = group_records(RECORDS, by, bins)
    return {
        label: np.flatnonzero(found.codes == code).tolist()
        for code, label in enumerate(found.labels)
    }


def test_bins_hold_their_lower_edge() -> None:
    assert groups("altitude_m", [50, 100]) == {
        "below 50": [0],
        "50 to 100": [1, 2],
        "100 and more": [3, 5],
        "unknown": [4],
    }


def test_categories_are_sorted_and_unknown_is_last() -> None:
    assert groups("weather") == {"foggy": [4], "rainy": [1, 5], "sunny": [0, 3], "unknown": [2]}
    assert groups("year") == {"2023": [1, 4], "2024": [0, 2, 3, 5]}
    assert groups("night") == {"False": [1, 4, 5], "True": [0, 2, 3]}


@pytest.mark.parametrize(
    ("values", "labels"),
    [
        ([20240116, 20240115, 20240116], ["20240115", "20240116"]),
        # With an empty field they are read as floats.
        ([20240116.0, 20240115.0, np.nan], ["20240115", "20240116", "unknown"]),
        ([2**60, 2**60 + 1, 2**60], [str(2**60), str(2**60 + 1)]),
        ([0.5, 0.25, 0.5], ["0.25", "0.5"]),
        ([1 / 3, 2.0, 1 / 3], ["0.333333333333", "2"]),
        ([100.0001, 100.0002, 100.0], ["100", "100.0001", "100.0002"]),
        ([1.5e300, np.inf, 0.0], ["0", "1.5e+300", "inf"]),
        (["unknown", None, "fog"], ["fog", "unknown"]),
        (["unknown", "unknown", "fog"], ["fog", "unknown"]),
        (["zebra", "unknown", "fog"], ["fog", "zebra", "unknown"]),
        (["True", True, None], ["True", "unknown"]),
    ],
)
def test_labels_are_all_different(values: list[object], labels: list[str]) -> None:
    found = group_records(pd.DataFrame({"x": values}), "x")
    assert list(found.labels) == labels
    assert found.counts.sum() == len(values)
    # Groups keep the order of their values.
    known = [found.codes[place] for place in np.argsort(pd.Series(values).astype(str))]
    assert set(known) == set(range(len(labels)))


@pytest.mark.parametrize(
    ("by", "bins", "said"),
    [
        ("altitud_m", None, "did you mean 'altitude_m'"),
        ("weather", [1.0], "no number"),
        ("altitude_m", [100.0, 50.0], "do not ascend"),
        ("altitude_m", [50.0, 50.0], "do not ascend"),
        ("altitude_m", [np.nan], "do not ascend"),
        ("altitude_m", [], "do not ascend"),
    ],
)
def test_what_bad_groups_get(by: str, bins: list[float] | None, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        group_records(RECORDS, by, bins)


@given(
    st.lists(st.floats(-1e6, 1e6, allow_subnormal=False), min_size=2, max_size=50),
    st.integers(2, 9),
)
def test_even_edges_are_few_round_and_inside(values: list[float], most: int) -> None:
    array = np.array(values)
    edges = even_edges(array, most)
    assert len(edges) < most
    assert list(edges) == sorted(set(edges))
    assert all(array.min() < edge <= array.max() for edge in edges)


def test_even_edges_by_hand() -> None:
    assert even_edges(np.array([12.0, 487.0])) == (100, 200, 300, 400)
    assert even_edges(np.array([0.13, 0.19])) == (0.14, 0.15, 0.16, 0.17, 0.18)
    assert even_edges(np.array([3.0, 3.0])) == ()


def test_averages_are_those_of_pandas() -> None:
    random = np.random.default_rng(1)
    values, codes = random.random((2, 200)), random.integers(0, 5, 200)
    codes[codes == 3] = 4
    values[1, ::17] = np.inf
    found = group_averages(values, np.array([False, True]), codes, 5)
    frame = pd.DataFrame({"code": codes, "mean": values[0], "median": values[1]})
    by = frame.groupby("code").agg({"mean": "mean", "median": "median"}).reindex(range(5))
    np.testing.assert_allclose(found, by.to_numpy().T)
    assert np.isnan(found[:, 3]).all()


def test_conditions_are_what_no_method_did() -> None:
    assert condition_names(retrieval_method("a", 0)) == ["altitude_m", "weather"]
    assert condition_title("altitude_m") == "altitude [m]"
    assert condition_title("pitch_deg") == "pitch [°]"
    assert condition_title("time_of_day") == "time of day"


@pytest.mark.parametrize(
    ("track", "names"),
    [
        ("retrieval", ["scene", "query", "first_hit_rank", "tile@1", "tile@10"]),
        ("matching", ["status", "inliers"]),
        ("reconstruction", ["alignment"]),
        ("of a package that is not here", ["scene", "query", "answered"]),
    ],
)
def test_what_a_method_did_is_no_condition(track: str, names: list[str]) -> None:
    assert not any(is_condition(name, track) for name in names)
    assert is_condition("weather", track)


def conditions_left(result: Result, records: pd.DataFrame) -> set[str]:
    scores = {column.key for column in result.columns}
    return {
        name
        for name in map(str, records)
        if is_condition(name, result.track) and name not in scores
    }


def test_records_of_retrieval_hold_conditions_beside_what_is_declared(tmp_path: Path) -> None:
    _, [path] = write_photo_results(tmp_path, ["one"])
    records = read_records(path)
    assert "tile@5" in records
    assert conditions_left(read_result(path), records) == {"altitude_m", "pitch_deg"}


def test_records_of_matching_hold_conditions_beside_what_is_declared(tmp_path: Path) -> None:
    world = matching_world.make_world(tmp_path / "world")
    for form in (world.matches(), world.poses()):
        path = world.write(tmp_path / "method.npz", form)
        found = evaluate(path, data=world.root)
        assert conditions_left(found.result, found.records) == {"altitude_m", "pitch_deg"}
