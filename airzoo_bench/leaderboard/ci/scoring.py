"""A pull request from its event to an artifact: fetched, checked, re-scored, placed."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import BenchmarkError, ProtocolError, UserError
from airzoo_bench.evaluation.run_files import save
from airzoo_bench.leaderboard.board import Board
from airzoo_bench.leaderboard.checks import CheckedSubmission, check_submission
from airzoo_bench.leaderboard.ci.artifact import Artifact, problem_of
from airzoo_bench.leaderboard.ci.data_branch import DataBranch
from airzoo_bench.leaderboard.ci.event import PullRequest
from airzoo_bench.leaderboard.ci.git import BoardError, Repository
from airzoo_bench.leaderboard.ci.ledger import Line
from airzoo_bench.leaderboard.ci.others import Others
from airzoo_bench.leaderboard.ci.rules import (
    BASE,
    Touched,
    fetch_pull_request,
    read_files,
    submitted,
    touched,
)
from airzoo_bench.leaderboard.ci.standing import standing_of
from airzoo_bench.leaderboard.known import Place, known_submissions
from airzoo_bench.leaderboard.predictions_given import FETCHED
from airzoo_bench.leaderboard.rescoring import rescore
from airzoo_bench.leaderboard.runs import newest_runs, write_facts

if TYPE_CHECKING:
    from airzoo_bench.evaluation.evaluate import Evaluation
    from airzoo_bench.evaluation.track import Run

__all__ = ["OF_BOARD", "Rules", "is_sealed", "score_pull_request"]

OF_BOARD = (BoardError, BenchmarkError, ProtocolError)
"""What no submitter can put right: it stops the run."""


@dataclass(frozen=True)
class Rules:
    """What a pull request is held to.

    Attributes
    ----------
    root : Path
        A checkout of the board's own branch.
    branch : str
        The one that submissions are merged into.
    data : Path
        Where benchmark folders lie.
    note : callable
        Takes sentences for the maintainer.
    """

    board: Board
    root: Path
    branch: str
    data: Path
    run: Run
    note: Callable[[str], None]


def score_pull_request(pull: PullRequest, remote: str, rules: Rules, work: Path) -> Artifact:
    """Check a pull request and score it where the truth is public."""
    if pull.base != rules.branch:
        return _artifact(pull, "nothing")
    repository = Repository.create(work / "pull.git", remote)
    fetch_pull_request(repository, pull)
    branch = DataBranch.open(work / "data.git", remote)
    ledger = branch.ledger()
    found: Touched | None = None
    try:
        found = touched(repository, pull, rules.board, ledger)
        if found is None:
            return _artifact(pull, "nothing")
        if not found.tree:
            return _artifact(pull, "withdrawn", **_of(found))
        return _Submitted(pull, repository, branch, ledger, found, rules, work).artifact()
    except UserError as error:
        return _refused(pull, found, [error], work)


@dataclass(frozen=True)
class _Submitted:
    """A pull request with one submission in a folder that its author may change."""

    pull: PullRequest
    repository: Repository
    branch: DataBranch
    ledger: Sequence[Line]
    found: Touched
    rules: Rules
    work: Path

    def artifact(self) -> Artifact:
        board, place = self.rules.board, self.found.place
        known = known_submissions(self.rules.root)
        faults = read_files(self.repository, self.pull.head, place, board.limits, self.work)
        if faults:
            return _refused(self.pull, self.found, faults, self.work)
        checked = check_submission(
            self.work / place.path,
            board,
            self.rules.data,
            known=known,
            fetch=True,
            run=self.rules.run,
        )
        given, others = checked.submission, Others(self.pull, self.ledger, board, known)
        faults = [*checked.errors, *others.crowd(place)]
        if faults:
            return _refused(self.pull, self.found, faults, self.work)
        assert given is not None  # what has no errors was read
        # What concerns others comes first: a comment may be cut at its end.
        checked.warnings[:0] = others.strange_team(given)
        more = {
            **_of(self.found),
            "update": self.repository.resolve(f"{BASE}:{place.path}") is not None,
            "method": given.method,
            "team": given.team,
            "warnings": tuple(_without(line, self.work) for line in checked.warnings),
        }
        if is_sealed(board, place):
            _keep_fetched(checked, self.rules, self.work)
            return _artifact(self.pull, "sealed", **more)
        return self._scored(checked, others, more)

    def _scored(self, checked: CheckedSubmission, others: Others, more: dict[str, Any]) -> Artifact:
        rescored = rescore(checked, data=self.rules.data, run=self.rules.run)
        claimed = {
            "claimed": tuple(_without(line, self.work) for line in rescored.lines),
            "agrees": None if rescored.claimed is None else rescored.agrees,
        }
        if rescored.errors:
            return _refused(self.pull, self.found, rescored.errors, self.work, **(more | claimed))
        placed = self._placed(checked, rescored.evaluation)
        result = rescored.evaluation.result
        table = self.work / "board" / "runs" / self.found.place.benchmark / self.found.place.track
        copied = others.copied(more["team"], self.found.place, newest_runs(table))
        more["warnings"] = (*copied, *more["warnings"])
        return _artifact(
            self.pull, "scored", **more, **claimed, **placed,
            columns=result.columns, notes=result.notes, truth=result.truth.fingerprint,
        )  # fmt: skip

    def _placed(self, checked: CheckedSubmission, evaluation: Evaluation) -> dict[str, Any]:
        """Place it among the runs of what stands on the board, as the board would after a merge."""
        assert checked.submission is not None  # what has no errors was read
        home, place = self.work / "board", self.found.place
        for one in {place, *submitted(self.repository, place.benchmark, self.rules.note)}:
            if one.track == place.track:
                self.branch.export(home, f"runs/{one.benchmark}/{one.track}/{one.folder}")
        folder = home / "runs" / place.benchmark / place.track / place.folder
        last = newest_runs(folder.parent).get(place.folder)
        run = folder / ("1" if last is None else str(int(last.name) + 1))
        save(evaluation, run)
        write_facts(run, checked.submission, self.pull.head, self.found.tree)
        return standing_of(place, home / "runs", self.work / "cache")


def is_sealed(board: Board, place: Place) -> bool:
    """Whether the truth of a submission's benchmark is sealed."""
    return any(one.name == place.benchmark and one.sealed for one in board.benchmarks)


