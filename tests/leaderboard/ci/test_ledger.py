"""The ledger and the branch it lies on: who counts, who owns, who pushes first."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import pytest

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.leaderboard.board import Limits
from airzoo_bench.leaderboard.ci.data_branch import DATA_BRANCH, DataBranch
from airzoo_bench.leaderboard.ci.git import BoardError, RefusedError
from airzoo_bench.leaderboard.ci.ledger import (
    Line,
    check_tries,
    owner,
    parse_ledger,
    write_ledger,
)
from tests.leaderboard.ci.repositories import Hosted, git

LIMITS = Limits(tries=2, days=30)


def line(day: int, head: str = "", outcome: str = "scored", account: int = 1) -> Line:
    commit = (head or f"{day:02d}") * 20
    time = f"2026-11-{day:02d}T12:00:00Z"
    return Line(
        account,
        "made",
        "retrieval",
        "mine",
        commit,
        time,
        outcome,
        "",
        "b" * 40,
        1,  # type: ignore[arg-type]
    )


def test_ledger_reads_what_it_writes() -> None:
    lines = [line(1), line(2, outcome="merged", account=1 << 40)]
    assert parse_ledger(write_ledger(lines)) == lines
    assert parse_ledger(None) == []


@pytest.mark.parametrize(
    "content",
    [
        b"account,name\n",
        write_ledger([line(1)]).replace(b"scored", b"won"),
        write_ledger([line(1)]).replace(b"2026-11-01T12", b"yesterday"),
        write_ledger([line(1)]).replace(b",mine", b""),
        b"\xff\xfe",
    ],
)
def test_ledger_that_somebody_changed_stops_the_run(content: bytes) -> None:
    with pytest.raises(SubmissionError, match="not a ledger"):
        parse_ledger(content)


def test_tries_beyond_the_limit_are_refused_until_the_oldest_is_old_enough() -> None:
    before = [line(1), line(5)]
    with pytest.raises(RefusedError) as refused:
        check_tries(before, line(9, outcome="started"), LIMITS)
    assert "has had 2 tries on made within 30 days" in refused.value.what
    assert refused.value.fix == "push again after 2026-12-01T12:00:00Z"
    later = dataclasses.replace(line(9), time="2026-12-01T12:00:01Z")
    check_tries(before, later, LIMITS)


def test_what_counts_as_a_try() -> None:
    new = line(9, outcome="started")
    check_tries([line(1), line(2, outcome="started"), line(2, outcome="failed")], new, LIMITS)
    check_tries([line(1, outcome="started"), line(1), line(1)], new, LIMITS)  # one commit
    check_tries([line(1), line(2, account=2)], new, LIMITS)
    check_tries([line(1), dataclasses.replace(line(2), benchmark="other")], new, LIMITS)
    check_tries([line(1), line(9)], new, LIMITS)  # the same commit again
    with pytest.raises(RefusedError):
        check_tries([line(1, outcome="started"), line(2, outcome="started")], new, LIMITS)


def test_answered_commit_counts_though_a_later_run_of_it_failed() -> None:
    """Who opens the pull request anew, and stops that run, has the answer all the same."""
    new, limits = line(9, outcome="started"), Limits(tries=1, days=30)
    answered = [line(1, outcome="started"), line(1)]
    again = [line(1, outcome="started"), line(1, outcome="failed")]
    with pytest.raises(RefusedError):
        check_tries([*answered, *again], new, limits)
    # Two pull requests of one commit: one was stopped, the other is under way.
    with pytest.raises(RefusedError):
        check_tries([line(1, outcome="started"), *again], new, limits)
    check_tries([*again, *again], new, limits)
    with pytest.raises(RefusedError):
        check_tries([again[1], line(1, outcome="started")], new, limits)


def test_owner_is_the_account_of_the_first_merge() -> None:
    tried, first, second = (
        line(1, account=3),
        line(2, "aa", "merged", 1),
        line(3, "bb", "merged", 2),
    )
    assert owner([tried, first, second], tried.place) == 1
    assert owner([tried], tried.place) is None


@pytest.fixture
def hosted(tmp_path: Path) -> Hosted:
    return Hosted.create(tmp_path / "hosted.git", {"README.md": b"x"})


def opened(hosted: Hosted, folder: Path) -> DataBranch:
    return DataBranch.open(folder, str(hosted.folder))


def test_two_jobs_that_push_at_once_both_stand(hosted: Hosted, tmp_path: Path) -> None:
    one, two = opened(hosted, tmp_path / "one.git"), opened(hosted, tmp_path / "two.git")
    one.append(line(1))
    two.append(line(2), files={"answers/x.json": b"{}"})  # its copy has no branch yet
    one.append(line(3))
    assert opened(hosted, tmp_path / "three.git").ledger() == [line(1), line(2), line(3)]
    assert one.read("answers/x.json") == b"{}"
    log = git(hosted.folder, "log", "--format=%s", DATA_BRANCH).splitlines()
    assert len(log) == 3
    assert git(hosted.folder, "ls-tree", "--name-only", DATA_BRANCH).split() == [
        "answers",
        "ledger.csv",
    ]


def test_two_jobs_at_once_cannot_both_have_the_last_try(hosted: Hosted, tmp_path: Path) -> None:
    one, two = opened(hosted, tmp_path / "one.git"), opened(hosted, tmp_path / "two.git")

    def append(branch: DataBranch, new: Line) -> None:
        branch.append(new, lambda lines: check_tries(lines, new, Limits(tries=1)))

    append(one, line(1, outcome="started"))
    with pytest.raises(RefusedError, match="has had 1 try"):
        append(two, line(2, outcome="started"))


def test_branch_that_never_stands_still_ends_the_run(
    hosted: Hosted, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("airzoo_bench.leaderboard.ci.data_branch.time.sleep", lambda _: None)
    slow, fast = opened(hosted, tmp_path / "one.git"), opened(hosted, tmp_path / "two.git")
    fast.append(line(1))

    def overtaken(branch: DataBranch) -> Mapping[str, bytes]:
        fast.append(line(2))
        return {"x": b"1"}

    with pytest.raises(BoardError, match="pushed to by others 10 times"):
        slow.write(overtaken, "never")


def test_push_that_the_remote_forbids_is_said_at_once(hosted: Hosted, tmp_path: Path) -> None:
    branch = opened(hosted, tmp_path / "one.git")
    git(hosted.folder, "config", "receive.denyCurrentBranch", "refuse")
    hook = hosted.folder / "hooks" / "pre-receive"
    hook.parent.mkdir(exist_ok=True)
    hook.write_text("#!/bin/sh\necho protected branch >&2\nexit 1\n")
    hook.chmod(0o755)
    with pytest.raises(BoardError, match="hook declined"):
        branch.append(line(1))


def test_export_writes_what_is_below_a_folder(hosted: Hosted, tmp_path: Path) -> None:
    branch = opened(hosted, tmp_path / "one.git")
    branch.write(lambda _: {"runs/a/b/c/1/run.json": b"1", "runs/a/b/d/1/run.json": b"2"}, "runs")
    branch.export(tmp_path / "out", "runs/a/b/c")
    assert [path.name for path in tmp_path.glob("out/runs/a/b/*")] == ["c"]
