"""Tries at sealed truths: counted by account and commit, also when two jobs push at once."""

from __future__ import annotations

from pathlib import Path

import pytest

from airzoo_bench.leaderboard.board import Limits
from airzoo_bench.leaderboard.data_branch import DataBranch, Try, check_tries
from airzoo_bench.leaderboard.git import RefusedError
from tests.leaderboard.hosting import Hosted

LIMITS = Limits(tries=2, days=30)


def line(head: str, day: int, outcome: str = "started", account: int = 7) -> Try:
    return Try(str(account), "made", head, outcome, f"2026-11-{day:02}T00:00:00Z")


@pytest.mark.parametrize(
    ("tries", "refused"),
    [
        ([line("a", 1)], False),
        ([line("a", 1), line("b", 2)], True),
        ([line("a", 1), line("b", 2, account=8)], False),
        ([line("a", 1), line("a", 2), line("a", 2, "scored")], False),  # one commit is one try
        ([line("a", 1), line("b", 2), line("b", 3, "failed")], False),
        ([line("a", 1), line("b", 2), line("c", 2)], True),  # c itself was begun: a fourth job
    ],
)
def test_a_try_beyond_the_limit_is_refused(tries: list[Try], refused: bool) -> None:
    new = line("c", 5)
    if not refused:
        check_tries(tries, new, LIMITS)
        return
    with pytest.raises(RefusedError, match="has had 2 tries on made within 30 days") as error:
        check_tries(tries, new, LIMITS)
    assert error.value.fix == "push again after 2026-12-01T00:00:00Z"


def test_a_try_comes_back_once_the_oldest_is_old_enough() -> None:
    tries = [line("a", 1), line("b", 2)]
    check_tries(tries, Try("7", "made", "c", "started", "2026-12-01T00:00:01Z"), LIMITS)


def test_two_jobs_at_once_cannot_both_have_the_last_try(tmp_path: Path) -> None:
    hosted = Hosted.create(tmp_path / "hosted.git", {".keep": b""})
    first, second = (DataBranch(tmp_path / name, str(hosted.folder)) for name in "ab")
    limits = Limits(tries=1, days=30)
    first.add_try(line("a", 1), limits, {})
    with pytest.raises(RefusedError, match="has had 1 try"):
        second.add_try(line("b", 1), limits, {})
    second.add_try(line("b", 1, account=8), limits, {"answers/x.json": b"{}"})
    again = DataBranch(tmp_path / "c", str(hosted.folder))
    assert [one.head for one in again.tries()] == ["a", "b"]
    assert again.read("answers/x.json") == b"{}"
