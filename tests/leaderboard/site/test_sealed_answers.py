"""Answers of a sealed board among its rows."""

from __future__ import annotations

import json
from pathlib import Path

from tests.leaderboard.site.support import (
    built,
    method,
    write_version,
)


def sealed(runs: Path, folder: str, value: float | None, error: float | None) -> None:
    place = write_version(runs, folder, 1, method(folder, 0.5))
    (place / "result.json").unlink()
    (place / "records.csv").unlink()
    one = {"value": value, "standard_error": error}
    column = {
        "key": "recall@1", "title": "R@1", "unit": "share", "higher_is_better": True,
        "average": "mean", "headline": True,
    }  # fmt: skip
    answer = {
        "schema": 1, "sealed": True, "track": "retrieval", "protocol": "made",
        "protocol_version": 1, "protocol_fingerprint": "p" * 64, "benchmark": "made",
        "truth_commitment": "t" * 64, "method": folder, "predictions_sha256": "0" * 64,
        "columns": [column], "queries": {"a": 50}, "scene_titles": {"a": "A"},
        "scenes": {"a": {"recall@1": one}}, "overall": {"recall@1": one},
        "versions": {"airzoo-bench": "1"},
    }  # fmt: skip
    (place / "answer.json").write_text(json.dumps(answer), encoding="utf-8")


def test_sealed_answers_have_conservative_ranges_and_no_pairs(tmp_path: Path) -> None:
    for folder, value, error in (("a", 0.9, 0.02), ("b", 0.86, 0.02), ("c", 0.4, 0.03)):
        sealed(tmp_path / "runs", folder, value, error)
    site = built(tmp_path)
    table = json.loads((site / "api/v1/tables/made/table.json").read_text(encoding="utf-8"))
    assert table["sealed"]
    assert "sealed" in table["about_ranks"]
    assert "no standard error" not in table["about_ranks"]
    assert [row["kind"] for row in table["rows"]] == ["sealed"] * 3
    ranks = [row["scores"]["recall@1"]["rank"] for row in table["rows"]]
    assert ranks == [[1, 2], [1, 2], [3, 3]]
    assert table["rows"][0]["scores"]["recall@1"]["standard_error"] == 0.02
    assert table["scores"][0]["pairs"] is None
    assert not (site / "api/v1/tables/made/pairs").exists()


def test_a_median_without_standard_error_is_said_to_be_told_from_none(tmp_path: Path) -> None:
    for folder, value, error in (("a", 0.9, 0.02), ("b", 0.8, None), ("c", 0.4, 0.03)):
        sealed(tmp_path / "runs", folder, value, error)
    table = json.loads((built(tmp_path) / "api/v1/tables/made/table.json").read_text())
    ranks = [row["scores"]["recall@1"]["rank"] for row in table["rows"]]
    assert ranks == [[1, 2], [1, 3], [2, 3]]
    assert "no standard error" in table["about_ranks"]
