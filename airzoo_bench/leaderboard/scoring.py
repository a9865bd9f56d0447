"""Scoring for a board: a pull request, a sealed submission, or all submissions that are merged."""

from __future__ import annotations

import shutil
import socket
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
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
from airzoo_bench.evaluation.evaluate import Evaluation, evaluate, truth_fingerprint
from airzoo_bench.evaluation.opening import read_truths
from airzoo_bench.evaluation.run_files import save
from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard.board import Board, Place, known_submissions
from airzoo_bench.leaderboard.checks import (
    FETCHED,
    CheckedSubmission,
    check_pipeline,
    check_submission,
)
from airzoo_bench.leaderboard.comment import Found
from airzoo_bench.leaderboard.data_branch import (
    ANSWER_FILE,
    FAULT_FILE,
    DataBranch,
    SealedAnswer,
    read_answer,
    read_run,
    run_folders,
    write_facts,
)
from airzoo_bench.leaderboard.git import BoardError, RefusedError, Repository
from airzoo_bench.leaderboard.measured import (
    OVERALL,
    RESULT_FILE,
    Row,
    entries_of,
    measure_answer,
    read_entries,
)
from airzoo_bench.leaderboard.pull_request import (
    BASE,
    PullRequest,
    Touched,
    fetch_pull_request,
    find_merged,
    find_touched,
    read_files,
)
from airzoo_bench.leaderboard.sealed_scoring import OpenedTruthError, score_sealed
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, Submission, read_submission
from airzoo_bench.leaderboard.tables import make_table
from airzoo_bench.protocol.model import Protocol, find_protocol
from airzoo_bench.results.result import read_result

_OF_BOARD = (BoardError, BenchmarkError, ProtocolError)  # no submitter can put these right
_FETCHING_S = 3600.0


@dataclass(frozen=True)
class Rules:
    """The rules and the means of a board's CI.

    `root` is a checkout of the board's own branch, `data` the folder of benchmark folders; `note`
    takes sentences for the maintainer.
    """

    board: Board
    root: Path
    data: Path
    run: Run
    note: Callable[[str], None]


def answer_path(tree: str) -> str:
    """Return where the data branch keeps the answer to a sealed submission until it is merged."""
    return f"answers/{tree}.json"


def score_submission(checked: CheckedSubmission, data: Path, run: Run) -> Evaluation:
    """Score a sound submission; an error of its pipeline shows only then."""
    given, predictions = checked.submission, checked.predictions
    if given is None or predictions is None:
        fix = "mend the errors of `airzoo-bench submission check`, or add --fetch"
        raise SubmissionError("there are no predictions to score", where=checked.folder, fix=fix)
    scored = evaluate(
        predictions, data=data, protocol=given.protocol, method=given.method, run=run,
        read_by=checked.read_by,
    )  # fmt: skip
    if error := check_pipeline(given, scored.result):
        raise error
    return scored


# --- a pull request ---


def score_pull_request(pull: PullRequest, remote: str, rules: Rules, work: Path) -> Found:
    """Check a pull request, and score it where the truth is public."""
    about: dict[str, Any] = {"pull_request": pull.number, "account": pull.account}
    about["head"] = pull.head
    if pull.base != rules.board.branch:
        return Found(kind="nothing", **about)
    repository = Repository(work / "pull.git", remote)
    branch = DataBranch(work / "data.git", remote)

    def former_owner(place: Place) -> int | None:
        branch.export(place, work / "board")
        runs = run_folders(work / "board" / place.runs)
        return (
            read_submission(runs[0] / SUBMISSION_FILE, public=True).account or 0 if runs else None
        )

    try:
        fetch_pull_request(repository, pull)
        found = find_touched(repository, pull, rules.board, former_owner)
        if found is None:
            return Found(kind="nothing", **about)
        about |= found.place._asdict() | {"tree": found.tree}
        if not found.tree:
            return Found(kind="withdrawn", **about)
        about |= _score_touched(pull, repository, branch, found, rules, work)
    except _OF_BOARD:
        raise
    except UserError as error:
        about |= {"kind": "refused", "problems": [error]}
    for key in ("problems", "warnings"):  # no path of the folder that CI works in
        texts = [str(text).replace(f"{work}/", "") for text in about.get(key, ())]
        about[key] = tuple(text.replace(str(work), "") for text in texts)
    return Found(**about)