def _keep_fetched(checked: CheckedSubmission, rules: Rules, work: Path) -> None:
    """Keep predictions that came from an address for the job that has no network."""
    found = checked.predictions
    if found is not None and found.is_relative_to(rules.data / FETCHED):
        shutil.copytree(found.parent, work / FETCHED / found.parent.name)


def _artifact(pull: PullRequest, kind: str, **more: Any) -> Artifact:
    return Artifact(
        kind=kind,  # type: ignore[arg-type]
        pull_request=pull.number,
        account=pull.account,
        head=pull.head,
        **more,
    )


def _refused(
    pull: PullRequest,
    found: Touched | None,
    faults: Sequence[UserError],
    work: Path,
    **more: Any,
) -> Artifact:
    problems = []
    for fault in faults:
        if isinstance(fault, OF_BOARD):
            raise fault
        given = problem_of(fault).model_dump()
        problems.append({key: text and _without(text, work) for key, text in given.items()})
    stated = (_of(found) if found else {}) | more
    return _artifact(pull, "refused", problems=tuple(problems), **stated)


def _of(found: Touched) -> dict[str, Any]:
    place = found.place
    return {
        "benchmark": place.benchmark,
        "track": place.track,
        "folder": place.folder,
        "tree": found.tree,
    }


def _without(text: str, work: Path) -> str:
    """Return a text without the path of the folder that CI works in."""
    return text.replace(f"{work}/", "").replace(str(work), "")
