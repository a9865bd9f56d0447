"""Entries that do not go together: each fault is named, and the board stays."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from airzoo_bench.core.errors import UserError
from airzoo_bench.leaderboard.site.build import build_board
from airzoo_bench.leaderboard.site.entries import Faults, read_entries, waiting
from tests.leaderboard.site.support import (
    built,
    given,
    method,
    rows_of,
    some_runs,
    write_version,
)
from tests.statistics.support import write_method


def spoil(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


RUN = "runs/made/retrieval/m1/1"
FAULTS: list[tuple[str, Callable[[Path], object], str]] = [
    ("damaged", lambda run: (run / "result.json").write_text("{"), "result.json: not a result"),
    (
        "edited",
        lambda run: spoil(run / "result.json", '"method": "Method 1"', '"method": "Method X"'),
        "the checksum does not fit",
    ),
    ("records gone", lambda run: (run / "records.csv").unlink(), "records.csv: no such file"),
    (
        "records edited",
        lambda run: spoil(run / "records.csv", "1.0", "0.0"),
        "not the records of the result",
    ),
    ("no result", lambda run: (run / "result.json").unlink(), "neither result.json nor answer"),
    ("no submission", lambda run: (run / "submission.toml").unlink(), "no such submission file"),
    ("no run", lambda run: (run / "run.json").unlink(), "no such run file"),
    (
        "other protocol",
        lambda run: spoil(run / "submission.toml", 'protocol = "made"', 'protocol = "other"'),
        "submitted for other",
    ),
    (
        "other place",
        lambda run: (run.parent.parent.parent).rename(run.parents[3] / "else"),
        "is of made (retrieval)",
    ),
]


@pytest.mark.parametrize(
    ("spoiled", "message"), [f[1:] for f in FAULTS], ids=[f[0] for f in FAULTS]
)
def test_each_fault_is_named_and_the_board_stays(
    tmp_path: Path, spoiled: Callable[[Path], object], message: str
) -> None:
    some_runs(tmp_path / "runs", 2)
    (tmp_path / "site/api/v1").mkdir(parents=True)
    (tmp_path / "site/api/v1/board.json").touch()
    spoiled(tmp_path / RUN)
    with pytest.raises(UserError) as error:
        built(tmp_path)
    assert message in str(error.value)
    assert [path.name for path in (tmp_path / "site").rglob("*.json")] == ["board.json"]


@pytest.mark.parametrize("name", ["void", "a b/1", ".old/1", "m1/latest"])
def test_what_is_no_submission_is_named_and_skipped(tmp_path: Path, name: str) -> None:
    some_runs(tmp_path / "runs", 2)
    (tmp_path / "runs/made/retrieval" / name).mkdir(parents=True)
    notes: list[str] = []
    site = build_board(given(tmp_path), tmp_path / "site", tmp_path / "cache", note=notes.append)
    assert set(rows_of(site)) == {"m0", "m1"}
    assert [name.removesuffix("/1") in note for note in notes] == [True]


def test_of_names_that_differ_in_case_the_first_that_was_scored_stands(tmp_path: Path) -> None:
    for folder, day in (("Qux", 3), ("qux", 2), ("other", 1)):
        write_version(tmp_path / "runs", folder, 1, method(f"Of {day}", day / 9), day=day)
    write_version(tmp_path / "runs", "qux", 2, method("Newer", 0.5), day=9)
    notes: list[str] = []
    site = build_board(given(tmp_path), tmp_path / "site", tmp_path / "cache", note=notes.append)
    assert set(rows_of(site)) == {"qux", "other"}
    assert len(notes) == 1
    assert "Qux" in notes[0]


def test_all_faults_in_one_message(tmp_path: Path) -> None:
    some_runs(tmp_path / "runs", 4)
    for number in (1, 2, 3):
        (tmp_path / f"runs/made/retrieval/m{number}/1/records.csv").unlink()
    with pytest.raises(UserError, match="3 faults") as error:
        built(tmp_path)
    assert str(error.value).count("no such file") == 3


def test_two_results_of_one_method(tmp_path: Path) -> None:
    some_runs(tmp_path / "runs", 2)
    plain = write_method(tmp_path / "r", method("method 1", 0.5))
    with pytest.raises(UserError, match=r"two results of [mM]ethod 1"):
        built(tmp_path, results=[plain])


def test_two_teams_with_one_method_are_told_apart(tmp_path: Path) -> None:
    """Whoever runs SALAD calls it SALAD; were that a fault, anybody could stop the board."""
    for folder, rate in (("a", 0.4), ("b", 0.5), ("c", 0.6)):
        name = "Other" if folder == "c" else "SALAD"
        scored = method(name, rate, seed=ord(folder))
        write_version(tmp_path / "runs", folder, 1, scored, team=f"Team {folder}")
    site = built(tmp_path)
    table = (site / "downloads/made.csv").read_text(encoding="utf-8")
    assert ("SALAD (Team a)" in table, "SALAD (Team b)" in table) == (True, True)
    assert "Other (" not in table
    page = (site / "tables/made/compare.html").read_text(encoding="utf-8")
    assert "SALAD (Team a)" in page
    assert "Other (" not in page


def test_scores_that_mean_different_things(tmp_path: Path) -> None:
    one = method("A", 0.5)
    columns = [c.model_copy(update={"title": "Other"}) for c in one.result.columns]
    paths = [
        write_method(tmp_path / "a", one),
        write_method(tmp_path / "b", method("B", 0.5, columns=columns)),
    ]
    with pytest.raises(UserError, match="mean different things"):
        built(tmp_path, results=paths)


def test_other_queries_are_refused(tmp_path: Path) -> None:
    one, other = method("A", 0.5), method("B", 0.5)
    other.records.loc[0, "query"] = "east/other"
    paths = [write_method(tmp_path / n, m) for n, m in (("a", one), ("b", other))]
    with pytest.raises(UserError, match="not on the same queries"):
        built(tmp_path, results=paths)


def test_what_waits_is_said(tmp_path: Path) -> None:
    write_version(tmp_path / "runs", "a", 1, method("A", 0.5))
    for name in ("a", "b"):
        folder = tmp_path / "submissions/made/retrieval" / name
        folder.mkdir(parents=True)
        (folder / "submission.toml").touch()
    entries = read_entries(tmp_path / "runs", Faults())
    assert waiting(tmp_path / "submissions", entries) == [
        "made/retrieval/b has not been scored yet: no row"
    ]


def test_a_protocol_that_nobody_knows(tmp_path: Path) -> None:
    board = given(tmp_path).board
    assert board is not None
    [one] = board.benchmarks
    unknown = one.model_copy(update={"protocols": ("nowhere",)})
    with pytest.raises(UserError, match="unknown protocol nowhere"):
        built(tmp_path, board=board.model_copy(update={"benchmarks": (unknown,)}))