def _score_touched(
    pull: PullRequest,
    repository: Repository,
    branch: DataBranch,
    found: Touched,
    rules: Rules,
    work: Path,
) -> dict[str, Any]:
    """Check and score the one submission that a pull request changes; return its findings."""
    place, known = found.place, known_submissions(rules.root)
    if faults := read_files(repository, pull.head, place, rules.board, work):
        return {"kind": "refused", "problems": faults}
    checked = check_submission(
        work / place.path, rules.board, rules.data, known=known, seconds=_FETCHING_S, run=rules.run
    )
    given = checked.submission
    if given is not None:
        checked.errors += _account_errors(given, pull, place, known, rules.board)
    for error in checked.errors:
        if isinstance(error, _OF_BOARD):
            raise error
    if checked.errors or given is None:
        return {"kind": "refused", "problems": checked.errors}
    # Warnings about others come first: a comment may be cut at its end.
    warnings = [*_team_warnings(given, known), *checked.warnings]
    facts: dict[str, Any] = {"method": given.method, "team": given.team, "warnings": warnings}
    if rules.board.archive(place.benchmark):
        predictions = checked.predictions
        if predictions is not None and predictions.is_relative_to(rules.data / FETCHED):
            # The job that has no network finds them here.
            shutil.copytree(predictions.parent, work / FETCHED / predictions.parent.name)
        return facts | {"kind": "sealed"}
    scored = score_submission(checked, rules.data, rules.run)
    home = work / "board"
    for other in find_merged(repository, [place.benchmark])[0]:
        if other[:2] == place[:2] and not run_folders(home / other.runs):
            branch.export(other, home)
    run = _next_run(home / place.runs)  # among the runs of the others, as a merge would place it
    save(scored, run)
    write_facts(run, given, pull.head, found.tree)
    facts["warnings"] = [*_copies(run, given, place, known, home), *warnings]
    protocol = find_protocol(given.protocol, rules.data)
    return facts | find_standing(place, protocol, home / "runs", work / "cache")


def _next_run(folder: Path) -> Path:
    runs = run_folders(folder)
    return folder / (str(int(runs[0].name) + 1) if runs else "1")


def _account_errors(
    given: Submission,
    pull: PullRequest,
    place: Place,
    known: Mapping[Place, Submission],
    board: Board,
) -> Iterator[UserError]:
    """Yield errors of the account that a submission names, and of more entries than it has."""
    if pull.account in board.maintainers:
        return
    where = f"{place.path}/{SUBMISSION_FILE}"
    if given.account != pull.account:
        what = f"key 'account' is {given.account or 'missing'}, but that of the pull request is "
        fix = f"write account = {pull.account}"
        yield RefusedError(f"{what}{pull.account}", where=where, fix=fix)
    table = [one for at, one in known.items() if at[:2] == place[:2] and at != place]
    own = sum(one.account == pull.account for one in table)
    if own >= board.limits.entries:
        what = f"this account has {counted(own, 'submission')} in this table already"
        yield RefusedError(what, where=where, fix="withdraw one, or put this into its folder")


def _team_warnings(given: Submission, known: Mapping[Place, Submission]) -> Iterator[str]:
    """Warn of a team that other accounts alone have submitted for: anybody can write a name."""
    theirs = {at: one for at, one in known.items() if one.team == given.team}
    if theirs and given.account not in {one.account for one in theirs.values()}:
        yield (
            f"team {given.team!r} is on the board with {next(iter(theirs)).folder}, by another "
            "account: the maintainers should know whether this is of the same team"
        )


def _copies(
    run: Path, given: Submission, place: Place, known: Mapping[Place, Submission], home: Path
) -> Iterator[str]:
    """Warn of answers that are another team's, whatever file they came in."""
    for at, one in known.items():
        runs = run_folders(home / at.runs)
        if one.team == given.team or at == place or not runs:
            continue
        theirs = runs[0] / "records.csv"
        if theirs.is_file() and cmp(run / "records.csv", theirs, shallow=False):
            yield f"every record is that of {one.method!r} of team {one.team!r}, in {at.folder}"


