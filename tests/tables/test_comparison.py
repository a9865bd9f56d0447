"""Comparisons as tables: verdicts, hits, small p-values, and the queries that differ most."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.registry import load_track
from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from airzoo_bench.results.comparison import Pair, choose_scores, compare, is_hit
from airzoo_bench.results.records import Method
from airzoo_bench.statistics.intervals import Interval
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.statistics.significance import PairedTest
from airzoo_bench.tables.comparison import comparison_table, differences_table, verdict
from airzoo_bench.tables.render import FORMATS, render
from tests.statistics.support import CHAMFER, ERROR, HIT, SOFT, made_method, random_methods
from tests.tables.typeset import MINUS, document, typeset

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
HIT_TITLES = {"retrieval": ("R@", "D<", "MA@"), "matching": ("@",), "reconstruction": ()}


def test_mcnemar_is_of_hits_alone() -> None:
    for path in shipped_protocols().values():
        protocol = load_protocol(path)
        scores = load_track(protocol.track).scores(protocol)
        hits = {score.title for score in scores if is_hit(protocol.track, score)}
        # A reconstruction's R@10m is a share of points, though it may be 1.
        known = HIT_TITLES[protocol.track]
        assert hits == {score.title for score in scores if score.title.startswith(known)}
    scenes = {"s": {"recall@1": [1.0] * 6, "mrr": [1.0, 0, 1, 0, 1, 0]}}
    methods = [made_method(scenes, (HIT, SOFT), name) for name in "ab"]
    pairs = compare(methods, choose_scores(methods, [], every=True), resampling=FAST).pairs
    assert [pair.p_mcnemar for pair in pairs] == [1.0, None]


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
    assert verdict(replace(PAIR, **changes)) == word  # type: ignore[arg-type]


def hits(*rows: list[float]) -> list[Method]:
    return [
        made_method({"s": {"recall@1": row}}, (HIT,), n) for n, row in zip("ab", rows, strict=True)
    ]


def test_verdicts_and_small_p_values_are_the_same_everywhere() -> None:
    # The same average, and one query for each: no test can find anything.
    few = hits([1.0, 0.0] * 10, [0.0, 1.0] + [1.0, 0.0] * 9)
    table = comparison_table(compare(few, [HIT], resampling=FAST))
    assert (table.rows[0].cells[2].value, table.rows[0].cells[5].value) == ("too few", 0.0)
    sure = comparison_table(compare(hits([1.0] * 40, [0.0] * 40), [HIT], resampling=FAST))
    assert sure.texts()[0][8] == "<0.0001"
    apart = hits([0.0] * 7 + [1.0] * 5, [1.0] * 7 + [0.0] + [1.0] * 4)  # p 0.07, interval above 0
    notes = comparison_table(compare(apart, [HIT], resampling=FAST)).notes
    assert any("disagree" in note for note in notes)
    for form in FORMATS:
        assert "too few" in render(table, form)


def test_no_p_is_shown_where_no_test_is_possible() -> None:
    scenes = {scene: {"chamfer_m": [1.0]} for scene in "abcd"}
    methods = [made_method(scenes, (CHAMFER,), name) for name in "ab"]
    table = comparison_table(compare(methods, [CHAMFER], resampling=FAST))
    assert [cell.value for cell in table.rows[0].cells[6:9]] == [1.0, 1.0, None]  # as in JSON
    assert table.texts()[0][6:9] == ["–"] * 3
    assert render(table, "latex").count(*table.notes) == 2  # a comment and a foot


def test_latex_fits_a_column_of_a_paper(tmp_path: Path) -> None:
    made = random_methods(3, {"s": 40}, (HIT, ERROR))
    methods = [replace(method, name=f"{method.name} (Ours)") for method in made]
    table = comparison_table(compare(methods, [HIT, ERROR], resampling=FAST))
    column = rf"\parbox{{8.25cm}}{{{render(table, 'latex')}}}"  # CVPR's
    lines = typeset(document(column), tmp_path).replace(MINUS, "-").splitlines()
    rows = [" ".join(line.split()) for line in lines]
    for score in (HIT, ERROR):
        [place] = [n for n, row in enumerate(rows) if row.startswith(f"{score.title} [")]
        assert methods[0].name in rows[place + 1]
    for row in table.texts():
        assert f"{row[1]} {row[3]} {row[5]} {row[7]}" in rows


def test_queries_that_differ_most_come_first() -> None:
    rows = {"a": [1.0, 5.0, 2.0, np.inf], "b": [1.0, 2.0, 4.0, 1.0]}
    methods = [made_method({"s": {ERROR.key: row}}, (ERROR,), n) for n, row in rows.items()]
    ids = methods[0].records["query"].tolist()
    table = differences_table(methods, ERROR, 2)
    assert [row.cells[0].value for row in table.rows] == [ids[3], ids[1]]
    assert [row.cells[3].value for row in table.rows] == [-np.inf, -3.0]
    assert differences_table(hits([1.0], [0.0]), HIT, 2).texts()[0][1:] == ["✓ hit", "✗ miss"]
