"""Results from Python: read back, shown, compared, and intervals of their columns."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from typer.testing import Result as Run

import airzoo_bench as ab
from airzoo_bench.results.comparable import choose_scores
from airzoo_bench.results.result import Reference
from tests.api.support import refused
from tests.statistics.support import ERROR, HIT, SOFT, random_methods, write_method

COLUMNS = (HIT, ERROR, SOFT)


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    root = tmp_path_factory.mktemp("results")
    methods = random_methods(3, {"east": 60, "west": 40}, COLUMNS)
    for method in methods:
        write_method(root / method.name, method)
    return [root / method.name for method in methods]


def test_a_result_has_its_records_and_a_frame_of_scenes_and_scores(folders: list[Path]) -> None:
    found = ab.load_result(str(folders[0]))
    assert isinstance(found.records, pd.DataFrame)
    frame = found.to_frame()
    assert frame.index.tolist() == ["east", "west", "overall", "pooled"]
    assert frame.columns.tolist() == ["recall@1", "error_m", "mrr"]
    by_scene = found.records.groupby("scene")
    assert frame["recall@1"]["east"] == by_scene["recall@1"].mean()["east"]
    assert frame["error_m"]["west"] == by_scene["error_m"].median()["west"]
    assert frame.loc["overall"].to_dict() == found.overall
    assert found.overall["mrr"] == pytest.approx(by_scene["mrr"].mean().mean(), rel=1e-12)
    assert ab.load_result(folders[0] / "result.json", name="Mine").name == "Mine"


def test_a_result_shows_itself_as_its_table(folders: list[Path]) -> None:
    found = ab.load_result(folders[0])
    for line in ("method00 on made v1", "East", "Average", "R@1 [%]"):
        assert line in repr(found)
    html = found._repr_html_()
    assert "<table" in html
    assert f"{100 * found.overall['recall@1']:.2f}" in html
    # What scores without a method stands below, as `eval` prints it.
    chance = Reference(
        meaning="any order", scenes=found.result.scenes, overall=found.overall, pooled={}
    )
    floored = replace(found, result=found.result.model_copy(update={"references": {"C": chance}}))
    assert "C: any order" in repr(floored)
    assert "any order" not in repr(found)


def test_a_result_is_saved_drawn_and_reported(folders: list[Path], tmp_path: Path) -> None:
    one, other = (ab.load_result(folder) for folder in folders[:2])
    pd.testing.assert_frame_equal(ab.load_result(one.save(tmp_path / "x")).records, one.records)
    assert one.table("markdown").startswith("|") or "| " in one.table("markdown")
    one.plot("intervals", other, score="mrr").savefig(tmp_path / "a.png")
    assert one.plot("errors", other).axes
    refused(one.plot, "pie", where="kind")
    page = one.report(tmp_path / "report.html", tmp_path).read_text()
    assert one.name in page


OF_ONE: list[tuple[list[Any], dict[str, Any]]] = [
    ([], {}),
    (["--all"], {"every": True}),
    (["--score", "MRR", "--scene", "West"], {"scores": ["MRR"], "scene": "West"}),
]
OF_MANY: list[tuple[list[Any], dict[str, Any]]] = [
    (["--reference", "best"], {"reference": "best"}),
    (["--method", "method02", "--scene", "West"], {"method": "method02", "scene": "West"}),
]
ASKED = [(1, *asked) for asked in OF_ONE] + [(3, *asked) for asked in OF_ONE + OF_MANY]


@pytest.mark.parametrize(("count", "arguments", "options"), ASKED)
def test_compare_is_the_table_of_the_command(
    folders: list[Path],
    command: Callable[..., Run],
    count: int,
    arguments: list[Any],
    options: dict[str, Any],
) -> None:
    said = command("compare", *folders[:count], *arguments, "--format", "html")
    assert said.exit_code == 0
    of_paths = ab.compare([str(folder) for folder in folders[:count]], **options)
    assert of_paths._repr_html_() == said.output
    of_results = ab.compare([ab.load_result(folder) for folder in folders[:count]], **options)
    assert repr(of_results) == repr(of_paths)
    pd.testing.assert_frame_equal(of_results.frame, of_paths.frame)


def test_the_frame_of_a_comparison_has_the_numbers_of_its_table(
    folders: list[Path], command: Callable[..., Run]
) -> None:
    frame = ab.compare(folders).frame
    text = command("compare", *folders, "--format", "csv").output
    table = pd.read_csv(io.StringIO(text), comment="#", nrows=len(frame))
    assert len(frame) == 4  # two headline scores of two methods
    first, row = table.iloc[0], frame[frame["method"] == table.iloc[0]["Method"]].iloc[0]
    assert (row["score"], row["reference"], row["verdict"]) == (
        "recall@1",
        "method00",
        first["Verdict"],
    )
    assert 100 * row["value"] == pytest.approx(first["Value"], abs=0.005)
    assert row["difference"] == pytest.approx(row["value"] - row["reference_value"])
    assert row["low"] < row["difference"] < row["high"]
    assert row[["wins", "ties", "losses"]].sum() == 100


def test_intervals_are_those_of_the_comparison(folders: list[Path]) -> None:
    result = ab.load_result(folders[1])
    frame = ab.compare(result, every=True).frame
    for score in choose_scores([result], [], every=True):
        statistic: Any = "median" if score.average == "median" else "share"
        records = result.records
        found = ab.bootstrap_ci(records[score.key], records["scene"], statistic=statistic)
        rows = frame[frame["score"] == score.key].set_index("scene")
        assert found.estimate == result.overall[score.key]
        parts = {None: found, **found.scenes}
        assert list(parts) == [None, "east", "west"]
        for scene, part in parts.items():
            row = rows[rows.index.isna()].iloc[0] if scene is None else rows.loc[scene]
            assert (part.low, part.high, part.method) == (row["low"], row["high"], row["interval"])
            low, high = part
            assert low is not None
            assert high is not None
            assert low <= part.estimate <= high


def test_scipy_has_the_same_interval_of_a_share() -> None:
    for hits, count in ((0, 12), (7, 12), (12, 12), (150, 264)):
        values = np.arange(count) < hits
        found = ab.bootstrap_ci(values, statistic="share", confidence=0.9)
        theirs = stats.binomtest(hits, count).proportion_ci(0.9, method="wilson")
        assert found.low == pytest.approx(theirs.low, abs=1e-12)
        assert found.high == pytest.approx(theirs.high, abs=1e-12)
        assert (found.estimate, found.method) == (hits / count, "wilson")


def test_scipy_has_nearly_the_same_interval_of_a_mean() -> None:
    values = np.random.default_rng(0).exponential(3.0, 80)
    found = ab.bootstrap_ci(values, statistic="mean")
    theirs = stats.bootstrap((values,), np.mean, rng=np.random.default_rng(1))
    low, high = theirs.confidence_interval
    assert found.low == pytest.approx(low, abs=0.03)
    assert found.high == pytest.approx(high, abs=0.03)


def test_intervals_depend_on_the_values_alone() -> None:
    values, scenes = [1.0, 2, 3, 4, 9, 7], ["a"] * 6
    one = ab.bootstrap_ci(values, scenes, statistic="median")
    assert list(ab.bootstrap_ci(pd.Series(values), pd.Series(scenes), statistic="median")) == [
        one.low,
        one.high,
    ]
    other = ab.bootstrap_ci(values, scenes, statistic="median", seed=9)
    assert other.estimate == one.estimate == 3.5
    wider = ab.bootstrap_ci(values, scenes, statistic="mean", confidence=0.99)
    narrow = ab.bootstrap_ci(values, scenes, statistic="mean", confidence=0.5)
    assert wider.low is not None
    assert narrow.low is not None
    assert wider.low < narrow.low


@pytest.mark.parametrize(
    ("values", "statistic", "reason"),
    [
        ([1.0], "share", "only 1 query"),
        ([1.0, 0, 1, 0], "share", "only 4 queries"),
        ([3.0] * 9, "median", "alike"),
        ([np.inf] * 9, "mean", "alike"),
    ],
)
def test_where_there_is_no_interval_it_says_why(
    values: list[float], statistic: Any, reason: str
) -> None:
    found = ab.bootstrap_ci(values, statistic=statistic)
    assert (found.low, found.high) == (None, None)
    assert reason in found.reason
    assert reason in repr(found)


def test_mistakes_in_values_are_refused() -> None:
    ci = ab.bootstrap_ci
    good = [0.5] * 8
    for values in ([], [np.nan], [-np.inf, 1], [[1.0]], ["a"], 3.0):
        refused(ci, values, statistic="mean", where="values")
    assert "divide percent by 100" in refused(ci, [50.0, 100], statistic="share", where="values")
    refused(ci, [-0.1], statistic="share", where="values")
    refused(ci, good, ["a"] * 7, statistic="share", where="scenes")
    refused(ci, good, [None] * 8, statistic="share", where="scenes")
    refused(ci, good, statistic="mode", where="statistic")
    for confidence in (0, 1.0, 95):
        refused(ci, good, statistic="mean", confidence=confidence, where="confidence")
    refused(ci, good, statistic="mean", seed=-1, where="seed")


def test_mistakes_in_comparisons_are_refused(folders: list[Path]) -> None:
    refused(ab.compare, [], where="results")
    refused(ab.compare, [3], where="results")
    refused(ab.compare, folders, scores="mrr", where="scores")
    refused(ab.compare, folders, scores=["mrr"], every=True, where="every")
    refused(ab.compare, folders[0], reference="best", where="reference")
    one = ab.load_result(folders[0])
    assert "name=" in refused(ab.compare, [one, one], where="results")
    for options in ({"scores": ["mr"]}, {"scene": "North"}, {"reference": "method09"}):
        with pytest.raises(ab.UserError, match="expected"):
            ab.compare(folders, **options)
    with pytest.raises(ab.UserError, match="no such"):
        ab.load_result(folders[0] / "nothing.json")
