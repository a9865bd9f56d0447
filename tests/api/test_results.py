"""Results from Python: scored, checked, read back, shown, compared; intervals of their columns."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import airzoo_bench as ab
from airzoo_bench.results.comparison import score_intervals
from airzoo_bench.statistics.samples import ResamplingConfig
from tests.statistics.support import ERROR, HIT, SOFT, random_methods, write_method
from tests.support import run_main, write_predictions

PROTOCOL = "made-retrieval"


def test_predictions_score_as_on_the_command_line(data, perfect, tmp_path) -> None:
    path, out = write_predictions(tmp_path / "mine.npz", PROTOCOL, **perfect), tmp_path / "out"
    assert run_main("eval", "retrieval", path, "--out", out, "--method", "mine") == 0
    one, other = ab.load_result(out), ab.evaluate(path)
    assert one.name == other.name == "mine"
    assert one.overall["recall@1"] == 1.0
    assert repr(one) == repr(other)
    column = {**perfect, "query_ids": pd.Series(perfect["query_ids"])}
    for result in (
        other,
        ab.evaluate(perfect, protocol=PROTOCOL, data=data, method="mine"),
        ab.evaluate({**column, "protocol": PROTOCOL}),
    ):
        assert result.result.scenes == one.result.scenes
        pd.testing.assert_frame_equal(result.records, other.records)
    with pytest.raises(ab.UserError, match="mada-retrieval"):
        ab.evaluate(perfect, protocol="mada-retrieval")


def test_a_check(data: Path, perfect: dict[str, list[object]]) -> None:
    found = ab.check(perfect, protocol=PROTOCOL)
    assert (found.errors, repr(found)) == ([], "nothing wrong was found")
    noted = ab.check({name: some[:-1] for name, some in perfect.items()}, protocol=PROTOCOL)
    assert noted.errors == []
    assert "west/q00003" in noted.notes[0]
    twice = {**perfect, "query_ids": [perfect["query_ids"][0], *perfect["query_ids"][:-1]]}
    refused = ab.check(twice, protocol=PROTOCOL)
    assert "more than once" in str(refused.errors[0])
    with pytest.raises(ab.UserError, match="more than once"):
        ab.evaluate(twice, protocol=PROTOCOL)


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    root = tmp_path_factory.mktemp("results")
    methods = random_methods(3, {"east": 60, "west": 40}, (HIT, ERROR, SOFT))
    return [write_method(root / method.name, method).parent for method in methods]


def test_a_result_has_records_and_a_frame_and_is_shown_saved_drawn_and_reported(
    folders: list[Path], tmp_path: Path
) -> None:
    one, other = (ab.load_result(folder) for folder in folders[:2])
    frame, by_scene = one.to_frame(), one.records.groupby("scene")
    assert frame.index.tolist() == ["east", "west", "overall", "pooled"]
    assert frame.columns.tolist() == ["recall@1", "error_m", "mrr"]
    assert frame["recall@1"]["east"] == by_scene["recall@1"].mean()["east"]
    assert frame["error_m"]["west"] == by_scene["error_m"].median()["west"]
    assert frame.loc["overall"].to_dict() == one.overall
    assert one.overall["mrr"] == pytest.approx(by_scene["mrr"].mean().mean(), rel=1e-12)
    assert ab.load_result(folders[0] / "result.json", name="Mine").name == "Mine"
    for line in ("method00 on made v1", "East", "Average", "R@1 [%]"):
        assert line in repr(one)
    html = one._repr_html_()
    assert "<table" in html
    assert f"{100 * one.overall['recall@1']:.2f}" in html
    assert "| " in one.table("markdown")
    pd.testing.assert_frame_equal(ab.load_result(one.save(tmp_path / "x")).records, one.records)
    one.plot("condition", other, score="mrr", by="scene").savefig(tmp_path / "a.png")
    assert one.name in one.report(tmp_path / "report.html", tmp_path).read_text()


@pytest.mark.parametrize("options", [{"scores": ["MRR"], "scene": "West"}, {"reference": "best"}])
def test_a_comparison_has_its_numbers_in_a_frame(folders, options) -> None:
    of_paths = ab.compare([str(folder) for folder in folders], **options)
    of_results = ab.compare([ab.load_result(folder) for folder in folders], **options)
    assert repr(of_results) == repr(of_paths)
    pd.testing.assert_frame_equal(of_results.frame, of_paths.frame)
    for row in of_paths.frame.to_dict("records"):
        assert f">{row['verdict']}<" in of_paths._repr_html_()
        assert row["difference"] == pytest.approx(row["value"] - row["reference_value"])
        assert row["low"] < row["difference"] < row["high"]
        assert row["wins"] + row["ties"] + row["losses"] == (40 if "scene" in options else 100)


def test_intervals_are_those_of_tables(folders: list[Path]) -> None:
    result = ab.load_result(folders[1])
    for score in result.result.columns:
        statistic: Any = "median" if score.average == "median" else "share"
        values = result.records[score.key]
        found = ab.bootstrap_ci(values, result.records["scene"], statistic=statistic)
        theirs = score_intervals(result, [score], ResamplingConfig())
        parts = {"": found, **found.scenes}
        assert found.estimate == result.overall[score.key]
        for scene, [one] in {"": theirs.overall, **theirs.groups}.items():
            part = parts[scene]
            assert (part.low, part.high, part.method) == (one.low, one.high, one.method)
            assert part.low <= part.estimate <= part.high
    narrow = ab.bootstrap_ci(values, result.records["scene"], statistic=statistic, confidence=0.5)
    assert found.low < narrow.low < narrow.high < found.high
    frame = ab.compare(folders[1], every=True).frame.set_index(["scene", "score"])
    assert frame.loc[("west", "mrr"), "low"] == found.scenes["west"].low


def test_where_there_is_no_interval_it_says_why() -> None:
    for values, statistic, reason in (
        ([1.0, 0, 1, 0], "share", "only 4 queries"),
        ([3.0] * 9, "median", "alike"),
        ([np.inf] * 9, "mean", "alike"),
    ):
        found = ab.bootstrap_ci(values, statistic=statistic)
        assert (found.low, found.high) == (None, None)
        assert reason in found.reason
        assert reason in repr(found)
