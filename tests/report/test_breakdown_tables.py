"""Breakdowns of results as tables: of one, of several, and what bad input gets."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from airzoo_bench.core.errors import UsageError
from tests.report.made import made_page, reconstruction_method, retrieval_method, run, write_methods


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
    done = run(*ask, "--format", "json")
    assert done.exit_code == 0, done.output
    table = json.loads(done.stdout)
    heads = [(column.get("group"), column["title"]) for column in table["columns"][2:]]
    assert heads == [(group, title) for group in ("R@1 [%]", "Median [m]") for title in ("a", "b")]
    rainy = [m.records[m.records["weather"] == "rainy"] for m in methods]
    row = next(row for row in table["rows"] if row[0] == "rainy")
    hits = [100 * rows["recall@1"].mean() for rows in rainy]
    errors = [rows["error_m"].median() for rows in rainy]
    assert row[2:] == pytest.approx([*hits, *errors])


def test_groups_of_one_method_are_not_those_of_another(tmp_path: Path) -> None:
    paths = write_methods(tmp_path, [retrieval_method("a", 0), retrieval_method("b", 1)])
    done = run("breakdown", *paths, "--by", "first_hit_rank")
    assert isinstance(done.exception, UsageError)
    assert "the column of b is not that of a" in str(done.exception)
    assert run("breakdown", paths[0], "--by", "first_hit_rank").exit_code == 0


def test_pictures_and_reports_do_not_put_queries_into_groups_of_another_method(
    tmp_path: Path,
) -> None:
    """Conditions are no part of the truth: a benchmark whose weather was corrected has its own."""
    one, other = retrieval_method("a", 0), retrieval_method("b", 1)
    other.records["weather"] = other.records["weather"].to_numpy()[::-1]
    paths = write_methods(tmp_path, [one, other])
    picture = tmp_path / "x.png"
    done = run("plot", "condition", *paths, "--by", "weather", "--score", "R@1", "-o", picture)
    assert "the column of b is not that of a" in str(done.exception)
    page = made_page(tmp_path, *paths)
    assert [one["title"] for one in page.parts[0]["queries"]["conditions"]] == ["altitude [m]"]
    assert {table[1][0][0] for table in page.tables["part1-conditions"]} == {"altitude [m]"}
    assert "no scores by weather: the results have other values of it" in page.text


def test_scenes_are_no_queries(tmp_path: Path) -> None:
    paths = write_methods(tmp_path, [reconstruction_method(name, 0) for name in "ab"])
    done = run("breakdown", *paths, "--by", "scene", "-f", "json")
    table = json.loads(done.stdout)
    assert table["columns"][1]["title"] == "Scenes"
    assert table["notes"] == []
    assert not any("quer" in note for note in table["notes"])
