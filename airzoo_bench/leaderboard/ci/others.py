"""What a submission has to do with those that other accounts have on the board."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from filecmp import cmp
from pathlib import Path

from airzoo_bench.core.errors import UserError, counted
from airzoo_bench.leaderboard.board import Board
from airzoo_bench.leaderboard.ci.event import PullRequest
from airzoo_bench.leaderboard.ci.git import RefusedError
from airzoo_bench.leaderboard.ci.ledger import Line, owner
from airzoo_bench.leaderboard.known import Known, Place
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, Submission
from airzoo_bench.results.files import records_path

__all__ = ["Others"]


@dataclass(frozen=True)
class Others:
    """What is on the board, and whose.

    Attributes
    ----------
    pull : PullRequest
        The one that is looked at.
    ledger : sequence of Line
    board : Board
    known : sequence of Known
        All that is on the board.
    """

    pull: PullRequest
    ledger: Sequence[Line]
    board: Board
    known: Sequence[Known]

    def strange_team(self, given: Submission) -> Iterator[str]:
        """Warn of a team that other accounts alone have submitted for: anybody can write a name."""
        theirs = [one for one in self.known if one.team == given.team]
        accounts = {owner(self.ledger, one.place) for one in theirs}
        if theirs and self.pull.account not in (*accounts, *self.board.maintainers):
            yield (
                f"team {given.team!r} is on the board with {theirs[0].folder}, by another account: "
                "the maintainers should know whether this is of the same team"
            )

    def copied(self, team: str, place: Place, newest: Mapping[str, Path]) -> Iterator[str]:
        """Warn of answers that are another team's, whatever file they came in."""
        records = {name: records_path(run / "result.json") for name, run in newest.items()}
        own = records.pop(place.folder)
        for one in self._table(place):
            theirs = records.get(one.folder) if one.team != team else None
            if theirs is not None and theirs.is_file() and cmp(own, theirs, shallow=False):
                yield (
                    f"every record is that of {one.method!r} of team {one.team!r}, in "
                    f"{one.folder}: these are the same answers"
                )

    def _table(self, place: Place) -> list[Known]:
        return [one for one in self.known if replace(one.place, folder=place.folder) == place]

    def crowd(self, place: Place) -> Iterator[UserError]:
        """Refuse one more than an account may show: clones would widen everybody's rank range."""
        if self.pull.account in self.board.maintainers:
            return
        table, most = self._table(place), self.board.limits.entries
        others = [one.place for one in table if one.place != place]
        own = [one for one in others if owner(self.ledger, one) == self.pull.account]
        if len(own) >= most:
            yield RefusedError(
                f"this account has {counted(len(own), 'submission')} in this table already",
                where=f"{place.path}/{SUBMISSION_FILE}",
                expected=f"at most {most} that are shown at once",
                fix="withdraw one of them, or put the new version into its folder",
            )
