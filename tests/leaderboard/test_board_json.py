"""A board of runs: rows, ranks, history, pairs, rows with a reason, and the same bytes again."""

from __future__ import annotations

import base64
import json
import shutil
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.leaderboard.board import Place
from airzoo_bench.leaderboard.measured import Head, Measured, Row, Scene, Score
from airzoo_bench.leaderboard.scoring import find_standing
from airzoo_bench.protocol.model import find_protocol
from airzoo_bench.results.comparison import compare, value_of
from airzoo_bench.results.records import read_scored
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.statistics.significance import LEVEL
from tests.leaderboard.made import (
    HOME,
    PROTOCOL,
    board_of,
    built,
    files_of,
    method,
    rows_of,
    write_run,
    write_runs,
)
from tests.statistics.support import ERROR, HIT, made_method

RUNS = "runs/made/retrieval"
KEYS = ("recall@1", "recall@5", "ap@5")


def matrix(pairs: Any, name: str) -> np.ndarray:
    count = len(pairs["ids"])
    found = np.full((count, count), np.nan)
    content = zlib.decompress(base64.b64decode(pairs[name]))
    found[np.triu_indices(count, 1)] = np.frombuffer(content, "<f4")
    return found


def test_rows_their_facts_numbers_and_history(root: Path) -> None:
    rows = rows_of(root / "site")
    assert list(rows) == ["m3", "m2", "m1", "m0"]  # the best first
    row = rows["m0"]
    assert (row["kind"], row["version"]) == ("re-scored", 2)
    assert (row["team"], row["date"], row["rescored"]) == ("Team", "2026-03-01", "2026-04-01")
    assert "contact" not in json.dumps(rows)
    [scored] = read_scored([root / RUNS / "m2/1"])
    score = rows["m2"]["scores"]["recall@1"]
    assert score["value"] == value_of(scored, scored.result.columns[0])
    assert 0 < score["low"] < score["value"] < score["high"] < 1
    east = rows["m2"]["scenes"]["east"]["recall@1"]
    assert east[0] == scored.result.scenes["east"]["recall@1"]
    assert list(rows["m2"]["scenes"]) == ["east", "west"]
    history = row["history"]
    assert [one["number"] for one in history] == [2, 1]
    assert history[0]["scores"]["recall@1"] > history[1]["scores"]["recall@1"]
    assert history[0]["files"] == f"{RUNS}/m0/2"
    board = board_of(root / "site")
    assert (board["title"], board["updated"]) == ("A board", "2026-04-04")
    assert board["benchmarks"][1] == {"name": "made", "title": "Made", "tables": [PROTOCOL]}


def test_any_two_as_compare_prints_them(root: Path) -> None:
    scored = read_scored([root / RUNS / f"m{n}/{1 + (n == 0)}" for n in range(4)])
    by_id = {f"m{n}": one for n, one in enumerate(scored)}
    for key in KEYS:
        pairs = board_of(root / "site")["tables"][PROTOCOL]["pairs"][key]
        found = {name: matrix(pairs, name) for name in ("low", "high", "p", "p_holm")}
        first, other = by_id[pairs["ids"][0]], by_id[pairs["ids"][2]]
        column = next(c for c in first.result.columns if c.key == key)
        options = {"reference": other.name, "resampling": ResamplingConfig()}
        [pair] = compare([other, first], [column], **options).pairs
        assert found["low"][0, 2] == pytest.approx(pair.interval.low, rel=1e-5)
        assert found["high"][0, 2] == pytest.approx(pair.interval.high, rel=1e-5)
        if pair.test.p_value > 0.01:
            assert found["p"][0, 2] == pytest.approx(pair.test.p_value, rel=1e-5)
        assert (found["p_holm"] >= found["p"] - 1e-6)[np.triu_indices(4, 1)].all()


def test_a_comment_says_of_a_method_what_the_board_says(tmp_path: Path) -> None:
    write_runs(tmp_path, 5)
    write_run(tmp_path, "near", 1, method("Near", 0.31))
    write_run(tmp_path, "far", 1, method("Far", 0.9))
    table = board_of(built(tmp_path))["tables"][PROTOCOL]
    pairs, rows = table["pairs"]["recall@1"], {row["id"]: row for row in table["rows"]}
    holm = matrix(pairs, "p_holm")
    alike = np.nan_to_num(holm, nan=0.0) + np.nan_to_num(holm, nan=0.0).T > LEVEL
    assert 0 < alike.sum() < alike.size - len(alike)
    protocol = find_protocol(PROTOCOL, tmp_path / "data")
    for own, name in enumerate(pairs["ids"]):
        place = Place("made", "retrieval", name)
        found = find_standing(place, protocol, tmp_path / "runs", tmp_path / "of comment")
        assert found["row"].model_dump(mode="json")["scores"] == rows[name]["scores"]
        others = [rows[one]["method"] for n, one in enumerate(pairs["ids"]) if alike[own, n]]
        assert (found["ranked"], found["alike"]) == (7, tuple(sorted(others)))


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


def test_published_numbers_stand_there_from_the_first_day(root: Path) -> None:
    rows = rows_of(root / "site", "uav-visloc-retrieval")
    assert {row["kind"] for row in rows.values()} == {"reported"}
    salad = next(row for row in rows.values() if row["method"] == "SALAD")
    assert salad["scores"]["recall@1"]["rank"] is None
    assert 0 < salad["scores"]["recall@1"]["value"] < 1
    assert "airzoo-paper" in salad["source"]


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
        made = method(f"Net {n}", 0.2 + n / 3, columns=(ERROR, HIT))
        write_run(tmp_path, f"n{n}", 1, made)
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


