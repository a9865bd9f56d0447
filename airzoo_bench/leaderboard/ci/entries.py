"""Entering tries and merges into the ledger of the data branch."""

from __future__ import annotations

import datetime
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from airzoo_bench.leaderboard.board import BOARD_FILE, read_board
from airzoo_bench.leaderboard.ci.artifact import Artifact, problem_of
from airzoo_bench.leaderboard.ci.data_branch import DataBranch
from airzoo_bench.leaderboard.ci.event import PullRequest
from airzoo_bench.leaderboard.ci.git import RefusedError
from airzoo_bench.leaderboard.ci.ledger import Line, Outcome, check_tries, written_time

__all__ = ["answer_path", "enter", "enter_merge"]


def answer_path(tree: str) -> str:
    """Return where the data branch keeps the answer to a sealed submission until it is merged."""
    return f"answers/{tree}.json"


def enter(found: Artifact, outcome: Outcome, remote: str, root: Path) -> Artifact:
    """Add a line on a try to the ledger, and with it the answer of a sealed truth."""
    limits = read_board(root / BOARD_FILE).limits
    outcome = "scored" if outcome == "failed" and found.truth else outcome
    line = _line(found, outcome)
    files = {}
    if found.answer is not None and outcome == "scored":
        files[answer_path(found.tree)] = found.answer.model_dump_json(by_alias=True).encode()

    def check(lines: list[Line]) -> None:
        if outcome == "started":
            check_tries(lines, line, limits)

    with _opened(remote) as branch:
        try:
            branch.append(line, check, files)
        except RefusedError as error:
            return found.model_copy(update={"kind": "refused", "problems": (problem_of(error),)})
    return found


def enter_merge(pull: PullRequest, remote: str) -> str:
    """Make the account of a merged pull request the owner of its folder, and say what was done."""
    if not pull.merged:
        return f"pull request {pull.number} is not merged: nothing to enter"
    with _opened(remote) as branch:
        own = [
            line
            for line in branch.ledger()
            if (line.pull_request, line.head) == (pull.number, pull.head)
        ]
        if any(line.outcome == "merged" for line in own):
            return f"pull request {pull.number} was entered as merged already: nothing to enter"
        scored = [line for line in own if line.outcome == "scored"]
        if not scored:
            return f"no submission was scored at {pull.head[:12]}: nothing to enter"
        last = scored[-1]
        branch.append(replace(last, outcome="merged", time=_now()))
    return f"{last.place.path} belongs to account {last.account}"


@contextmanager
def _opened(remote: str) -> Iterator[DataBranch]:
    with tempfile.TemporaryDirectory() as folder:
        yield DataBranch.open(Path(folder) / "data.git", remote)


def _line(found: Artifact, outcome: Outcome) -> Line:
    place = found.place
    return Line(
        account=found.account,
        benchmark=place.benchmark,
        track=place.track,
        folder=place.folder,
        head=found.head,
        time=_now(),
        outcome=outcome,
        truth=found.truth,
        tree=found.tree,
        pull_request=found.pull_request,
    )


def _now() -> str:
    return written_time(datetime.datetime.now(datetime.UTC))
