"""``airzoo-bench compare`` as a person calls it."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path

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
        assert "Traceback" not in said.err
        return said.err if code else said.out

    return run


def test_numbers_for_machines(files: list[Path], compare: Callable[..., str]) -> None:
    table = json.loads(compare(*files, "--score", "MRR", "-f", "json"))
    titles = [column["title"] for column in table["columns"]]
    # The best comes first.
    row = dict(zip(titles, table["rows"][0], strict=True))
    assert row["Score"] == "MRR [%]"
    assert row["Method"] == "method02"
    assert row["Difference"] == pytest.approx(row["Value"] - row["Ref."])
    limits = table["uncertainties"][0][titles.index("Difference")]
    assert limits["low"] < row["Difference"] < limits["high"]
    assert row["Paired"] <= row["Holm"]
    assert row["McNemar"] is None
    assert row["Win"] + row["Tie"] + row["Loss"] == 70
    lines = list(csv.reader(io.StringIO(compare(*files, "--score", "MRR", "-f", "csv"))))
    assert len(lines) == 3
    assert {"Difference", "Difference from", "Difference to", "p Holm"} <= set(lines[0])


def test_intervals_of_one(files: list[Path], compare: Callable[..., str]) -> None:
    table = json.loads(compare(files[0], "-f", "json"))
    assert [row[:2] for row in table["rows"]] == [
        [scene, score]
        for scene in ("East", "West", "Average")
        for score in ("R@1 [%]", "Median [m]")
    ]
    for row, (*_, beside, _) in zip(table["rows"], table["uncertainties"], strict=True):
        assert beside["low"] < row[2] < beside["high"]
        scene, score = row[:2]
        of_shares = "MOVER" if scene == "Average" else "Wilson"
        assert row[3] == (of_shares if score == "R@1 [%]" else "BCa")


def test_one_scene_is_said_once(tmp_path: Path, compare: Callable[..., str]) -> None:
    (method,) = random_methods(1, {"east": 30}, (HIT, ERROR))
    table = json.loads(compare(write_method(tmp_path / "one", method), "-f", "json"))
    assert [row[:2] for row in table["rows"]] == [["East", "R@1 [%]"], ["East", "Median [m]"]]


def test_every_score(files: list[Path], compare: Callable[..., str]) -> None:
    for chosen, scores in ((files[:1], 3), (files[:2], 3)):
        table = json.loads(compare(*chosen, "--all", "-f", "json"))
        assert len({row[0 if len(chosen) == 2 else 1] for row in table["rows"]}) == scores
    assert "--all and --score exclude each other" in compare(
        *files, "--all", "--score", "MRR", code=2
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "RESULTS"),
        (["x.json", "y.json"], "x.json: no such result file"),
    ],
)
def test_wrong_calls(arguments: list[str], message: str, compare: Callable[..., str]) -> None:
    assert message in compare(*arguments, code=2)


def test_options_that_one_result_cannot_take(
    files: list[Path], compare: Callable[..., str]
) -> None:
    for option in (["--reference", "best"], ["--method", "x"]):
        assert option[0] in compare(files[0], *option, code=2)


def test_one_method_against_each_other(files: list[Path], compare: Callable[..., str]) -> None:
    table = json.loads(compare(*files, "--method", "method02", "--score", "MRR", "-f", "json"))
    titles = [column["title"] for column in table["columns"]]
    rows = [dict(zip(titles, row, strict=True)) for row in table["rows"]]
    assert {row["Against"] for row in rows} == {"method00", "method01"}
    for row in rows:
        assert row["Difference"] == pytest.approx(row["Value"] - row["Other"])
        assert row["Verdict"] != "worse"
        assert row["Win"] > row["Loss"]
    both = ("--method", "method02", "--reference", "method01")
    assert "--method and --reference exclude each other" in compare(*files, *both, code=2)
    assert "did you mean 'method01'" in compare(*files, "--method", "metod01", code=2)


def test_the_best_of_a_scene(tmp_path: Path, compare: Callable[..., str]) -> None:
    values = {"a": ([1.0] * 8, [0.0] * 8), "b": ([1.0] * 4 + [0.0] * 4, [1.0] * 8)}
    paths = [
        write_method(
            tmp_path / name,
            made_method({"x": {"recall@1": first}, "y": {"recall@1": second}}, name=name),
        )
        for name, (first, second) in values.items()
    ]
    for scene, said in (("X", "Against a"), ("y", "Against b")):
        assert said in compare(*paths, "--reference", "best", "--scene", scene)


def test_other_versions_are_told(tmp_path: Path, compare: Callable[..., str]) -> None:
    scenes = {"s": {"recall@1": [1.0, 0, 1, 0, 1, 1]}}
    paths = [
        write_method(tmp_path / name, made_method(scenes, name=name, version=version))
        for name, version in (("a", "1.0"), ("b", "1.1"))
    ]
    assert "made with different versions of airzoo-bench: 1.0 (a), 1.1 (b)" in compare(*paths)
