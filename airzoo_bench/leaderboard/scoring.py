"""Scoring for a board: a pull request, or all submissions on the board's branch."""

from __future__ import annotations

import shutil
import socket
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
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
from airzoo_bench.evaluation.run_files import save
from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard.answer import SealedAnswer
from airzoo_bench.leaderboard.artifact import Artifact, problem_of, without
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
    FAULT_FILE,
    RUN_FILE,
    Claimed,
    measure_now,
    measure_of,
    newest_run,
    next_run,
    read_run,
    write_facts,
)
from airzoo_bench.leaderboard.sealed_scoring import OpenedTruthError, score_sealed
from airzoo_bench.leaderboard.standing import standing_of
from airzoo_bench.leaderboard.submission import (
    SUBMISSION_FILE,
    Submission,
    read_public_submission,
)

__all__ = ["Rules", "answer_path", "score_against_truth", "score_merged", "score_pull_request"]

_OF_BOARD = (BoardError, BenchmarkError, ProtocolError)  # no submitter can put these right
_FETCHING_S = 3600.0


@dataclass(frozen=True)
class Rules:
    """The rules and the means of a board's CI.

    `root` is a checkout of the board's own branch, `branch` the one that submissions are merged
    into, `data` the folder of benchmark folders; `note` takes sentences for the maintainer.
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
        return _score_submission(pull, repository, branch, found, rules, work)
    except UserError as error:
        return _refused(pull, found, [error], work)


def _score_submission(
    pull: PullRequest,
    repository: Repository,
    branch: DataBranch,
    found: Touched,
    rules: Rules,
    work: Path,
) -> Artifact:
    """Read the files of the one submission that a pull request changes, check and score them."""
    place, known = found.place, [*known_submissions(rules.root)]
    if faults := read_files(repository, pull.head, place, rules.board, work):
        return _refused(pull, found, faults, work)
    checked = rules.check(work / place.path, known=known, fetched=True)
    given = checked.submission
    if given is not None:
        checked.errors += _account_errors(given, pull, place, known, rules.board)
    if checked.errors or given is None:
        return _refused(pull, found, checked.errors, work)
    # Warnings about others come first: a comment may be cut at its end.
    warnings = [*_team_warnings(given, known), *checked.warnings]
    more: dict[str, Any] = {
        "update": repository.resolve(f"{BASE}:{place.path}") is not None,
        "method": given.method,
        "team": given.team,
    }
    if rules.board.archive(place.benchmark):
        predictions = checked.predictions
        if predictions is not None and predictions.is_relative_to(rules.data / FETCHED):
            # The job that has no network finds them here.
            shutil.copytree(predictions.parent, work / FETCHED / predictions.parent.name)
        more["warnings"] = tuple(without(line, work) for line in warnings)
        return _artifact(pull, "sealed", found, **more)
    rescored = rescore(checked, data=rules.data, run=rules.run)
    more["claimed"] = tuple(without(line, work) for line in rescored.lines)
    more["agrees"] = rescored.agrees
    if rescored.errors:
        more["warnings"] = tuple(without(line, work) for line in warnings)
        return _refused(pull, found, rescored.errors, work, **more)
    home = work / "board"
    for one in submitted(repository, [place.benchmark]):
        if isinstance(one, Place) and one.table == place.table and newest_run(home, one) is None:
            branch.export(one, home)
    run = next_run(home, place)  # among the runs of the others, as a merge would place it
    save(rescored.evaluation, run)
    write_facts(run, given, pull.head, found.tree)
    warnings = [*_copies(run, given, place, known, home), *warnings]
    result = rescored.evaluation.result
    return _artifact(
        pull,
        "scored",
        found,
        **more,
        warnings=tuple(without(line, work) for line in warnings),
        columns=result.columns,
        notes=result.notes,
        truth=result.truth.fingerprint,
        **standing_of(place, home / "runs", work / "cache"),
    )


def _account_errors(
    given: Submission, pull: PullRequest, place: Place, known: Sequence[Known], board: Board
) -> Iterator[UserError]:
    """Yield errors of the account that a submission names, and of more entries than it has."""
    if pull.account in board.maintainers:
        return
    where = f"{place.path}/{SUBMISSION_FILE}"
    if given.account != pull.account:
        yield RefusedError(
            f"key 'account' is {given.account or 'missing'}, and this pull request is of account "
            f"{pull.account}",
            where=where,
            expected="the account that may change this submission",
            fix=f"write account = {pull.account}",
        )
    table = [one for one in known if one.place.table == place.table and one.place != place]
    own = [one for one in table if one.stated.account == pull.account]
    if len(own) >= board.limits.entries:
        yield RefusedError(
            f"this account has {counted(len(own), 'submission')} in this table already",
            where=where,
            expected=f"at most {board.limits.entries} that are shown at once",
            fix="withdraw one of them, or put the new version into its folder",
        )


def _team_warnings(given: Submission, known: Sequence[Known]) -> Iterator[str]:
    """Warn of a team that other accounts alone have submitted for: anybody can write a name."""
    theirs = [one for one in known if one.stated.team == given.team]
    if theirs and given.account not in {one.stated.account for one in theirs}:
        yield (
            f"team {given.team!r} is on the board with {theirs[0].place.folder}, by another "
            "account: the maintainers should know whether this is of the same team"
        )


def _copies(
    run: Path, given: Submission, place: Place, known: Sequence[Known], home: Path
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
    return Artifact(
        kind=kind,  # type: ignore[arg-type]
        pull_request=pull.number,
        account=pull.account,
        head=pull.head,
        tree="" if found is None else found.tree,
        **({} if found is None else vars(found.place)),
        **more,
    )


def _refused(
    pull: PullRequest,
    found: Touched | None,
    faults: Sequence[UserError],
    work: Path,
    **more: Any,
) -> Artifact:
    for fault in faults:
        if isinstance(fault, _OF_BOARD):
            raise fault
    problems = tuple(problem_of(fault, work) for fault in faults)
    return _artifact(pull, "refused", found, problems=problems, **more)


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
    given = checked.submission
    if given is None or checked.predictions is None:
        raise SubmissionError("there are no predictions to score", where=place.path)
    try:
        answer = score_sealed(
            checked.predictions,
            given.protocol,
            given.method,
            rules.root / archive,
            key,
            data=rules.data,
            read_by=checked.read_by,
            run=rules.run,
            stated=given,
        )
    except OpenedTruthError as error:
        problem = problem_of(error).model_copy(update={"where": place.path})
        update = {"kind": "refused", "problems": (problem,), "truth": "opened"}
        return artifact.model_copy(update=update)
    return artifact.model_copy(update={"answer": answer, "truth": answer.truth_commitment})


# --- the board's branch ---


def score_merged(remote: str, rules: Rules, out: Path) -> Iterator[tuple[Place, str | UserError]]:
    """Score all submissions on the board's branch without a run that counts.

    A run counts while the submission's files, the protocol and the truth are those of today.
    Against a sealed truth nothing is scored here: the answer from before the merge is the run. Of a
    submission that has no score, the error is yielded, and left for the board to show.
    """
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        repository = Repository.create(work / "board.git", remote)
        repository.fetch({f"refs/heads/{rules.branch}": BASE}, blobs=False, depth=1)
        merged = _Merged(
            repository,
            DataBranch(work / "data.git", remote),
            rules,
            work,
            out,
            repository.resolve(BASE) or "",
            time.monotonic() + _FETCHING_S,
        )
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
                runs = out / Path("runs", *place.path.split("/")[1:])
                runs.mkdir(parents=True, exist_ok=True)
                why = str(fault).replace("\n", " ")
                (runs / FAULT_FILE).write_text(f"{why}\n", encoding="utf-8")
                yield place, fault
            else:
                if said:
                    yield place, said


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
        run, claimed = next_run(self.out, place), None
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
            one
            for one in known_submissions(self.rules.root)
            if one.place != place and newest_run(self.out, one.place)
        ]
        for one in earlier:
            if one.place.path.casefold() == place.path.casefold():
                raise SubmissionError(
                    f"differs from the folder {one.place.folder} of the board only in case",
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
