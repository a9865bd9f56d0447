"""Scoring for a board: a pull request, or all submissions on the board's branch."""

from __future__ import annotations

import shutil
import socket
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from filecmp import cmp
from pathlib import Path
from typing import Any

from airzoo_bench.benchmark.folder import find_benchmark
from airzoo_bench.core.errors import (
    BenchmarkError,
    ProtocolError,
    SubmissionError,
    UsageError,
    UserError,
    counted,
)
from airzoo_bench.evaluation.evaluate import Evaluation
from airzoo_bench.evaluation.run_files import save
from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard.answer import SealedAnswer
from airzoo_bench.leaderboard.artifact import Artifact, problem_of
from airzoo_bench.leaderboard.board import Board, Known, Place, known_submissions
from airzoo_bench.leaderboard.checks import FETCHED, CheckedSubmission, check_submission
from airzoo_bench.leaderboard.data_branch import DataBranch
from airzoo_bench.leaderboard.git import BoardError, RefusedError, Repository
from airzoo_bench.leaderboard.pull_request import (
    BASE,
    PullRequest,
    Touched,
    fetch_pull_request,
    read_files,
    submitted,
    touched,
)
from airzoo_bench.leaderboard.rescoring import rescore
from airzoo_bench.leaderboard.runs import (
    ANSWER_FILE,
    RUN_FILE,
    Claimed,
    measure_now,
    measure_of,
    newest_run,
    next_run,
    read_run,
    write_facts,
)
from airzoo_bench.leaderboard.sealed.scoring import OpenedTruthError, score_sealed
from airzoo_bench.leaderboard.site.standing import standing_of
from airzoo_bench.leaderboard.submission import (
    SUBMISSION_FILE,
    Submission,
    read_public_submission,
)

__all__ = [
    "Rules",
    "ScoredPlace",
    "answer_path",
    "score_against_truth",
    "score_merged",
    "score_pull_request",
]

_OF_BOARD = (BoardError, BenchmarkError, ProtocolError)  # no submitter can put these right
_FETCHING_S = 3600.0


@dataclass(frozen=True)
class Rules:
    """The rules and the means of a board's CI.

    Attributes
    ----------
    root : Path
        A checkout of the board's own branch.
    branch : str
        The branch that submissions are merged into.
    data : Path
        The folder of benchmark folders.
    note : callable
        Takes sentences for the maintainer.
    """

    board: Board
    root: Path
    branch: str
    data: Path
    run: Run
    note: Callable[[str], None]

    def check(self, folder: Path, **more: Any) -> CheckedSubmission:
        """Check the folder of a submission."""
        return check_submission(folder, self.board, self.data, run=self.run, **more)


def answer_path(tree: str) -> str:
    """Return where the data branch keeps the answer to a sealed submission until it is merged."""
    return f"answers/{tree}.json"


# --- a pull request ---


def score_pull_request(pull: PullRequest, remote: str, rules: Rules, work: Path) -> Artifact:
    """Check a pull request, and score it where the truth is public."""
    if pull.base != rules.branch:
        return _artifact(pull, "nothing")
    repository = Repository.create(work / "pull.git", remote)
    branch = DataBranch(work / "data.git", remote)
    found: Touched | None = None

    def former_owner(place: Place) -> int | None:
        branch.export(place, work / "board")
        run = newest_run(work / "board", place)
        return None if run is None else read_public_submission(run / SUBMISSION_FILE).account or 0

    try:
        fetch_pull_request(repository, pull)
        found = touched(repository, pull, rules.board, former_owner)
        if found is None:
            return _artifact(pull, "nothing")
        if not found.tree:
            return _artifact(pull, "withdrawn", found)
        return _Scoring(pull, repository, branch, found, rules, work).artifact()
    except UserError as error:
        return _refused(pull, found, [error], work)