def find_standing(place: Place, protocol: Protocol, runs: Path, cache: Path) -> dict[str, Any]:
    """Return the row of a method as a build would show it, and methods too near to tell apart."""
    cache.mkdir(parents=True, exist_ok=True)
    entries = entries_of(read_entries(runs, runs / "none", cache, lambda _: None), protocol)
    table, ranked = make_table(protocol, "", entries, None)
    row = next((one for one in table.rows if one.id == place.folder), None)
    if row is None or row.kind != "re-scored":
        raise BoardError(f"no run of {place.path} that can be read: {row.reason if row else ''}")
    members = {one.id: one.method for one in table.rows if one.rescored}
    first = ranked[table.scores[0].key]
    own = first.ids.index(place.folder)
    near = [name for n, name in enumerate(first.ids) if n != own and not first.apart[own, n]]
    return {
        "kind": "scored",
        "columns": table.scores,
        "scenes": table.scenes,
        "row": row,
        "ranked": len(first.ids),
        "alike": tuple(sorted(members[name] for name in near)),
        "truth": table.truth,
    }


# --- a sealed truth ---


def score_against_truth(found: Found, work: Path, rules: Rules, key: Any) -> Found:
    """Score a submission that an earlier job has checked, with the key and without network."""
    others = [name for _, name in socket.if_nameindex() if name != "lo"]
    if others:
        what = f"a sealed truth is not opened while there is a network ({', '.join(others)})"
        raise UsageError(what, fix="run it by `unshare --net`, as the workflow does")
    place = found.place
    archive = rules.board.archive(place.benchmark)
    if found.kind != "sealed" or archive is None:
        raise SubmissionError("the truth of this benchmark is not sealed", where=place.path)
    if (work / FETCHED).is_dir():
        shutil.copytree(work / FETCHED, rules.data / FETCHED, dirs_exist_ok=True)
    folder = work / place.path
    checked = check_submission(folder, rules.board, rules.data, known={}, run=rules.run)
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
        error.where = place.path
        update: dict[str, Any] = {"kind": "refused", "problems": (str(error),), "truth": "opened"}
        return found.model_copy(update=update)
    measured = measure_answer(answer)
    row = Row(kind="sealed", method=given.method, scores=measured.scores[OVERALL])
    update = {"answer": answer, "truth": answer.truth_commitment, "row": row}
    update |= {"columns": answer.columns, "scenes": measured.head.scenes}
    return found.model_copy(update=update)


# --- the board's branch ---


def score_merged(remote: str, rules: Rules, out: Path) -> Iterator[tuple[Place, str | UserError]]:
    """Score all submissions on the board's branch without a run that counts.

    A run counts while the submission's files, the protocol and the truth are those of today; where
    only its words have changed, its scores do. Against a sealed truth nothing is scored here: the
    answer from before the merge is the run. The error of a submission without a
    score is yielded, and left for the board to show.
    """
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        repository = Repository(work / "board.git", remote)
        repository.fetch({f"refs/heads/{rules.board.branch}": BASE}, blobs=False, depth=1)
        branch = DataBranch(work / "data.git", remote)
        merged = _Merged(repository, branch, rules, work, out, time.monotonic() + _FETCHING_S)
        (out / "runs").mkdir(parents=True, exist_ok=True)
        places, others = find_merged(repository, [one.name for one in rules.board.benchmarks])
        for other in others:
            rules.note(other)
        for place in places:
            branch.export(place, out)
        for place, tree in places.items():
            try:
                if said := merged.score(place, tree):
                    yield place, said
            except _OF_BOARD:
                raise
            except UserError as fault:
                runs = out / place.runs
                runs.mkdir(parents=True, exist_ok=True)
                why = str(fault).replace("\n", " ")
                (runs / FAULT_FILE).write_text(f"{why}\n", encoding="utf-8")
                yield place, fault


