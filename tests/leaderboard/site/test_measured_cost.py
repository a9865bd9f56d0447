"""What a query costs: as claimed, and as measured where CI made the predictions itself."""

from __future__ import annotations

import json
from pathlib import Path

from airzoo_bench.leaderboard.runs import MadeAgain, read_run, write_run
from tests.leaderboard.site.support import built, some_runs


def test_the_measured_time_stands_beside_the_claimed_one(tmp_path: Path) -> None:
    some_runs(tmp_path / "runs", 2)
    place = tmp_path / "runs" / "made" / "retrieval" / "m1" / "1" / "run.json"
    made = MadeAgain(seconds_per_query=0.125, same_bytes=True)
    write_run(place, read_run(place).model_copy(update={"made_again": made}))
    site = built(tmp_path)
    table = site / "api" / "v1" / "tables" / "made" / "table.json"
    rows = {row["id"]: row for row in json.loads(table.read_text(encoding="utf-8"))["rows"]}
    assert rows["m1"]["measured_seconds_per_query"] == 0.125
    assert rows["m0"]["measured_seconds_per_query"] is None
    page = site / "tables" / "made" / "methods" / "m1.html"
    assert "Cost, as measured here" in page.read_text(encoding="utf-8")
    assert "0.125 s a query" in page.read_text(encoding="utf-8")


def test_the_time_of_predictions_that_score_otherwise_is_not_shown(tmp_path: Path) -> None:
    some_runs(tmp_path / "runs", 2)
    for name, alike in (("m0/2", True), ("m1/1", False)):
        place = tmp_path / "runs" / "made" / "retrieval" / name / "run.json"
        made = MadeAgain(seconds_per_query=0.125, same_bytes=False, alike=alike)
        write_run(place, read_run(place).model_copy(update={"made_again": made}))
    table = built(tmp_path) / "api" / "v1" / "tables" / "made" / "table.json"
    rows = {row["id"]: row for row in json.loads(table.read_text(encoding="utf-8"))["rows"]}
    assert rows["m0"]["measured_seconds_per_query"] == 0.125
    assert rows["m1"]["measured_seconds_per_query"] is None