@pytest.mark.parametrize("same", [True, False])
def test_conditions_are_those_of_the_same_groups(tmp_path: Path, same: bool) -> None:
    for n in range(2):
        made = method(f"Net {n}", 0.4 + n / 5)
        fog = np.arange(50) % 2 == 1
        fog[0] |= n == 1 and not same
        made.records["weather"] = np.where(fog, "fog", "sun")
        write_run(tmp_path, f"n{n}", 1, made)
    site = built(tmp_path)
    [condition] = board_of(site)["tables"][PROTOCOL]["conditions"]
    assert (condition["labels"], condition["counts"]) == (["fog", "sun"], [25, 25])
    rows = rows_of(site)
    fog = method("Net 1", 0.6).records["recall@1"].to_numpy()[np.arange(50) % 2 == 1].mean()
    if same:
        assert rows["n1"]["conditions"]["weather"]["recall@1"][0] == pytest.approx(fog)
    else:  # the groups are those of the first
        assert sum("weather" in row["conditions"] for row in rows.values()) == 1


# --- rows with a reason ---


def spoil(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def _fault(run: Path) -> None:
    (run / "../fault.txt").write_text("too late")
    (run / "run.json").unlink()


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
    "no result": (lambda run: (run / "result.json").unlink(), "result.json: no such"),
    "no submission": (lambda run: (run / "submission.toml").unlink(), "no such submission file"),
    "no facts": (lambda run: (run / "run.json").unlink(), "no such run file"),
    "not scored": (_fault, "too late"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_what_cannot_be_shown_is_a_row_with_its_reason_and_stops_no_other(
    root: Path, tmp_path: Path, name: str
) -> None:
    shutil.copytree(root / "runs", tmp_path / "runs")
    spoiled, reason = FAULTS[name]
    spoiled(tmp_path / RUNS / "m1/1")
    notes: list[str] = []
    site = built(tmp_path, notes=notes)
    rows = rows_of(site)
    failed = {n: row["reason"] for n, row in rows.items() if row["kind"] == "failed"}
    assert list(failed) == ["m1"]
    assert reason in failed["m1"]
    page = site / f"tables/{PROTOCOL}/index.html"
    assert reason in page.read_text(encoding="utf-8")
    assert any(reason in note for note in notes)
    ranked = {n for n, row in rows.items() if row["scores"].get("recall@1", {}).get("rank")}
    assert ranked == {"m0", "m2", "m3"}


def test_what_waits_or_is_no_submission(tmp_path: Path) -> None:
    write_runs(tmp_path, 2)
    (tmp_path / RUNS / "m0/2/result.json").write_text("{")
    for name in ("void", "a b/1", ".old/1"):
        (tmp_path / RUNS / name).mkdir(parents=True)
    for name in ("m1", "waits"):
        (tmp_path / HOME / name).mkdir(parents=True)
        (tmp_path / HOME / name / "submission.toml").touch()
    rows = rows_of(built(tmp_path))
    kinds = {name: row["kind"] for name, row in rows.items()}
    assert kinds == {"m1": "re-scored", "m0": "re-scored", "waits": "failed"}
    assert rows["m0"]["version"] == 1
    assert "a later version is not shown: version 2: result.json" in rows["m0"]["notes"][0]


# --- a sealed truth ---


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
    facts = {"benchmark": "made", "track": "retrieval", "protocol": PROTOCOL, "sealed": True}
    scenes = (Scene(id="a", title="A", queries=50),)
    head = Head(protocol_version=1, protocol_fingerprint="p", truth="t", scenes=scenes, **facts)
    for folder, (value, error) in zip("abc", answers, strict=True):
        run = write_run(tmp_path, folder, 1, method(folder, 0.5))
        for name in ("result.json", "records.csv"):
            (run / name).unlink()
        scores = {"recall@1": Score(value=value, standard_error=error)}
        row = Row(kind="sealed", method=folder, scores=scores)
        answer = Measured(head=head, made_with="1", columns=(HIT,), row=row)
        (run / "answer.json").write_text(answer.model_dump_json(), encoding="utf-8")
    table = board_of(built(tmp_path))["tables"][PROTOCOL]
    assert table["sealed"]
    assert [row["kind"] for row in table["rows"]] == ["sealed"] * 3
    assert [row["scores"]["recall@1"]["rank"] for row in table["rows"]] == expected
    assert table["rows"][0]["scores"]["recall@1"]["standard_error"] == 0.02
    assert table["pairs"] == {}


# --- the same bytes ---


def test_the_same_bytes_from_nothing_from_a_cache_and_in_any_order(
    root: Path, tmp_path: Path
) -> None:
    expected = files_of(root / "site")
    shutil.copytree(root / "runs", tmp_path / "runs", copy_function=shutil.copy)
    moved = sorted((tmp_path / RUNS).iterdir(), reverse=True)
    for path in moved:  # entries come back in another order
        path.rename(path.with_name(f"{path.name}~")).rename(path)
    write_run(tmp_path, "m1", 2, method("Method 1", 0.9))
    changed = files_of(built(tmp_path))  # fills the cache, with a method that is not there later
    for damage in (lambda content: b"", lambda content: content[:-9] + bytes(9)):
        for path in (tmp_path / "site.cache").glob("*.npz"):
            path.write_bytes(damage(path.read_bytes()))
        assert files_of(built(tmp_path)) == changed
    shutil.rmtree(tmp_path / RUNS / "m1/2")
    assert files_of(built(tmp_path)) == expected
    assert files_of(built(tmp_path, out="other")) == expected