@dataclass(frozen=True)
class _Scoring:
    """A pull request with one submission, in a folder that its author may change."""

    pull: PullRequest
    repository: Repository
    branch: DataBranch
    found: Touched
    rules: Rules
    work: Path

    def artifact(self) -> Artifact:
        """Read the files, check and score them."""
        place, rules = self.found.place, self.rules
        known = [*known_submissions(rules.root)]
        faults = read_files(self.repository, self.pull.head, place, rules.board, self.work)
        if faults:
            return _refused(self.pull, self.found, faults, self.work)
        checked = rules.check(self.work / place.path, known=known, fetched=True)
        given = checked.submission
        faults = [*checked.errors, *(self._account_errors(given, known) if given else ())]
        if faults or given is None:
            return _refused(self.pull, self.found, faults, self.work)
        # Warnings about others come first: a comment may be cut at its end.
        warnings = [*_team_warnings(given, known), *checked.warnings]
        more = {
            "update": self.repository.resolve(f"{BASE}:{place.path}") is not None,
            "method": given.method,
            "team": given.team,
            "warnings": tuple(_without(line, self.work) for line in warnings),
        }
        if rules.board.archive(place.benchmark):
            self._keep_fetched(checked)
            return _artifact(self.pull, "sealed", self.found, **more)
        return self._scored(checked, given, known, more)

    def _account_errors(self, given: Submission, known: Sequence[Known]) -> Iterator[UserError]:
        """Yield errors of the account that a submission names, and of more entries than it has."""
        place, account = self.found.place, self.pull.account
        if account in self.rules.board.maintainers:
            return
        where = f"{place.path}/{SUBMISSION_FILE}"
        if given.account != account:
            yield RefusedError(
                f"key 'account' is {given.account or 'missing'}, and this pull request is of "
                f"account {account}",
                where=where,
                expected="the account that may change this submission",
                fix=f"write account = {account}",
            )
        table = [one for one in known if one.place.table == place.table and one.place != place]
        own = [one for one in table if one.stated.account == account]
        if len(own) >= self.rules.board.limits.entries:
            yield RefusedError(
                f"this account has {counted(len(own), 'submission')} in this table already",
                where=where,
                expected=f"at most {self.rules.board.limits.entries} that are shown at once",
                fix="withdraw one of them, or put the new version into its folder",
            )

    def _keep_fetched(self, checked: CheckedSubmission) -> None:
        """Keep predictions that came from an address for the job that has no network."""
        found = checked.predictions
        if found is not None and found.is_relative_to(self.rules.data / FETCHED):
            shutil.copytree(found.parent, self.work / FETCHED / found.parent.name)

    def _scored(
        self,
        checked: CheckedSubmission,
        given: Submission,
        known: Sequence[Known],
        more: dict[str, Any],
    ) -> Artifact:
        rescored = rescore(checked, data=self.rules.data, run=self.rules.run)
        more["claimed"] = tuple(_without(line, self.work) for line in rescored.lines)
        more["agrees"] = rescored.agrees
        if rescored.errors:
            return _refused(self.pull, self.found, rescored.errors, self.work, **more)
        home = self.work / "board"
        run = self._run(rescored.evaluation, given, home)
        copied = _copies(run, given, self.found.place, known, home)
        more["warnings"] = (*copied, *more["warnings"])
        result = rescored.evaluation.result
        return _artifact(
            self.pull, "scored", self.found, **more, columns=result.columns, notes=result.notes,
            truth=result.truth.fingerprint,
            **standing_of(self.found.place, home / "runs", self.work / "cache"),
        )  # fmt: skip

    def _run(self, evaluation: Evaluation, given: Submission, home: Path) -> Path:
        """Place it among the runs of the board's submissions, as a merge would."""
        place = self.found.place
        for one in submitted(self.repository, [place.benchmark]):
            if isinstance(one, str) or one.table != place.table:
                continue
            if newest_run(home, one) is None:
                self.branch.export(one, home)
        run = next_run(home, place)
        save(evaluation, run)
        write_facts(run, given, self.pull.head, self.found.tree)
        return run


