"""A pull request from its event to an artifact: fetched, checked, re-scored, placed."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import BenchmarkError, ProtocolError, UserError
from airzoo_bench.core.plurals import counted
from airzoo_bench.evaluation.run_files import save
from airzoo_bench.leaderboard.board import Board
from airzoo_bench.leaderboard.checks import CheckedSubmission, check_submission
from airzoo_bench.leaderboard.ci.artifact import Artifact, problem_of
from airzoo_bench.leaderboard.ci.data_branch import DataBranch
from airzoo_bench.leaderboard.ci.event import PullRequest
from airzoo_bench.leaderboard.ci.git import BoardError, RefusedError, Repository
from airzoo_bench.leaderboard.ci.ledger import Line, owner
from airzoo_bench.leaderboard.ci.rules import (
    BASE,
    Touched,
    fetch_pull_request,
    read_files,
    submitted,
    touched,
)
from airzoo_bench.leaderboard.ci.standing import standing_of
from airzoo_bench.leaderboard.known import Known, Place, known_submissions
from airzoo_bench.leaderboard.predictions_given import FETCHED
from airzoo_bench.leaderboard.rescoring import rescore
from airzoo_bench.leaderboard.runs import newest_runs, write_facts
from airzoo_bench.leaderboard.submission import Submission

if TYPE_CHECKING:
    from airzoo_bench.evaluation.evaluate import Evaluation
    from airzoo_bench.evaluation.parts import Resources

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
    """

    board: Board
    root: Path
    branch: str
    data: Path
    resources: Resources


def score_pull_request(pull: PullRequest, remote: str, rules: Rules, work: Path) -> Artifact:
    """Check a pull request and score it where the truth is public.

    Parameters
    ----------
    pull : PullRequest
    remote : str
        URL or folder of the repository.
    rules : Rules
    work : Path
        A folder that is empty or does not exist: git's objects, then the submission's files, at
        their place below it.

    Returns
    -------
    Artifact
        Also where it is refused, with the reasons.

    Raises
    ------
    UserError
        The event, the board or its data are not as they must be: no fault of the submission.
    """
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
        )
        faults = [*checked.errors, *self._foreign(checked), *self._crowd(checked, known)]
        if faults:
            return _refused(self.pull, self.found, faults, self.work)
        given = checked.submission
        assert given is not None  # what has no errors was read
        checked.take(self._strange_team(given, known))
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
        return self._scored(checked, more)

    def _strange_team(self, given: Submission, known: Sequence[Known]) -> Iterator[str]:
        """Warn of a team that other accounts alone have submitted for: anybody can write a name."""
        theirs = [one for one in known if one.team == given.team]
        accounts = {owner(self.ledger, one.place) for one in theirs}
        if theirs and self.pull.account not in (*accounts, *self.rules.board.maintainers):
            yield (
                f"team {given.team!r} is on the board with {theirs[0].folder}, by another account: "
                "the maintainers should know whether this is of the same team"
            )

    def _crowd(self, checked: CheckedSubmission, known: Sequence[Known]) -> Iterator[UserError]:
        """Refuse one more than an account may show: clones would widen everybody's rank range."""
        given, place, most = checked.submission, self.found.place, self.rules.board.limits.entries
        if given is None or self.pull.account in self.rules.board.maintainers:
            return
        here = place.benchmark, place.track
        table = [one for one in known if (one.benchmark, one.track) == here]
        gone = {place.folder, given.supersedes, *(one.supersedes for one in table)}
        shown = [one for one in table if one.folder not in gone]
        own = [one for one in shown if owner(self.ledger, one.place) == self.pull.account]
        if len(own) >= most:
            yield RefusedError(
                f"this account has {counted(len(own), 'submission')} in this table already",
                where=f"{place.path}/submission.toml",
                expected=f"at most {most} that are shown at once",
                fix="let it supersede one of them, or withdraw one",
            )

    def _foreign(self, checked: CheckedSubmission) -> list[UserError]:
        """Refuse to supersede what another account has submitted."""
        if not checked.submission or not checked.submission.supersedes:
            return []
        place = self.found.place
        old = Place(place.benchmark, place.track, checked.submission.supersedes)
        known = self.repository.resolve(f"{BASE}:{old.path}") is not None
        whose = owner(self.ledger, old)
        if known and self.pull.account in (whose, *self.rules.board.maintainers):
            return []
        what = "belongs to another account" if known else "is not on the board"
        return [RefusedError(
            f"supersedes {old.folder}, which {what}",
            where=f"{place.path}/submission.toml",
            expected="a folder of the same benchmark and track that this account has submitted",
            fix="leave supersedes out",
        )]  # fmt: skip

    def _scored(self, checked: CheckedSubmission, more: dict[str, Any]) -> Artifact:
        rescored = rescore(checked, data=self.rules.data, resources=self.rules.resources)
        claimed = {
            "claimed": tuple(_without(line, self.work) for line in rescored.lines),
            "agrees": None if rescored.claimed is None else rescored.agrees,
        }
        if rescored.errors:
            return _refused(self.pull, self.found, rescored.errors, self.work, **(more | claimed))
        placed = self._placed(checked, rescored.evaluation)
        result = rescored.evaluation.result
        return _artifact(
            self.pull, "scored", **more, **claimed, **placed,
            columns=result.columns, notes=result.notes, truth=result.truth.fingerprint,
        )  # fmt: skip

    def _placed(self, checked: CheckedSubmission, evaluation: Evaluation) -> dict[str, Any]:
        """Place it among the runs of what stands on the board, as the board would after a merge."""
        assert checked.submission is not None  # what has no errors was read
        home, place = self.work / "board", self.found.place
        for one in {place, *submitted(self.repository, place.benchmark)}:
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
