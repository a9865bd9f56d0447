"""``airzoo-bench compare`` as a person calls it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.statistics.support import ERROR, HIT, SOFT, made_method, random_methods, write_method
from tests.support import run_main


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    methods = random_methods(3, {"east": 40, "west": 30}, (HIT, ERROR, SOFT))
    return [write_method(tmp_path / method.name, method) for method in methods]


@pytest.fixture
def compare(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    def run(*arguments: object, code: int = 0) -> str:
        assert run_main("compare", *arguments) == code
        said = capsys.readouterr()
        return said.err if code else said.out

    return run


def rows_of(text: str) -> tuple[list[str], list[dict[str, Any]], list[Any]]:
    table = json.loads(text)
    titles = [column["title"] for column in table["columns"]]
    rows = [dict(zip(titles, row, strict=True)) for row in table["rows"]]
    return titles, rows, table["uncertainties"]


def test_the_numbers_of_a_comparison(files: list[Path], compare: Callable[..., str]) -> None:
    titles, rows, limits = rows_of(compare(*files, "--score", "MRR", "-f", "json"))
    row, beside = rows[0], limits[0][titles.index("Difference")]
    assert (row["Score"], row["Method"]) == ("MRR [%]", "method02")  # the best comes first
    assert row["Difference"] == pytest.approx(row["Value"] - row["Ref."])
    assert beside["low"] < row["Difference"] < beside["high"]
    assert row["Paired"] <= row["Holm"]
    assert row["McNemar"] is None
    assert row["Win"] + row["Tie"] + row["Loss"] == 70
    _, rows, _ = rows_of(compare(*files, "--method", "method02", "--score", "MRR", "-f", "json"))
    assert {row["Against"] for row in rows} == {"method00", "method01"}
    for row in rows:
        assert row["Difference"] == pytest.approx(row["Value"] - row["Other"])
        assert row["Verdict"] != "worse"
        assert row["Win"] > row["Loss"]


def test_intervals_of_one(files: list[Path], compare: Callable[..., str], tmp_path: Path) -> None:
    _, rows, limits = rows_of(compare(files[0], "-f", "json"))
    scores = ("R@1 [%]", "Median [m]")
    expected = [(scene, score) for scene in ("East", "West", "Average") for score in scores]
    assert [(row["Scene"], row["Score"]) for row in rows] == expected
    for row, (*_, beside, _) in zip(rows, limits, strict=True):
        assert beside["low"] < row["Value"] < beside["high"]
        of_shares = "MOVER" if row["Scene"] == "Average" else "Wilson"
        assert row["Interval"] == (of_shares if row["Score"] == "R@1 [%]" else "BCa")
    (method,) = random_methods(1, {"east": 30}, (HIT, ERROR))
    _, rows, _ = rows_of(compare(write_method(tmp_path / "one", method), "-f", "json"))
    assert [row["Scene"] for row in rows] == ["East", "East"]  # said once


def test_the_best_of_a_scene_and_other_versions(
    tmp_path: Path, compare: Callable[..., str]
) -> None:
    values = {"a": ([1.0] * 8, [0.0] * 8), "b": ([1.0] * 4 + [0.0] * 4, [1.0] * 8)}
    paths = []
    for version, (name, (first, second)) in enumerate(values.items()):
        scenes = {"x": {"recall@1": first}, "y": {"recall@1": second}}
        method = made_method(scenes, name=name, version=f"1.{version}")
        paths.append(write_method(tmp_path / name, method))
    for scene, said in (("X", "Against a"), ("y", "Against b")):
        assert said in compare(*paths, "--reference", "best", "--scene", scene)
    assert "different versions of airzoo-bench: 1.0 (a), 1.1 (b)" in compare(*paths)


@pytest.mark.parametrize(
    ("count", "arguments", "named"),
    [
        (0, [], "RESULTS"),
        (0, ["x.json"], "x.json: no such result file"),
        (1, ["--reference", "best"], "--reference"),
        (1, ["--method", "x"], "--method"),
        (3, ["--all", "--score", "MRR"], "--all and --score exclude each other"),
        (3, ["--method", "method02", "--reference", "method01"], "exclude each other"),
        (3, ["--method", "metod01"], "did you mean 'method01'"),
    ],
)
def test_wrong_calls(
    files: list[Path], compare: Callable[..., str], count: int, arguments: list[str], named: str
) -> None:
    assert named in compare(*files[:count], *arguments, code=2)