def _team_warnings(given: Submission, known: Sequence[Known]) -> Iterator[str]:
    """Warn of a team that other accounts alone have submitted for: anybody can write a name."""
    theirs = [one for one in known if one.stated.team == given.team]
    if theirs and given.account not in {one.stated.account for one in theirs}:
        yield (
            f"team {given.team!r} is on the board with {theirs[0].place.folder}, by another "
            "account: the maintainers should know whether this is of the same team"
        )


def _copies(
    run: Path, given: Submission, place: Place, known: Iterable[Known], home: Path
) -> Iterator[str]:
    """Warn of answers that are another team's, whatever file they came in."""
    for one in known:
        other = newest_run(home, one.place)
        if one.stated.team == given.team or one.place == place or other is None:
            continue
        theirs = other / "records.csv"
        if theirs.is_file() and cmp(run / "records.csv", theirs, shallow=False):
            yield (
                f"every record is that of {one.stated.method!r} of team {one.stated.team!r}, in "
                f"{one.place.folder}: these are the same answers"
            )


def _artifact(pull: PullRequest, kind: str, found: Touched | None = None, **more: Any) -> Artifact:
    place = None if found is None else found.place
    return Artifact(
        kind=kind,  # type: ignore[arg-type]
        pull_request=pull.number,
        account=pull.account,
        head=pull.head,
        tree="" if found is None else found.tree,
        **({} if place is None else vars(place)),
        **more,
    )


def _refused(
    pull: PullRequest,
    found: Touched | None,
    faults: Iterable[UserError],
    work: Path,
    **more: Any,
) -> Artifact:
    problems = []
    for fault in faults:
        if isinstance(fault, _OF_BOARD):
            raise fault
        given = problem_of(fault).model_dump()
        problems.append({key: text and _without(text, work) for key, text in given.items()})
    return _artifact(pull, "refused", found, problems=tuple(problems), **more)


def _without(text: str, work: Path) -> str:
    """Return a text without the path of the folder that CI works in."""
    return text.replace(f"{work}/", "").replace(str(work), "")


# --- a sealed truth ---


def score_against_truth(artifact: Artifact, work: Path, rules: Rules, key: Any) -> Artifact:
    """Score a submission that an earlier job has checked, with the key and without network."""
    others = [name for _, name in socket.if_nameindex() if name != "lo"]
    if others:
        raise UsageError(
            f"a sealed truth is not opened while there is a network ({', '.join(others)})",
            fix="run it by `unshare --net`, as the workflow does",
        )
    place = artifact.place
    archive = rules.board.archive(place.benchmark)
    if artifact.kind != "sealed" or archive is None:
        raise SubmissionError("the truth of this benchmark is not sealed", where=place.path)
    if (work / FETCHED).is_dir():
        shutil.copytree(work / FETCHED, rules.data / FETCHED, dirs_exist_ok=True)
    checked = rules.check(work / place.path)
    for error in checked.errors:
        raise error
    try:
        answer = score_sealed(checked, rules.root / archive, key, data=rules.data, run=rules.run)
    except OpenedTruthError as error:
        problem = problem_of(error).model_copy(update={"where": place.path})
        update = {"kind": "refused", "problems": (problem,), "truth": "opened"}
        return artifact.model_copy(update=update)
    return artifact.model_copy(update={"answer": answer, "truth": answer.truth_commitment})


# --- the board's branch ---


@dataclass(frozen=True)
class ScoredPlace:
    """A submission on the board's branch, and a sentence on it; `fault` where it has no score."""

    place: Place
    said: str
    fault: UserError | None = None


