"""A board of runs: rows, ranks, history, pairs, rows with a reason, and the same bytes again."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.leaderboard.answers import Answer, Head, Row, Scene, Score
from airzoo_bench.results.comparison import compare, value_of
from airzoo_bench.results.records import read_methods
from airzoo_bench.statistics.samples import ResamplingConfig
from tests.leaderboard.made import (
    HOME,
    PROTOCOL,
    board_of,
    built,
    files_of,
    method,
    rows_of,
    unpack_pair,
    write_answer,
    write_run,
    write_runs,
)
from tests.statistics.support import ERROR, HIT, made_method

RUNS = "runs/made/retrieval"


def test_rows_their_facts_numbers_and_history(root: Path) -> None:
    rows = rows_of(root / "site")
    assert list(rows) == ["m3", "m2", "m1", "m0"]  # the best first
    row = rows["m0"]
    assert (row["kind"], row["version"]) == ("re-scored", 2)
    assert (row["team"], row["date"], row["rescored"]) == ("Team", "2026-03-01", "2026-04-01")
    assert "contact" not in json.dumps(rows)
    [scored] = read_methods([root / RUNS / "m2/1"])
    score = rows["m2"]["scores"]["recall@1"]
    assert score["value"] == value_of(scored, scored.result.columns[0])
    assert 0 < score["low"] < score["value"] < score["high"] < 1
    east = rows["m2"]["scenes"]["east"]["recall@1"]
    assert east[0] == scored.result.scenes["east"]["recall@1"]
    history = row["history"]
    assert [one["number"] for one in history] == [2, 1]
    assert history[0]["scores"]["recall@1"] > history[1]["scores"]["recall@1"]
    assert history[0]["files"] == f"{RUNS}/m0/2"
    board = board_of(root / "site")
    assert (board["title"], board["updated"]) == ("A board", "2026-04-04")
    assert board["benchmarks"][1] == {"name": "made", "title": "Made", "tables": [PROTOCOL]}
    # Numbers of papers stand there from the first day.
    reported = rows_of(root / "site", "uav-visloc-retrieval")
    salad = next(row for row in reported.values() if row["method"] == "SALAD")
    assert (salad["kind"], salad["scores"]["recall@1"]["rank"]) == ("reported", None)
    assert 0 < salad["scores"]["recall@1"]["value"] < 1
    assert "airzoo-paper" in salad["source"]


@pytest.mark.parametrize("key", ["recall@1", "recall@5", "ap@5"])
def test_any_two_as_compare_prints_them(root: Path, key: str) -> None:
    scored = read_methods([root / RUNS / f"m{n}/{1 + (n == 0)}" for n in range(4)])
    by_id = {f"m{n}": one for n, one in enumerate(scored)}
    pairs = board_of(root / "site")["tables"][PROTOCOL]["pairs"][key]
    found = {name: unpack_pair(pairs, name, 0, 2) for name in ("low", "high", "p", "p_holm")}
    first, other = by_id[pairs["ids"][0]], by_id[pairs["ids"][2]]
    column = next(c for c in first.result.columns if c.key == key)
    options = {"reference": other.name, "resampling": ResamplingConfig()}
    [pair] = compare([other, first], [column], **options).pairs
    assert found["low"] == pytest.approx(pair.interval.low, rel=1e-5)
    assert found["high"] == pytest.approx(pair.interval.high, rel=1e-5)
    if pair.test.p_value > 0.01:
        assert found["p"] == pytest.approx(pair.test.p_value, rel=1e-5)
    assert found["p_holm"] >= found["p"] - 1e-6


def test_others_do_not_move_who_cannot_be_told_from_the_best(tmp_path: Path) -> None:
    for name, rate in (("a", 0.6), ("b", 0.57), ("c", 0.1)):
        write_run(tmp_path, name, 1, method(name.upper(), rate))

    def near() -> list[bool]:
        rows = rows_of(built(tmp_path))
        return [rows[name]["scores"]["recall@1"]["near_best"] for name in "abc"]

    assert near() == [True, True, False]
    for n in range(12):
        write_run(tmp_path, f"x{n}", 1, method(f"X {n}", 0.2 + n / 100))
    assert near() == [True, True, False]


def test_an_earlier_truth_is_a_grey_row_and_not_ranked(tmp_path: Path) -> None:
    write_runs(tmp_path, 2)
    for name, skill in (("late", 0.9), ("later", 0.3)):
        write_run(tmp_path, name, 1, method(name.title(), skill, truth="u" * 64), day=20)
    rows = rows_of(built(tmp_path))
    assert list(rows)[:2] == ["late", "later"]
    ranks = [rows[name]["scores"]["recall@1"]["rank"] for name in ("late", "later")]
    assert ranks == [[1, 1], [2, 2]]
    assert [rows[name]["kind"] for name in ("m0", "m1")] == ["failed"] * 2


def test_medians_with_infinite_errors(tmp_path: Path) -> None:
    for n in range(3):
        write_run(tmp_path, f"n{n}", 1, method(f"Net {n}", 0.2 + n / 3, columns=(ERROR, HIT)))
    failing = {
        scene: {"error_m": [np.inf] * size, "recall@1": [0.0] * size}
        for scene, size in (("east", 30), ("west", 20))
    }
    write_run(tmp_path, "none", 1, made_method(failing, (ERROR, HIT), "None"))
    site = built(tmp_path)
    score = rows_of(site)["none"]["scores"]["error_m"]
    assert (score["value"], score["rank"], score["near_best"]) == ("Infinity", [4, 4], False)
    assert list(rows_of(site))[-1] == "none"
    assert "NaN" not in (site / "board.json").read_text(encoding="utf-8")


def test_conditions_have_counts_and_averages(tmp_path: Path) -> None:
    made, fog = method("Net", 0.6), np.arange(50) % 2 == 1
    made.records["weather"] = np.where(fog, "fog", "sun")
    write_run(tmp_path, "net", 1, made)
    site = built(tmp_path)
    [condition] = board_of(site)["tables"][PROTOCOL]["conditions"]
    assert (condition["labels"], condition["counts"]) == (["fog", "sun"], [25, 25])
    expected = made.records["recall@1"].to_numpy()[fog].mean()
    shown = rows_of(site)["net"]["conditions"]["weather"]["recall@1"][0]
    assert shown == pytest.approx(expected)


def test_what_cannot_be_shown_is_a_row_with_its_reason_and_stops_no_other(tmp_path: Path) -> None:
    write_runs(tmp_path, 5)
    runs = tmp_path / RUNS
    for name in ("m1/1/run.json", "m2/1/submission.toml", "m0/2/run.json"):
        (runs / name).write_text("{")
    shutil.rmtree(runs / "m3/1")
    (runs / "m3/fault.txt").write_text("p.npz is too late")
    for waiting in ("m4", "waits"):
        (tmp_path / HOME / waiting).mkdir(parents=True)
        (tmp_path / HOME / waiting / "submission.toml").touch()
    (runs / "a b/1").mkdir(parents=True)
    notes: list[str] = []
    site = built(tmp_path, notes=notes)
    rows = rows_of(site)
    failed = {one for one, row in rows.items() if row["kind"] == "failed"}
    assert (failed, rows.keys() - failed) == ({"m1", "m2", "m3", "waits"}, {"m0", "m4"})
    page = (site / f"tables/{PROTOCOL}/index.html").read_text(encoding="utf-8")
    for name, said in (("m1", "run.json"), ("m2", "submission.toml"), ("m3", "p.npz is too late")):
        assert said in rows[name]["reason"]
        assert said in page
        assert any(rows[name]["reason"] in note for note in notes)
    assert rows["m0"]["version"] == 1  # its earlier version is shown
    assert "run.json" in rows["m0"]["notes"][0]


@pytest.mark.parametrize(
    ("answers", "expected"),
    [
        ([(0.9, 0.02), (0.86, 0.02), (0.4, 0.03)], [[1, 2], [1, 2], [3, 3]]),
        ([(0.9, 0.02), (0.8, None), (0.4, 0.03)], [[1, 2], [1, 3], [2, 3]]),
    ],
)
def test_sealed_answers_have_conservative_ranges_and_no_pairs(
    tmp_path: Path, answers: list[tuple[float, float | None]], expected: list[list[int]]
) -> None:
    facts: Any = {"benchmark": "made", "track": "retrieval", "protocol": PROTOCOL, "sealed": True}
    scenes = (Scene(id="a", title="A", queries=50),)
    head = Head(protocol_version=1, protocol_fingerprint="p", truth="t", scenes=scenes, **facts)
    for folder, (value, error) in zip("abc", answers, strict=True):
        scores = {"recall@1": Score(value=value, standard_error=error)}
        row = Row(kind="sealed", method=folder, scores=scores)
        answer = Answer(
            tree="", scored="2026-04-01", version="1", head=head, columns=(HIT,), row=row
        )
        write_answer(tmp_path, folder, 1, answer, method=folder.upper())
    table = board_of(built(tmp_path))["tables"][PROTOCOL]
    assert table["sealed"]
    assert [row["kind"] for row in table["rows"]] == ["sealed"] * 3
    assert [row["scores"]["recall@1"]["rank"] for row in table["rows"]] == expected
    assert table["rows"][0]["scores"]["recall@1"]["standard_error"] == 0.02
    assert table["pairs"] == {}


def test_the_same_bytes_from_nothing_from_a_cache_and_in_any_order(
    root: Path, tmp_path: Path
) -> None:
    expected = files_of(root / "site")
    shutil.copytree(root / "runs", tmp_path / "runs")
    write_run(tmp_path, "m1", 2, method("Method 1", 0.9))
    changed = files_of(built(tmp_path))  # fills the cache, with a method that is not there later
    assert files_of(built(tmp_path)) == changed
    shutil.rmtree(tmp_path / RUNS / "m1/2")
    assert files_of(built(tmp_path)) == expected
    assert files_of(built(tmp_path, out="other")) == expected
