"""Comparisons and breakdowns as tables: verdicts, hits, bins that hold nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from airzoo_bench.core.registry import load_track
from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from airzoo_bench.results.comparable import choose_scores
from airzoo_bench.results.comparison import Pair, compare, is_hit
from airzoo_bench.results.records import Method
from airzoo_bench.statistics.intervals import Interval
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.statistics.significance import PairedTest
from airzoo_bench.tables.breakdown import breakdown_table
from airzoo_bench.tables.comparison import comparison_table, differences_table, verdict
from airzoo_bench.tables.render import FORMATS, render
from tests.statistics.support import CHAMFER, ERROR, HIT, SOFT, made_method, random_methods

FAST = ResamplingConfig(resamples=1_000)
PAIR = Pair(
    score=HIT,
    method="mine",
    reference="theirs",
    value=0.5,
    reference_value=0.4,
    difference=0.1,
    interval=Interval(0.02, 0.2, "bca"),
    test=PairedTest(0.01, exact=False, patterns=1_000),
    p_holm=0.02,
    p_mcnemar=0.03,
    wins=10,
    ties=5,
    losses=2,
)


def test_hits_of_every_shipped_protocol() -> None:
    for path in shipped_protocols().values():
        protocol = load_protocol(path)
        scores = load_track(protocol.track).scores(protocol)
        hits = {score.title for score in scores if is_hit(protocol.track, score)}
        # A reconstruction's R@10m is a share of points, though it may be 1.
        starts = {"retrieval": ("R@", "D<", "MA@"), "matching": ("@",), "reconstruction": ()}
        known = starts[protocol.track]
        assert hits == {score.title for score in scores if score.title.startswith(known)}


def test_mcnemar_is_of_hits_alone() -> None:
    scenes = {"s": {"recall@1": [1.0] * 6, "mrr": [1.0, 0, 1, 0, 1, 0]}}
    methods = [made_method(scenes, (HIT, SOFT), name) for name in "ab"]
    pairs = compare(methods, choose_scores(methods, [], every=True), resampling=FAST).pairs
    assert [pair.p_mcnemar for pair in pairs] == [1.0, None]
    scenes = {scene: {"chamfer_m": [1.0]} for scene in "abc"}
    methods = [made_method(scenes, (CHAMFER,), name) for name in "ab"]
    assert [pair.p_mcnemar for pair in compare(methods, [CHAMFER], resampling=FAST).pairs] == [None]


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({}, "better"),
        ({"difference": -0.1}, "worse"),
        ({"score": ERROR}, "worse"),
        ({"score": ERROR, "difference": -0.1}, "better"),
        ({"p_holm": 0.05}, "better"),
        ({"p_holm": 0.0501}, "unclear"),
        ({"difference": 0.0}, "unclear"),
        ({"difference": None}, "unclear"),
        ({"difference": 0.0, "wins": 1, "losses": 1}, "too few"),
        ({"difference": None, "wins": 1, "losses": 1}, "too few"),
        ({"difference": 0.0, "wins": 0, "losses": 0}, "equal"),
        ({"difference": 1e-10, "wins": 0, "losses": 0}, "equal"),
        ({"wins": 5, "losses": 0}, "too few"),
        ({"wins": 3, "losses": 3}, "better"),
        ({"difference": np.inf}, "better"),
    ],
)
def test_verdicts(changes: dict[str, object], word: str) -> None:
    pair = replace(PAIR, **changes)  # type: ignore[arg-type]
    assert verdict(pair) == word


def test_a_verdict_is_the_same_everywhere() -> None:
    # The same average, and one query for each: no test can find anything.
    rows = {"a": [1.0, 0.0] * 10, "b": [0.0, 1.0] + [1.0, 0.0] * 9}
    methods = [made_method({"s": {"recall@1": row}}, (HIT,), n) for n, row in rows.items()]
    table = comparison_table(compare(methods, [HIT], resampling=FAST))
    assert (table.rows[0].cells[2].value, table.rows[0].cells[5].value) == ("too few", 0.0)
    for form in FORMATS:
        assert "too few" in render(table, form)


def test_a_small_p_is_never_nothing() -> None:
    rows = {"a": [1.0] * 40, "b": [0.0] * 40}
    methods = [made_method({"s": {"recall@1": row}}, (HIT,), n) for n, row in rows.items()]
    [row] = comparison_table(compare(methods, [HIT], resampling=FAST)).rows
    assert [cell.text(4) for cell in row.cells[8:9]] == ["<0.0001"]


def test_queries_that_differ_most_come_first() -> None:
    rows = {"a": [1.0, 5.0, 2.0, np.inf], "b": [1.0, 2.0, 4.0, 1.0]}
    methods = [made_method({"s": {ERROR.key: row}}, (ERROR,), n) for n, row in rows.items()]
    ids = methods[0].records["query"].tolist()
    table = differences_table(methods, [ERROR], 2)
    assert [row.cells[0].value for row in table.rows] == [ids[3], ids[1]]
    assert [row.cells[3].value for row in table.rows] == [-np.inf, -3.0]


def methods_at(altitudes: list[float], count: int = 2) -> list[Method]:
    methods = random_methods(count, {"east": 20}, (HIT, ERROR))
    for method in methods:
        method.records["altitude_m"] = np.resize(altitudes, 20)
    return methods


@pytest.mark.parametrize("plan", [None, FAST])
def test_empty_bins_are_rows_without_values(plan: ResamplingConfig | None) -> None:
    methods, bins = methods_at([61.5, 88.0]), [30, 60, 70, 80]
    table = breakdown_table(methods, [HIT, ERROR], "altitude_m", bins=bins, resampling=plan)
    rows = [[cell.value for cell in row.cells] for row in table.rows]
    labels = ["below 30", "30 to 60", "60 to 70", "70 to 80", "80 and more"]
    assert [row[0] for row in rows] == labels
    assert [row[1] for row in rows] == [0, 0, 10, 0, 10]
    for row in rows:
        assert [value is None for value in row[2:]] == [row[1] == 0] * 4
    assert not any("fewer" in note for note in table.notes)


def test_unknown_is_a_row_only_where_there_is_some() -> None:
    table = breakdown_table(methods_at([20.0, np.nan]), [HIT], "altitude_m", bins=[30])
    assert [row.cells[0].value for row in table.rows] == ["below 30", "30 and more", "unknown"]
    nowhere = breakdown_table(methods_at([np.nan]), [HIT], "altitude_m", bins=[30])
    assert [row.cells[1].value for row in nowhere.rows] == [0, 0, 20]