def score_merged(remote: str, rules: Rules, out: Path) -> Iterator[ScoredPlace]:
    """Score all submissions on the board's branch without a run that counts.

    A run counts while the submission's files, the protocol and the truth are those of today.
    Against a sealed truth nothing is scored here: the answer from before the merge is the run.
    """
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        repository = Repository.create(work / "board.git", remote)
        repository.fetch({f"refs/heads/{rules.branch}": BASE}, blobs=False, depth=1)
        merged = _Merged(
            repository, DataBranch(work / "data.git", remote), rules, work, out,
            repository.resolve(BASE) or "", time.monotonic() + _FETCHING_S,
        )  # fmt: skip
        (out / "runs").mkdir(parents=True, exist_ok=True)
        found = [*submitted(repository, [one.name for one in rules.board.benchmarks])]
        places = [one for one in found if isinstance(one, Place)]
        for one in found:
            if isinstance(one, Place):
                merged.branch.export(one, out)
            else:
                rules.note(one)
        for place in places:
            try:
                said = merged.score(place)
            except UserError as fault:
                if isinstance(fault, _OF_BOARD):
                    raise
                yield ScoredPlace(place, "", fault)
            else:
                if said:
                    yield ScoredPlace(place, said)


@dataclass(frozen=True)
class _Merged:
    """The board's branch, and where runs are written."""

    repository: Repository
    branch: DataBranch
    rules: Rules
    work: Path
    out: Path
    commit: str
    until: float

    def score(self, place: Place) -> str:
        """Write a run if none counts, and return a sentence on what was done."""
        tree = self.repository.resolve(f"{self.commit}:{place.path}") or ""
        sealed = bool(self.rules.board.archive(place.benchmark))
        last, why = newest_run(self.out, place), ""
        if last is not None and read_run(last / RUN_FILE).tree == tree:
            measured = measure_of(last)
            now = measure_now(measured.protocol, self.rules.data, sealed=sealed)
            why = measured.outdated(now)
            if not why:
                return ""
            if sealed:
                return f"not scored again: {why}; a new commit of the submission is a try at it"
        checked = self._checked(place)
        assert checked.submission is not None  # without errors it was read
        run = next_run(self.out, place)
        claimed = None
        if sealed:
            answer = self._answer(place, tree)
            run.mkdir(parents=True)
            (run / ANSWER_FILE).write_bytes(answer)
        else:
            found = rescore(checked, data=self.rules.data, run=self.rules.run)
            if found.errors and found.agrees is None:
                raise found.errors[0]
            save(found.evaluation, run)
            if found.agrees is not None:
                claimed = Claimed(agrees=found.agrees, lines=found.lines)
        write_facts(run, checked.submission, self.commit, tree, claimed)
        return f"scored again: {why}" if why else "scored"

    def _checked(self, place: Place) -> CheckedSubmission:
        """Check a submission once more, beside those that were scored before it."""
        faults = read_files(self.repository, self.commit, place, self.rules.board, self.work)
        if faults:
            raise faults[0]
        earlier = [
            one for one in known_submissions(self.rules.root)
            if one.place != place and newest_run(self.out, one.place)
        ]  # fmt: skip
        alike = [one for one in earlier if one.place.path.casefold() == place.path.casefold()]
        if alike:
            raise SubmissionError(
                f"differs from the folder {alike[0].place.folder} of the board only in case",
                where=place.path,
                fix="choose another name",
            )
        left = max(self.until - time.monotonic(), 1.0) / 2
        folder = self.work / place.path
        checked = self.rules.check(folder, known=earlier, fetched=True, seconds=left)
        for error in checked.errors:
            raise SubmissionError(error.what, where=place.path, fix=error.fix)
        return checked

    def _answer(self, place: Place, tree: str) -> bytes:
        """Return the answer that was given before the merge, to the same files."""
        content = self.branch.read(answer_path(tree))
        if content is None:
            raise SubmissionError(
                "these files were not scored against the sealed truth before they were merged",
                where=place.path,
                fix="revert the merge; merge with `gh pr merge --match-head-commit` after the "
                "comment has the scores",
            )
        answer = SealedAnswer.model_validate_json(content)
        public = find_benchmark(place.benchmark, self.rules.data, sealed=True).file.sealed
        if public is None or answer.truth_commitment != public.commitment:
            raise SubmissionError(
                "these files were scored against an earlier truth, not the one that is sealed now",
                where=place.path,
                fix="let a new commit of the submission be scored",
            )
        return content
