"""A board of runs: rows, ranks, history, pairs."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.leaderboard.board import Board
from airzoo_bench.leaderboard.site.api_files import MARK
from airzoo_bench.leaderboard.site.build import build_board
from airzoo_bench.results.comparison import compare, value_of
from airzoo_bench.results.records import read_scored
from airzoo_bench.statistics.samples import ResamplingConfig
from tests.leaderboard.site.support import (
    API,
    built,
    files_of,
    given,
    method,
    read,
    rows_of,
    some_runs,
    write_version,
)
from tests.statistics.support import ERROR, HIT, write_method


def matrix(pairs: Any, name: str) -> np.ndarray:
    count = len(pairs["ids"])
    found = np.full((count, count), np.nan)
    found[np.triu_indices(count, 1)] = np.frombuffer(base64.b64decode(pairs[name]), "<f4")
    return found


def test_rows_and_their_facts(root: Path) -> None:
    rows = rows_of(root / "site")
    assert list(rows) == ["m3", "m2", "m1", "m0"]  # the best first
    row = rows["m0"]
    assert row["kind"] == "re-scored"
    assert (row["team"], row["date"], row["rescored"]) == ("Team", "2026-03-01", "2026-04-01")
    assert row["version"] == 2
    assert "contact" not in json.dumps(rows)


def test_values_and_intervals_are_those_of_the_result(root: Path) -> None:
    row = rows_of(root / "site")["m2"]
    [scored] = read_scored([root / "runs/made/retrieval/m2/1"])
    score = row["scores"]["recall@1"]
    assert score["value"] == value_of(scored, scored.result.columns[0])
    assert score["text"] == f"{100 * score['value']:.2f}"
    assert 0 < score["low"] < score["value"] < score["high"] < 1


def test_ranges_hold_all_methods_and_tell_far_ones_apart(root: Path) -> None:
    rows = rows_of(root / "site")
    ranks = {name: row["scores"]["recall@1"]["rank"] for name, row in rows.items()}
    assert ranks["m3"][0] == 1
    assert ranks["m0"][1] == 4
    assert ranks["m3"][1] < 4
    assert ranks["m0"][0] > 1


def test_any_two_as_compare_prints_them(root: Path) -> None:
    scored = read_scored([root / f"runs/made/retrieval/m{n}/{2 - (n > 0)}" for n in range(4)])
    by_id = {f"m{n}": one for n, one in enumerate(scored)}
    for number, key in enumerate(("recall@1", "recall@5", "ap@5")):
        pairs = read(root / "site", f"tables/made/pairs/{number}.json")
        assert (pairs["score"], pairs["family"]) == (key, 6)
        tables = {name: matrix(pairs, name) for name in ("low", "high", "p", "p_holm")}
        first, other = by_id[pairs["ids"][0]], by_id[pairs["ids"][2]]
        column = next(c for c in first.result.columns if c.key == key)
        config = ResamplingConfig()
        made = compare([other, first], [column], reference=other.name, resampling=config)
        [pair] = made.pairs
        difference = pairs["values"][0] - pairs["values"][2]
        assert difference == pytest.approx(pair.difference)
        assert tables["low"][0, 2] == pytest.approx(pair.interval.low, rel=1e-5)
        assert tables["high"][0, 2] == pytest.approx(pair.interval.high, rel=1e-5)
        if pair.test.p_value > 0.01:
            assert tables["p"][0, 2] == pytest.approx(pair.test.p_value, rel=1e-5)
        assert (tables["p_holm"] >= tables["p"] - 1e-6)[np.triu_indices(4, 1)].all()


def test_history_is_the_newest_first(root: Path) -> None:
    found = read(root / "site", "tables/made/methods/m0.json")
    assert [one["number"] for one in found["history"]] == [2, 1]
    assert found["history"][0]["changes"].startswith("R@1 +")
    assert found["history"][0]["files"] == "runs/made/retrieval/m0/2"
    assert found["history"][1]["changes"] == ""


def test_scenes_follow_the_rows(root: Path) -> None:
    scenes = read(root / "site", "tables/made/scenes.json")["scenes"]
    assert list(scenes) == ["east", "west"]
    [scored] = read_scored([root / "runs/made/retrieval/m3/1"])
    assert scenes["east"]["recall@1"]["value"][0] == scored.result.scenes["east"]["recall@1"]


def test_what_is_published_stands_there_from_the_first_day(root: Path) -> None:
    rows = rows_of(root / "site", "uav-visloc-retrieval")
    assert {row["kind"] for row in rows.values()} == {"reported"}
    salad = next(row for row in rows.values() if row["method"] == "SALAD")
    assert salad["scores"]["recall@1"]["rank"] is None
    assert "airzoo-paper" in salad["source"]
    assert any(f["check"] == "row" and f["grade"] == "inconsistent" for f in salad["findings"])


def test_downloads_have_ranges(root: Path) -> None:
    table = (root / "site/downloads/made.csv").read_text(encoding="utf-8")
    assert "Rank by R@1" in table
    assert json.loads((root / "site/downloads/made.json").read_text(encoding="utf-8"))
    assert "\\begin{" in (root / "site/downloads/made.tex").read_text(encoding="utf-8")


def test_the_board_lists_its_tables(root: Path) -> None:
    board = read(root / "site", "board.json")
    assert (board["title"], board["updated"]) == ("A board", "2026-04-04")
    [made] = board["benchmarks"][0]["tables"]
    assert (made["id"], made["methods"], made["current"]) == ("made", 4, True)


@pytest.mark.parametrize("results", [[0, 1, 2], [2, 0, 1]])
def test_plain_results_in_any_order(tmp_path: Path, results: list[int]) -> None:
    paths = [write_method(tmp_path / f"r{n}", method(f"Net {n}", 0.3 + n / 10)) for n in range(3)]
    site = built(tmp_path, results=[paths[n] for n in results])
    rows = rows_of(site)
    assert {"net-0", "net-1", "net-2"} == set(rows)
    assert rows["net-0"]["team"] == ""
    one = built(tmp_path, out="sorted", results=paths)
    assert files_of(one) == files_of(site)


def test_names_that_would_share_a_page_do_not(tmp_path: Path) -> None:
    names = ("A B", "a-b", "Ünï <b>", "=1")
    paths = [write_method(tmp_path / f"{n}", method(name, 0.5)) for n, name in enumerate(names)]
    rows = rows_of(built(tmp_path, results=paths))
    assert {row["method"] for row in rows.values()} == set(names)
    assert len(rows) == 4
    assert all(name.replace("-", "").isalnum() for name in rows)


def test_a_method_on_two_protocols_has_one_name(tmp_path: Path) -> None:
    paths = [
        write_method(tmp_path / "a", method("Net", 0.5)),
        write_method(tmp_path / "b", method("Net", 0.5, truth="u" * 64)),
    ]
    site = built(tmp_path, results=paths)
    tables = [t["id"] for t in read(site, "board.json")["benchmarks"][0]["tables"]]
    assert [list(rows_of(site, table)) for table in tables] == [["net"], ["net"]]


def test_earlier_truths_stand_apart_and_are_not_ranked_together(tmp_path: Path) -> None:
    some_runs(tmp_path / "runs", 2)
    for name, skill in (("late", 0.9), ("later", 0.3)):
        other = method(name.title(), skill, truth="u" * 64)
        write_version(tmp_path / "runs", name, 1, other, day=20)
    site = built(tmp_path)
    tables = read(site, "board.json")["benchmarks"][0]["tables"]
    assert [(one["current"], one["methods"]) for one in tables] == [(True, 2), (False, 2)]
    assert "another truth" in tables[1]["apart"]
    now = rows_of(site)
    assert [now[name]["scores"]["recall@1"]["rank"] for name in ("late", "later")] == [
        [1, 1],
        [2, 2],
    ]
    apart = rows_of(site, tables[1]["id"])
    assert [apart[name]["scores"]["recall@1"]["rank"] for name in ("m1", "m0")] == [[1, 1], [2, 2]]


def test_medians_with_infinite_errors(tmp_path: Path) -> None:
    for n in range(3):
        made = method(f"Net {n}", 0.2 + n / 3, columns=(ERROR, HIT))
        write_version(tmp_path / "runs", f"n{n}", 1, made)
    failing = {"east": {"error_m": [np.inf] * 30, "recall@1": [0.0] * 30}}
    failing["west"] = {"error_m": [np.inf] * 20, "recall@1": [0.0] * 20}
    from tests.statistics.support import made_method

    write_version(tmp_path / "runs", "none", 1, made_method(failing, (ERROR, HIT), "None"))
    site = built(tmp_path)
    rows = rows_of(site)
    assert rows["none"]["scores"]["error_m"]["value"] == "Infinity"
    assert rows["none"]["scores"]["error_m"]["rank"] == [4, 4]
    assert list(rows)[-1] == "none"
    assert "NaN" not in (site / f"{API}/tables/made/table.json").read_text(encoding="utf-8")


def test_conditions_follow_the_rows(tmp_path: Path) -> None:
    for n in range(2):
        made = method(f"Net {n}", 0.4 + n / 5)
        made.records["weather"] = np.where(np.arange(50) % 2, "fog", "sun")
        write_version(tmp_path / "runs", f"n{n}", 1, made)
    site = built(tmp_path)
    [condition] = read(site, "tables/made/table.json")["conditions"]
    assert (condition["labels"], condition["counts"]) == (["fog", "sun"], [25, 25])
    [found] = read(site, "tables/made/conditions.json")["conditions"]
    records = method("Net 1", 0.6).records
    fog = records["recall@1"].to_numpy()[np.arange(50) % 2 == 1].mean()
    assert found["groups"][0]["recall@1"]["value"][0] == pytest.approx(fog)


def test_rows_whose_records_have_other_groups_have_no_scores_by_condition(tmp_path: Path) -> None:
    for n in range(2):
        made = method(f"Net {n}", 0.4 + n / 5)
        made.records["weather"] = np.where(np.arange(50) % 2 == n, "fog", "sun")
        write_version(tmp_path / "runs", f"n{n}", 1, made)
    [found] = read(built(tmp_path), "tables/made/conditions.json")["conditions"]
    values = [group["recall@1"]["value"] for group in found["groups"]]
    assert [[one is None for one in value] for value in values] == [[True, False]] * 2


def test_tables_stand_in_the_order_of_the_board(tmp_path: Path) -> None:
    order = ["airzoo-mini-retrieval", "airzoo-mini-matching"]
    for protocols in (order, order[::-1]):
        stated = {"name": "airzoo-mini", "title": "Mini", "protocols": tuple(protocols)}
        board = Board.model_validate({"schema": 1, "title": "B", "benchmarks": (stated,)})
        site = built(tmp_path, board=board)
        index = json.loads((site / "api/v1/board.json").read_text(encoding="utf-8"))
        mini = next(one for one in index["benchmarks"] if one["name"] == "airzoo-mini")
        assert [table["protocol"] for table in mini["tables"]] == protocols


def test_a_board_without_anything_says_what_is_published(tmp_path: Path) -> None:
    site = build_board(
        given(tmp_path, board=None), tmp_path / "site", tmp_path / "cache", note=print
    )
    names = {b["name"] for b in read(site, "board.json")["benchmarks"]}
    assert {"uav-visloc", "airzoo-real"} <= names
    assert (site / MARK).is_file()
