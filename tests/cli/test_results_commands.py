"""`table`, `compare` and `breakdown` hold what results and records hold, by query and by scene."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.results.records import Method
from airzoo_bench.results.result import ScoreColumn, write_result
from tests.statistics import support
from tests.statistics.support import CHAMFER, ERROR, HIT, SOFT, made_method, write_method
from tests.support import run_main

# From bad to good, with what formats must escape.
NAMES = ("weak_1 & co", "fair #2", "good 90 %")
F1 = SOFT.model_copy(update={"key": "f1@10", "title": "F1", "headline": True})
Run = Callable[..., str]


@pytest.fixture(params=["query", "scene"])
def methods(request: pytest.FixtureRequest) -> list[Method]:
    """Return three methods with a record for each query, or for each scene."""
    sizes, columns = {"east": 40, "west": 30}, (HIT, ERROR, SOFT)
    if request.param == "scene":
        sizes, columns = {f"s{number}": 1 for number in range(8)}, (CHAMFER, F1)
    made = support.random_methods(3, sizes, columns)
    random = np.random.default_rng(1)
    altitudes = random.uniform(50, 400, len(made[0].records)).round(1)
    for method in made:
        method.records["altitude_m"] = altitudes
        method.records["weather"] = np.where(altitudes > 200, "sunny", "rainy")
    return [
        Method(name, support.made_result(one.records, columns, name), one.records)
        for name, one in zip(NAMES, made, strict=True)
    ]


@pytest.fixture
def paths(methods: list[Method], tmp_path: Path) -> list[Path]:
    return [write_method(tmp_path / str(n), method) for n, method in enumerate(methods)]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    """Return a function that runs a command and returns what it printed."""

    def call(*arguments: object, code: int = 0) -> str:
        capsys.readouterr()
        found, said = run_main(*arguments), capsys.readouterr()
        assert found == code, said.err
        return said.err if code else said.out

    return call


def read(run: Run, *ask: object) -> tuple[list[str], list[dict[str, Any]], dict[str, Any]]:
    """Return columns, rows by column and all of a table, whose CSV holds the same rounded."""
    # JSON as the standard has it: without NaN and Infinity.
    table = json.loads(run(*ask, "--format", "json"), parse_constant=pytest.fail)
    columns = [f"{c.get('group', '')} {c['title']}".strip() for c in table["columns"]]
    shown = pd.read_csv(io.StringIO(run(*ask, "--format", "csv")))
    for place, name in enumerate(columns):
        values = [row[place] for row in table["rows"]]
        if values and all(isinstance(v, float) for v in values) and "–" not in {*shown[name]}:
            assert np.allclose(shown[name].astype(float), values, atol=0.0051)
    texts = {"Infinity": np.inf, "-Infinity": -np.inf}
    rows = [
        {name: texts.get(str(cell), cell) for name, cell in zip(columns, row, strict=True)}
        for row in table["rows"]
    ]
    return columns, rows, table


def one_of(rows: list[dict[str, Any]], **cells: Any) -> dict[str, Any]:
    (row,) = (row for row in rows if cells.items() <= row.items())
    return row


def as_shown(column: ScoreColumn, value: float) -> float:
    return value * 100 if column.unit == "share" else value


def headline(methods: list[Method]) -> list[ScoreColumn]:
    return [column for column in methods[0].result.columns if column.headline]


def title_of(column: ScoreColumn) -> str:
    unit = "%" if column.unit == "share" else column.unit
    return f"{column.title} [{unit}] {'↓↑'[column.higher_is_better]}"


def test_tables_hold_the_results(methods: list[Method], paths: list[Path], run: Run) -> None:
    last = list(methods[0].result.scenes)[-1]
    for options, scene in ((), None), (("--scene", last), last):
        _, rows, _ = read(run, "table", *paths, "--all", *options)
        for method in methods:
            row, result = one_of(rows, Method=method.name), method.result
            values = result.overall if scene is None else result.scenes[scene]
            for column in result.columns:
                assert row[column.title] == pytest.approx(as_shown(column, values[column.key]))
    _, rows, _ = read(run, "table", paths[0])
    result = methods[0].result
    for scene, title in result.truth.scene_titles.items():
        for column in headline(methods):
            value = as_shown(column, result.scenes[scene][column.key])
            assert one_of(rows, Scene=title)[column.title] == pytest.approx(value)


def test_comparisons_hold_differences(methods: list[Method], paths: list[Path], run: Run) -> None:
    last = list(methods[0].result.scenes)[-1]
    for options, base, scene in (
        ((), 0, None),
        (("--reference", NAMES[1]), 1, None),
        (("--scene", last), 0, last),
    ):
        _, rows, _ = read(run, "compare", *paths, *options)
        assert len(rows) == 2 * len(headline(methods))
        for column in headline(methods):
            values = [
                as_shown(column, (m.result.scenes.get(scene or "") or m.result.overall)[column.key])
                for m in methods
            ]
            for place in {0, 1, 2} - {base}:
                row = one_of(rows, Score=title_of(column), Method=NAMES[place])
                assert row["Value"] == pytest.approx(values[place])
                assert row["Difference"] == pytest.approx(values[place] - values[base])


@pytest.mark.parametrize("methods", ["query"], indirect=True)
def test_the_numbers_of_a_comparison(methods: list[Method], paths: list[Path], run: Run) -> None:
    columns, rows, table = read(run, "compare", *paths, paths[0], "--score", "MRR")
    row, beside = rows[0], table["uncertainties"][0][columns.index("Difference")]
    assert (row["Score"], row["Method"]) == ("MRR [%] ↑", NAMES[2])  # the best comes first
    assert beside["low"] < row["Difference"] < beside["high"]
    assert row["p Paired"] <= row["p Holm"]
    assert row["p McNemar"] is None
    assert sum(row[f"Queries {kind}"] for kind in ("Win", "Tie", "Loss")) == 70
    # Of one, its table with intervals.
    columns, rows, table = read(run, "compare", paths[0])
    assert [row["Scene"] for row in rows] == ["East", "West", "Average", "Pooled"]
    for row, limits in zip(rows[:3], table["uncertainties"], strict=False):
        for name in ("R@1", "Median"):
            beside = limits[columns.index(name)]
            assert beside["low"] < row[name] < beside["high"]


def test_the_best_of_a_scene(tmp_path: Path, run: Run) -> None:
    values = {"a": ([1.0] * 8, [0.0] * 8), "b": ([1.0] * 4 + [0.0] * 4, [1.0] * 8)}
    paths = []
    for name, (first, second) in values.items():
        scenes = {"x": {"recall@1": first}, "y": {"recall@1": second}}
        paths.append(write_method(tmp_path / name, made_method(scenes, name=name)))
    for scene, said in (("X", "against a ("), ("y", "against b (")):
        assert said in run("compare", *paths, "--reference", "best", "--scene", scene)


def test_groups_have_their_averages(methods: list[Method], paths: list[Path], run: Run) -> None:
    records = methods[2].records
    edges = sorted({float(f"{e:.1f}") for e in records["altitude_m"].quantile([0.3, 0.7])})
    bins = ("--bins", ",".join(map(str, edges)))
    codes = np.searchsorted(edges, records["altitude_m"], side="right")
    kinds: list[tuple[str, tuple[str, ...], Any]] = [
        ("altitude_m", bins, codes),
        ("weather", (), records["weather"]),
        ("scene", (), records["scene"]),
    ]
    for column, (by, options, groups) in product(headline(methods), kinds):
        columns, rows, _ = read(
            run, "breakdown", *paths, "--by", by, *options, "--score", column.key
        )
        parts = records.groupby(groups)[column.key]
        expected = parts.median() if column.average == "median" else parts.mean()
        assert [row[columns[1]] for row in rows] == parts.size().tolist()
        for row, value in zip(rows, expected, strict=True):
            assert row[NAMES[2]] == pytest.approx(as_shown(column, value))


WRONG = {
    "compare": "RESULTS",
    "table uav-visloc-retreival --published": "did you mean 'uav-visloc-retrieval'",
    "compare 0 --reference best": "--reference",
    "compare 0 1 2 --all --score MRR": "--all and --score exclude each other",
    "compare 0 1 --reference fair#2": "did you mean 'fair #2'",
    "breakdown 0 --by altitud": "did you mean 'altitude_m'",
    "breakdown 0 --by weather --bins 1": "--bins",
    "breakdown 0 --by altitude_m --bins 9,5": "--bins",
    "breakdown 0 --by altitude_m --bins 5,5": "--bins",
    "breakdown 0 --by altitude_m --bins nan": "--bins",
    "compare 0 other": "protocol",
    "breakdown 0 other --by scene": "protocol",
    "table 0 other --layout methods": "other/result.json",
    "table moved.json alone.json": "moved.json",
    "table 0 1 --layout result": "layout result",
    "table 0 1 --layout scenes --scene East": "--scene",
    "table 0 1 --baseline weak_1": "did you mean 'weak_1 & co'",
    "table 0 1 --highlight x": "--highlight",
    "table 0 --cite none.toml": "none.toml: no such file",
    "table 0 --score R@2": "did you mean 'R@1'",
    "table 0 1 --scene Sea": "one of east, west",
    "table alone.json --intervals": "records",
    "plot errors 0 --by weather -o x.png": "of these: --score",
    "plot condition 0 -o x.png": "needs --by",
    "plot errors 0 --score R@1 -o x.png": "no error",
    "plot condition 0 --by wether -o x.png": "'weather'",
    "plot map 0 --scene eats -o x.png": "no scene 'eats'",
    "plot thresholds 0 -o x.png": "no precision over distance",
    "plot condition 0 --by weather --width wide -o x.png": "no width",
    "plot condition 0 --by weather -o x.gif": "cannot be written as .gif",
    "plot condition 0 other --by scene -o x.png": "protocol",
}


@pytest.mark.parametrize("methods", ["query"], indirect=True)
def test_wrong_calls(
    paths: list[Path], tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    other = made_method({"x": {"recall@1": [1.0, 0.0]}}, protocol="q" * 64)
    used = other.result.protocol.model_copy(update={"name": "another"})
    result = other.result.model_copy(update={"protocol": used}).with_checksum()
    write_method(tmp_path / "other", Method("other", result, other.records))
    write_result(tmp_path / "alone.json", result)
    truth = result.truth.model_copy(update={"fingerprint": "u" * 64})
    write_result(tmp_path / "moved.json", result.with_checksum(truth=truth))
    for call, named in WRONG.items():
        assert named in run(*call.split(), code=2), call
    assert not list(tmp_path.glob("x.*"))
