"""A board of runs: rows, ranks, history, pairs, and what is no row."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.results.comparison import compare, value_of
from airzoo_bench.results.records import read_scored
from airzoo_bench.statistics.samples import ResamplingConfig
from tests.leaderboard.site.support import (
    board_of,
    built,
    method,
    rows_of,
    some_runs,
    table_of,
    write_version,
)
from tests.statistics.support import ERROR, HIT, made_method


def matrix(pairs: Any, name: str) -> np.ndarray:
    count = len(pairs["ids"])
    found = np.full((count, count), np.nan)
    content = zlib.decompress(base64.b64decode(pairs[name]))
    found[np.triu_indices(count, 1)] = np.frombuffer(content, "<f4")
    return found


def test_rows_their_facts_and_their_numbers(root: Path) -> None:
    rows = rows_of(root / "site")
    assert list(rows) == ["m3", "m2", "m1", "m0"]  # the best first
    row = rows["m0"]
    assert (row["kind"], row["version"]) == ("re-scored", 2)
    assert (row["team"], row["date"], row["rescored"]) == ("Team", "2026-03-01", "2026-04-01")
    assert "contact" not in json.dumps(rows)
    [scored] = read_scored([root / "runs/made/retrieval/m2/1"])
    score = rows["m2"]["scores"]["recall@1"]
    assert score["value"] == value_of(scored, scored.result.columns[0])
    assert 0 < score["low"] < score["value"] < score["high"] < 1
    east = rows["m2"]["scenes"]["east"]["recall@1"]
    assert east[0] == scored.result.scenes["east"]["recall@1"]
    assert list(rows["m2"]["scenes"]) == ["east", "west"]
    board = board_of(root / "site")
    assert (board["title"], board["updated"]) == ("A board", "2026-04-04")
    assert board["benchmarks"][0] == {"name": "made", "title": "Made", "tables": ["made"]}


def test_any_two_as_compare_prints_them(root: Path) -> None:
    scored = read_scored([root / f"runs/made/retrieval/m{n}/{2 - (n > 0)}" for n in range(4)])
    by_id = {f"m{n}": one for n, one in enumerate(scored)}
    for key in ("recall@1", "recall@5", "ap@5"):
        pairs = table_of(root / "site")["pairs"][key]
        found = {name: matrix(pairs, name) for name in ("low", "high", "p", "p_holm")}
        first, other = by_id[pairs["ids"][0]], by_id[pairs["ids"][2]]
        column = next(c for c in first.result.columns if c.key == key)
        made = compare(
            [other, first], [column], reference=other.name, resampling=ResamplingConfig()
        )
        [pair] = made.pairs
        assert found["low"][0, 2] == pytest.approx(pair.interval.low, rel=1e-5)
        assert found["high"][0, 2] == pytest.approx(pair.interval.high, rel=1e-5)
        if pair.test.p_value > 0.01:
            assert found["p"][0, 2] == pytest.approx(pair.test.p_value, rel=1e-5)
        assert (found["p_holm"] >= found["p"] - 1e-6)[np.triu_indices(4, 1)].all()


def test_others_do_not_move_who_cannot_be_told_from_the_best(tmp_path: Path) -> None:
    for name, rate in (("a", 0.6), ("b", 0.57), ("c", 0.1)):
        write_version(tmp_path / "runs", name, 1, method(name.upper(), rate))

    def near() -> dict[str, bool]:
        rows = rows_of(built(tmp_path))
        return {name: rows[name]["scores"]["recall@1"]["near_best"] for name in "abc"}

    before = near()
    assert before == {"a": True, "b": True, "c": False}
    for n in range(12):
        write_version(tmp_path / "runs", f"x{n}", 1, method(f"X {n}", 0.2 + n / 100))
    assert near() == before


def test_history_is_the_newest_first(root: Path) -> None:
    found = rows_of(root / "site")["m0"]["history"]
    assert [one["number"] for one in found] == [2, 1]
    assert found[0]["scores"]["recall@1"] > found[1]["scores"]["recall@1"]
    assert found[0]["files"] == "runs/made/retrieval/m0/2"


def test_what_is_published_stands_there_from_the_first_day(root: Path) -> None:
    rows = rows_of(root / "site", "uav-visloc-retrieval")
    assert {row["kind"] for row in rows.values()} == {"reported"}
    salad = next(row for row in rows.values() if row["method"] == "SALAD")
    assert salad["scores"]["recall@1"]["rank"] is None
    assert 0 < salad["scores"]["recall@1"]["value"] < 1
    assert "airzoo-paper" in salad["source"]


def test_two_teams_with_one_method_are_told_apart(tmp_path: Path) -> None:
    """Whoever runs SALAD calls it SALAD; were that a fault, anybody could stop the board."""
    for folder, rate in (("a", 0.4), ("b", 0.5), ("c", 0.6)):
        name = "Other" if folder == "c" else "SALAD"
        scored = method(name, rate, seed=ord(folder))
        write_version(tmp_path / "runs", folder, 1, scored, team=f"Team {folder}")
    page = (built(tmp_path) / "tables/made/compare.html").read_text(encoding="utf-8")
    assert "SALAD (Team a)" in page
    assert "Other (" not in page


def test_an_earlier_truth_is_a_grey_row_and_not_ranked(tmp_path: Path) -> None:
    some_runs(tmp_path / "runs", 2)
    for name, skill in (("late", 0.9), ("later", 0.3)):
        other = method(name.title(), skill, truth="u" * 64)
        write_version(tmp_path / "runs", name, 1, other, day=20)
    rows = rows_of(built(tmp_path))
    assert list(rows)[:2] == ["late", "later"]
    ranks = [rows[name]["scores"]["recall@1"]["rank"] for name in ("late", "later")]
    assert ranks == [[1, 1], [2, 2]]
    assert [rows[name]["kind"] for name in ("m0", "m1")] == ["failed"] * 2


def test_medians_with_infinite_errors(tmp_path: Path) -> None:
    for n in range(3):
        made = method(f"Net {n}", 0.2 + n / 3, columns=(ERROR, HIT))
        write_version(tmp_path / "runs", f"n{n}", 1, made)
    failing = {
        scene: {"error_m": [np.inf] * size, "recall@1": [0.0] * size}
        for scene, size in (("east", 30), ("west", 20))
    }
    write_version(tmp_path / "runs", "none", 1, made_method(failing, (ERROR, HIT), "None"))
    site = built(tmp_path)
    score = rows_of(site)["none"]["scores"]["error_m"]
    assert (score["value"], score["rank"], score["near_best"]) == ("Infinity", [4, 4], False)
    assert list(rows_of(site))[-1] == "none"
    assert "NaN" not in (site / "board.json").read_text(encoding="utf-8")


@pytest.mark.parametrize("same", [True, False])
def test_conditions_are_those_of_the_same_groups(tmp_path: Path, same: bool) -> None:
    for n in range(2):
        made = method(f"Net {n}", 0.4 + n / 5)
        made.records["weather"] = np.where((np.arange(50) + n * (not same)) % 2, "fog", "sun")
        write_version(tmp_path / "runs", f"n{n}", 1, made)
    site = built(tmp_path)
    [condition] = table_of(site)["conditions"]
    assert (condition["labels"], condition["counts"]) == (["fog", "sun"], [25, 25])
    rows = rows_of(site)
    fog = method("Net 1", 0.6).records["recall@1"].to_numpy()[np.arange(50) % 2 == 1].mean()
    if same:
        assert rows["n1"]["conditions"]["weather"]["recall@1"][0] == pytest.approx(fog)
    else:  # the groups are those of the first
        assert sum("weather" in row["conditions"] for row in rows.values()) == 1


# --- what cannot be shown ---


def spoil(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


RUN = "runs/made/retrieval/m1/1"
FAULTS: dict[str, tuple[Callable[[Path], object], str]] = {
    "damaged": (lambda run: (run / "result.json").write_text("{"), "result.json: not a result"),
    "edited": (
        lambda run: spoil(run / "result.json", '"method": "Method 1"', '"method": "Method X"'),
        "the checksum does not fit",
    ),
    "records gone": (lambda run: (run / "records.csv").unlink(), "records.csv: no such file"),
    "records edited": (
        lambda run: spoil(run / "records.csv", ",0,0,0.2", ",0,1,0.2"),
        "not the records of the result",
    ),
    "no result": (lambda run: (run / "result.json").unlink(), "holds 0 of result.json and answer"),
    "no submission": (
        lambda run: (run / "submission.toml").unlink(),
        "no such submission file",
    ),
    "no run": (lambda run: (run / "run.json").unlink(), "no such run file"),
    "not scored": (
        lambda run: ((run / "../fault.txt").write_text("too late"), (run / "run.json").unlink()),
        "too late",
    ),
    "other queries": (
        lambda run: write_version(
            run.parents[3], "m1", 1, method("Method 1", 0.5, {"east": 30, "west": 21})
        ),
        "scored on other queries than most methods",
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_what_cannot_be_shown_is_a_row_with_its_reason_and_stops_no_other(
    tmp_path: Path, name: str
) -> None:
    some_runs(tmp_path / "runs", 4)
    spoiled, reason = FAULTS[name]
    spoiled(tmp_path / RUN)
    notes: list[str] = []
    site = built(tmp_path, notes=notes)
    rows = rows_of(site)
    failed = {n: row["reason"] for n, row in rows.items() if row["kind"] == "failed"}
    assert list(failed) == ["m1"]
    assert reason in failed["m1"]
    assert reason in (site / "tables/made/index.html").read_text(encoding="utf-8")
    assert any(reason in note for note in notes)
    ranked = {n for n, row in rows.items() if row["scores"].get("recall@1", {}).get("rank")}
    assert ranked == {"m0", "m2", "m3"}


def test_a_version_that_cannot_be_shown_leaves_the_one_before(tmp_path: Path) -> None:
    some_runs(tmp_path / "runs", 2)
    (tmp_path / "runs/made/retrieval/m0/2/result.json").write_text("{")
    row = rows_of(built(tmp_path))["m0"]
    assert (row["kind"], row["version"]) == ("re-scored", 1)
    assert "a later version is not shown: version 2: result.json: not a result" in row["notes"][0]


@pytest.mark.parametrize("name", ["void", "a b/1", ".old/1"])
def test_what_is_no_submission_is_named_and_skipped(tmp_path: Path, name: str) -> None:
    some_runs(tmp_path / "runs", 2)
    (tmp_path / "runs/made/retrieval" / name).mkdir(parents=True)
    notes: list[str] = []
    assert set(rows_of(built(tmp_path, notes=notes))) == {"m0", "m1"}
    assert [name.removesuffix("/1") in note for note in notes] == [True]


def test_what_waits_is_a_grey_row(tmp_path: Path) -> None:
    write_version(tmp_path / "runs", "a", 1, method("A", 0.5))
    for name in ("a", "b"):
        folder = tmp_path / "submissions/made/retrieval" / name
        folder.mkdir(parents=True)
        (folder / "submission.toml").touch()
    rows = rows_of(built(tmp_path))
    assert [(name, row["kind"]) for name, row in rows.items()] == [
        ("a", "re-scored"),
        ("b", "failed"),
    ]


# --- a sealed truth ---


def sealed(runs: Path, folder: str, value: float | None, error: float | None) -> None:
    place = write_version(runs, folder, 1, method(folder, 0.5))
    for name in ("result.json", "records.csv"):
        (place / name).unlink()
    one = {"value": value, "standard_error": error}
    answer = {
        **{"schema": 1, "sealed": True, "track": "retrieval", "protocol": "made"},
        **{"protocol_version": 1, "protocol_fingerprint": "p" * 64, "benchmark": "made"},
        **{"truth_commitment": "t" * 64, "method": folder, "predictions_sha256": "0" * 64},
        **{"columns": [HIT.model_dump()], "queries": {"a": 50}, "scene_titles": {"a": "A"}},
        **{"scenes": {"a": {"recall@1": one}}, "overall": {"recall@1": one}},
        "versions": {"airzoo-bench": "1"},
    }
    (place / "answer.json").write_text(json.dumps(answer), encoding="utf-8")


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
    for folder, (value, error) in zip("abc", answers, strict=True):
        sealed(tmp_path / "runs", folder, value, error)
    table = table_of(built(tmp_path))
    assert table["sealed"]
    assert [row["kind"] for row in table["rows"]] == ["sealed"] * 3
    assert [row["scores"]["recall@1"]["rank"] for row in table["rows"]] == expected
    assert table["rows"][0]["scores"]["recall@1"]["standard_error"] == 0.02
    assert table["pairs"] == {}
