"""Pull requests to a board, on real repositories."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.errors import UserError
from airzoo_bench.leaderboard.board import Board
from airzoo_bench.leaderboard.ci.event import PullRequest
from airzoo_bench.leaderboard.ci.git import RefusedError, Repository
from airzoo_bench.leaderboard.ci.ledger import Line
from airzoo_bench.leaderboard.ci.rules import fetch_pull_request, read_files, touched
from tests.leaderboard.ci.repositories import File, Hosted

MINE, OTHER, MAINTAINER = 7, 8, 9
HOME = "submissions/made/retrieval"
BOARD = Board.model_validate(
    {
        "schema": 1,
        "title": "A board",
        "benchmarks": [{"name": "made", "title": "Made", "protocols": ["made-retrieval"]}],
        "maintainers": [MAINTAINER],
        "limits": {"committed_bytes": 1_000_000},
    }
)
TOML = b'schema = 1\nmethod = "Salad"\n'
SOUND: dict[str, File | None] = {f"{HOME}/mine/submission.toml": TOML, f"{HOME}/mine/p.npz": b"1"}


@dataclass
class World:
    hosted: Hosted
    folder: Path

    def look(self, number: int, head: str, account: int = MINE) -> list[UserError]:
        """Return what is wrong with a pull request."""
        pull = PullRequest(number, head, f"refs/pull/{number}/head", "main", account, merged=False)
        repository = Repository.create(self.folder / "bare.git", str(self.hosted.folder))
        fetch_pull_request(repository, pull)
        try:
            found = touched(repository, pull, BOARD, LEDGER)
            assert found is not None
            place, into = found.place, self.folder / "out"
            return read_files(repository, head, place, BOARD.limits, into) if found.tree else []
        except RefusedError as error:
            return [error]


def line(folder: str, account: int) -> Line:
    head, time = "a" * 40, "2026-11-01T00:00:00Z"
    return Line(account, "made", "retrieval", folder, head, time, "merged", "", "b" * 40, 1)


LEDGER = [line("theirs", OTHER), line("old", MINE), line("gone", OTHER)]
