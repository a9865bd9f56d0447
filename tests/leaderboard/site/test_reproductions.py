"""The ledger of reproductions: printed numbers beside scored ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.core.errors import UserError
from airzoo_bench.leaderboard.site.api import Row, Score
from airzoo_bench.leaderboard.site.reported import read_reported
from airzoo_bench.leaderboard.site.reproductions import Link, find_reproductions, read_links
from tests.leaderboard.site.make_sample import row as sample_row
from tests.leaderboard.site.make_sample import table as sample_table
from tests.leaderboard.site.support import (
    COLUMNS,
)

LINK = '[[reproduction]]\nprotocol = "airzoo-mini-retrieval"\nmethod = "SALAD"\n'


def scenes_of(rows: list[Row]) -> dict[str, Any]:
    return {row.id: {"": row.scores, "city": row.scores} for row in rows}


def test_the_ledger_pairs_printed_and_scored_numbers(tmp_path: Path) -> None:
    own, printed = sample_row(0, 4, "re-scored"), sample_row(1, 4, "reported")
    path = tmp_path / "reproductions.toml"
    path.write_text(f'schema = 1\n{LINK}printed = "Method 1"\nwhy = "Weights."\n')
    links = read_links(path)
    table = sample_table("airzoo-mini-retrieval", [own, printed])
    found = find_reproductions(table, scenes_of([own, printed]), links, {})
    assert {(one.scene, one.score) for one in found} >= {("", "recall@1"), ("city", "ap@5")}
    first = next(one for one in found if (one.scene, one.score) == ("", "recall@1"))
    assert (first.printed_text, first.rescored_text) == ("72.50", "90.00")
    assert (first.within, first.by, first.why) == (False, "Team 0", "Weights.")


def test_the_same_name_is_the_same_method() -> None:
    own = sample_row(5, 9, "re-scored")
    printed = Row("reported-5", "reported", "Method 5", {"recall@1": Score(0.5, "50.00")})
    table = sample_table("airzoo-mini-retrieval", [own, printed])
    found = find_reproductions(table, {own.id: {}, printed.id: {}}, (), {})
    assert [(one.row, one.why) for one in found] == [(own.id, "")]


def test_nobody_takes_a_reproduction_s_place() -> None:
    rows = [
        Row(team, "re-scored", "SALAD", {"recall@1": Score(value, "")}, team=team)
        for team, value in (("Lab", 0.5), ("Spoiler", 0.01))
    ]
    printed = Row("reported-salad", "reported", "SALAD", {"recall@1": Score(0.5, "50.00")})
    table = sample_table("airzoo-mini-retrieval", [*rows, printed])
    found = find_reproductions(table, {row.id: {} for row in (*rows, printed)}, (), {})
    assert [one.by for one in found] == ["Lab", "Spoiler"]


@pytest.mark.parametrize(
    ("printed", "half", "within"),
    [(0.6004, 0.0005, True), (0.6006, 0.0005, False), (0.6004, 0.00005, False), (0.55, 0.0, True)],
)
def test_a_printed_number_stands_for_all_that_rounds_to_it(
    printed: float, half: float, within: bool
) -> None:
    own = Row("own", "re-scored", "Net", {"recall@1": Score(0.5, "50.00", 0.4, 0.6)})
    other = Row("reported", "reported", "Net", {"recall@1": Score(printed, "")})
    table = sample_table("airzoo-mini-retrieval", [own, other])
    halves = {("Net", "", "recall@1"): half}
    [one] = find_reproductions(table, {own.id: {}, other.id: {}}, (), halves)
    assert one.within is within


def test_half_a_digit_of_what_is_published(tmp_path: Path) -> None:
    reported = read_reported(tmp_path)
    seen, units = 0, {column.key: column.unit for column in COLUMNS}
    for table in reported.tables:
        titles = {title: title for scenes in table.values.values() for title in scenes if title}
        halves = reported.halves(table.benchmark, table.track, units, titles)
        seen += len(halves)
        assert all(half in {0.5 / 10**n for n in range(2, 6)} for half in halves.values())
    assert seen


@pytest.mark.parametrize("name", ["method", "printed"])
def test_a_link_to_nothing_is_refused(name: str) -> None:
    own, printed = sample_row(0, 4, "re-scored"), sample_row(1, 4, "reported")
    fields = {"method": "SALAD", "printed": "Method 1"} | {name: "SALAT"}
    link = Link.model_validate({"protocol": "airzoo-mini-retrieval"} | fields)
    table = sample_table("airzoo-mini-retrieval", [own, printed])
    with pytest.raises(UserError, match="no method 'SALAT'"):
        find_reproductions(table, scenes_of([own, printed]), [link], {})


def test_links_are_read_strictly(tmp_path: Path) -> None:
    path = tmp_path / "reproductions.toml"
    assert read_links(path) == ()
    path.write_text(f"schema = 1\n{LINK}becasue = 'x'\n")
    with pytest.raises(UserError, match="unknown key"):
        read_links(path)
