"""Scores by condition: groups, averages, tables, and what bad input gets."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.core.errors import UsageError
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.results.records import Scored, read_records
from airzoo_bench.results.result import Result, read_result
from airzoo_bench.statistics.samples import Sample
from airzoo_bench.tables.breakdown import (
    condition_names,
    condition_title,
    even_edges,
    group_averages,
    group_records,
    is_condition,
    number_texts,
)
from tests.matching import world as matching_world
from tests.reconstruction import world as clouds_world
from tests.report.made import (
    reconstruction_method,
    retrieval_method,
    run,
    write_methods,
    write_photo_results,
)
from tests.statistics.support import made_result

NO_ALIGNMENT = {"method": "none"}

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


def test_bins_that_are_empty_are_left_out() -> None:
    assert groups("altitude_m", [150, 200, 300]) == {
        "below 150": [0, 1, 2, 3],
        "300 and more": [5],
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
        ([1 / 3, 2.0, 1 / 3], ["0.333333", "2"]),
        ([100.0001, 100.0002, 100.0], ["100", "100.0001", "100.0002"]),
        ([0.1, np.nextafter(0.1, 1.0), 0.1], ["0.1", "0.10000000000000002"]),
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


def test_labels_of_bins_are_all_different() -> None:
    records = pd.DataFrame({"date": [20240114, 20240115, 20240116, 20240117]})
    found = group_records(records, "date", [20240115, 20240116])
    assert found.labels == ("below 20240115", "20240115 to 20240116", "20240116 and more")
    assert found.counts.tolist() == [1, 1, 2]


@given(st.sets(st.floats(allow_nan=False), max_size=20))
def test_different_numbers_have_different_texts(values: set[float]) -> None:
    texts = number_texts(sorted(values))
    assert len(set(texts)) == len(values)
    assert [float(text) for text in texts] == pytest.approx(sorted(values), rel=1e-5)


def test_groups_of_one_name_are_refused() -> None:
    values = (np.zeros((1, 6)), np.zeros((1, 6)))
    with pytest.raises(ValueError, match="not all different"):
        Sample("query", ("a", "a"), values, np.zeros(1, bool))


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


def test_a_column_is_kept_by_the_track_that_makes_it() -> None:
    assert is_condition("alignment", "retrieval")


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


@pytest.mark.parametrize("cameras", [True, False])
def test_records_of_reconstruction_hold_what_is_declared(cameras: bool, tmp_path: Path) -> None:
    world = clouds_world.make_world(tmp_path / "data")
    clouds = {"lot": clouds_world.true_points("lot")}
    path = clouds_world.predict_clouds(world, tmp_path / "p", clouds, cameras)
    chosen = world.protocol(tmp_path / "c.toml", **({} if cameras else {"alignment": NO_ALIGNMENT}))
    found = world.score(path, protocol=str(chosen))
    assert found.records.shape[1] > 20
    assert conditions_left(found.result, found.records) == set()


def test_one_result_gives_a_column_a_score(tmp_path: Path) -> None:
    method = retrieval_method("mine", 0)
    [path] = write_methods(tmp_path, [method])
    done = run("breakdown", path, "--by", "weather", "--format", "json")
    assert done.exit_code == 0, done.output
    table = json.loads(done.stdout)
    rows = method.records[method.records["weather"] == "rainy"]
    text = json.dumps(table)
    assert f"{100 * rows['recall@1'].mean():.4f}"[:5] in text
    assert "unknown" in text


def test_one_score_has_intervals_of_each_group(tmp_path: Path) -> None:
    [path] = write_methods(tmp_path, [retrieval_method("mine", 0)])
    ask = ("breakdown", path, "--by", "altitude_m", "--bins", "22,100", "--score", "R@1")
    done = run(*ask, "--format", "csv")
    assert done.exit_code == 0, done.output
    rows = [line.split(",") for line in done.stdout.splitlines()]
    assert [head.split(" [")[0] for head in rows[0][3:]] == ["R@1 from", "R@1 to"]
    assert [row[0] for row in rows[1:]] == ["below 22", "22 to 100", "100 and more"]
    assert not any(text.replace(".", "").isdigit() for text in rows[1][3:])
    low, value, high = float(rows[2][3]), float(rows[2][2]), float(rows[2][4])
    assert low < value < high


def test_several_results_give_a_column_a_method(tmp_path: Path) -> None:
    paths = write_methods(tmp_path, [retrieval_method("a", 0), retrieval_method("b", 1)])
    done = run("breakdown", *paths, "--by", "scene", "--format", "markdown")
    assert done.exit_code == 0, done.output
    lines = done.stdout.splitlines()
    assert lines[0].startswith("| scene | Queries | a ")
    east, west = (line.split(" | ")[2:] for line in lines[2:4])
    # Both are best in the East; in the West b alone.
    assert east == ["**15.00**", "**15.00** |"]
    assert west == ["15.00", "**25.00** |"]


def test_two_scores_of_several_results(tmp_path: Path) -> None:
    methods = [retrieval_method("a", 0), retrieval_method("b", 1)]
    paths = write_methods(tmp_path, methods)
    ask = ("breakdown", *paths, "--by", "weather", "--score", "R@1", "--score", "Median")
    done = run(*ask, "--intervals", "--format", "json")
    assert done.exit_code == 0, done.output
    table = json.loads(done.stdout)
    heads = [(column.get("group"), column["title"]) for column in table["columns"][2:]]
    assert heads == [(group, title) for group in ("R@1 [%]", "Median [m]") for title in ("a", "b")]
    rainy = [m.records[m.records["weather"] == "rainy"] for m in methods]
    row = next(row for row in table["rows"] if row[0] == "rainy")
    hits = [100 * rows["recall@1"].mean() for rows in rainy]
    errors = [rows["error_m"].median() for rows in rainy]
    assert row[2:] == pytest.approx([*hits, *errors])
    limits = table["uncertainties"][table["rows"].index(row)][2:]
    for value, beside in zip(row[2:], limits, strict=True):
        assert beside["low"] < value < beside["high"]


def test_the_best_is_that_of_its_score(tmp_path: Path) -> None:
    methods = [retrieval_method("a", 0), retrieval_method("b", 1)]
    ask = ("--by", "scene", "--score", "R@1", "--score", "Median", "-f", "markdown")
    done = run("breakdown", *write_methods(tmp_path, methods), *ask)
    west = done.stdout.splitlines()[3].strip("| ").split(" | ")
    assert west[2:4] == ["15.00", "**25.00**"]
    assert sum(text.startswith("**") for text in west[4:]) == 1


def test_an_infinite_median_is_shown_and_explained(tmp_path: Path) -> None:
    method = retrieval_method("mine", 0)
    method.records.loc[method.records["weather"] == "rainy", "error_m"] = np.inf
    remade = made_result(method.records, method.result.columns)
    [path] = write_methods(tmp_path, [Scored("mine", remade, method.records)])
    done = run("breakdown", path, "--by", "weather", "--score", "Median", "-f", "markdown")
    rainy = next(line for line in done.stdout.splitlines() if line.startswith("| rainy"))
    assert " inf " in rainy
    assert "Median in rainy: no interval; all queries are alike" in done.stdout
    assert "half of the group or more failed" in done.stdout


def test_groups_of_one_method_are_not_those_of_another(tmp_path: Path) -> None:
    paths = write_methods(tmp_path, [retrieval_method("a", 0), retrieval_method("b", 1)])
    done = run("breakdown", *paths, "--by", "first_hit_rank")
    assert isinstance(done.exception, UsageError)
    assert "the column of b is not that of a" in str(done.exception)
    assert run("breakdown", paths[0], "--by", "first_hit_rank").exit_code == 0


def test_an_unknown_column_names_all_that_there_are(tmp_path: Path) -> None:
    [path] = write_methods(tmp_path, [retrieval_method("mine", 0)])
    done = run("breakdown", path, "--by", "wether", "--score", "R@1")
    assert "did you mean 'weather'" in str(done.exception)
    assert "altitude_m, weather" in str(done.exception)


def test_few_queries_are_one_line(tmp_path: Path) -> None:
    [path] = write_methods(tmp_path, [retrieval_method("mine", 0)])
    ask = ("--by", "altitude_m", "--bins", "22,26,30", "--intervals", "-f", "json")
    notes = json.loads(run("breakdown", path, *ask).stdout)["notes"]
    reason = "all scores in below 22, 22 to 26, 26 to 30: no interval; fewer than 5 queries"
    assert notes[1] == reason


def test_scenes_are_no_queries(tmp_path: Path) -> None:
    paths = write_methods(tmp_path, [reconstruction_method(name, 0) for name in "ab"])
    done = run("breakdown", *paths, "--by", "scene", "-f", "json")
    table = json.loads(done.stdout)
    assert table["columns"][1]["title"] == "Scenes"
    assert table["notes"] == []
    assert not any("quer" in note for note in table["notes"])


def test_bins_that_are_no_numbers(tmp_path: Path) -> None:
    [path] = write_methods(tmp_path, [retrieval_method("mine", 0)])
    done = run("breakdown", path, "--by", "altitude_m", "--bins", "50;100")
    assert isinstance(done.exception, UsageError)
    assert "no numbers" in str(done.exception)