@dataclass(frozen=True)
class _Merged:
    """The board's branch, and the folder of runs."""

    repository: Repository
    branch: DataBranch
    rules: Rules
    work: Path
    out: Path
    until: float
    truths: dict[str, str] = field(default_factory=dict)

    def score(self, place: Place, tree: str) -> str:
        """Write a run if none counts, and return a sentence on what was done."""
        sealed = bool(self.rules.board.archive(place.benchmark))
        commit = self.repository.resolve(BASE) or ""
        last = next(iter(run_folders(self.out / place.runs)), None)
        counts = last is not None and self._counts(last, sealed=sealed)
        if last is not None and read_run(last).tree == tree and (sealed or counts):
            return "" if counts else "not scored again by another truth: commit it again to try"
        if faults := read_files(self.repository, commit, place, self.rules.board, self.work):
            raise faults[0]
        checked = self._check(place, 0.0)
        given, run = checked.submission, _next_run(self.out / place.runs)
        assert given is not None  # without errors it was read
        if sealed:
            answer = self._read_answer(place, tree)
            run.mkdir(parents=True)
            (run / ANSWER_FILE).write_bytes(answer)
        elif last is not None and counts and _has_same_predictions(last, given):
            if error := check_pipeline(given, read_result(last / RESULT_FILE)):
                raise error
            shutil.copytree(last, run)
        else:
            if checked.predictions is None:
                checked = self._check(place, max(self.until - time.monotonic(), 1.0) / 2)
            save(score_submission(checked, self.rules.data, self.rules.run), run)
        write_facts(run, given, commit, tree)
        return "scored" if last is None or counts else "scored again: another protocol or truth"

    def _check(self, place: Place, seconds: float) -> CheckedSubmission:
        """Check a submission once more, beside those that were scored before it."""
        earlier = {
            at: one
            for at, one in known_submissions(self.rules.root).items()
            if at != place and run_folders(self.out / at.runs)
        }
        twin = next((at for at in earlier if at.path.casefold() == place.path.casefold()), None)
        if twin is not None:
            what = f"differs from the folder {twin.folder} of the board only in case"
            raise SubmissionError(what, where=place.path, fix="choose another name")
        folder, board, data = self.work / place.path, self.rules.board, self.rules.data
        checked = check_submission(
            folder, board, data, known=earlier, seconds=seconds, run=self.rules.run
        )
        for error in checked.errors:
            raise SubmissionError(error.what, where=place.path, fix=error.fix)
        return checked

    def _counts(self, run: Path, *, sealed: bool) -> bool:
        """Whether the protocol and truth of a run are those of today."""
        if (run / ANSWER_FILE).is_file():
            answer = read_answer(run)
            name = answer.protocol
            found = answer.protocol_version, answer.protocol_fingerprint, answer.truth_commitment
        else:
            result = read_result(run / RESULT_FILE)
            name, version = result.protocol.name, result.protocol.version
            found = version, result.protocol.fingerprint, result.truth.fingerprint
        protocol, data = find_protocol(name, self.rules.data), self.rules.data
        if found[:2] != (protocol.version, protocol.fingerprint):
            return False
        if name not in self.truths:
            self.truths[name] = (
                _commitment(protocol.benchmark, data)
                if sealed
                else truth_fingerprint(read_truths(protocol, data)[1])
            )
        return found[2] == self.truths[name]

    def _read_answer(self, place: Place, tree: str) -> bytes:
        """Return the answer that was given before the merge, to the same files."""
        content = self.branch.read(answer_path(tree))
        if content is None:
            what = "these files were not scored against the sealed truth before they were merged"
            fix = "revert the merge, and merge as the comment says once it has the scores"
            raise SubmissionError(what, where=place.path, fix=fix)
        truth = SealedAnswer.model_validate_json(content).truth_commitment
        if truth != _commitment(place.benchmark, self.rules.data):
            what = "these files were scored against an earlier truth, not the one sealed now"
            raise SubmissionError(what, where=place.path, fix="let a new commit of it be scored")
        return content


def _commitment(benchmark: str, data: Path) -> str:
    public = find_benchmark(benchmark, data, sealed=True).file.sealed
    return "" if public is None else public.commitment


def _has_same_predictions(run: Path, given: Submission) -> bool:
    """Whether a run has the scores of a submission: the same predictions, read alike."""
    before = read_submission(run / SUBMISSION_FILE, public=True)
    one, two = (
        (s.method, s.protocol, s.predictions.sha256, s.predictions.reader, s.predictions.names)
        for s in (before, given)
    )
    return one == two and given.predictions.names is None  # a list has no hash
