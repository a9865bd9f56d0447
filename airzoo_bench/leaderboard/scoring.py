"""Scoring for a board: a pull request, a sealed submission, or all submissions that are merged."""

from __future__ import annotations

import math
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
    check_claim,
    check_pipeline,
    check_submission,
)
from airzoo_bench.leaderboard.comment import Artifact, SceneScores, Standing
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
from airzoo_bench.leaderboard.measured import OVERALL, RESULT_FILE, Entry, read_entries
from airzoo_bench.leaderboard.pull_request import (
    BASE,
    PullRequest,
    Touched,
    fetch_pull_request,
    find_merged,
    find_touched,
    read_files,
)
from airzoo_bench.leaderboard.ranking import alike, headline_first, rank
from airzoo_bench.leaderboard.sealed_scoring import OpenedTruthError, score_sealed
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, Submission, read_submission
from airzoo_bench.protocol.lookup import find_protocol
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import read_result

__all__ = [
    "Rules",
    "answer_path",
    "find_standing",
    "score_against_truth",
    "score_merged",
    "score_pull_request",
    "score_submission",
]

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


def score_submission(
    checked: CheckedSubmission, data: Path, run: Run
) -> tuple[Evaluation, list[str], list[UserError]]:
    """Score a submission; return how its claim differs, and errors that only scores show."""
    given, predictions = checked.submission, checked.predictions
    if given is None or predictions is None:
        fix = "mend the errors of `airzoo-bench submission check`, or add --fetch"
        raise SubmissionError("there are no predictions to score", where=checked.folder, fix=fix)
    scored = evaluate(
        predictions, data=data, protocol=given.protocol, method=given.method, run=run,
        read_by=checked.read_by,
    )  # fmt: skip
    lines: list[str] = []
    refusal: UserError | None = None
    if checked.claimed is not None:
        rescored = Scored(given.method, scored.result, scored.records)
        lines, refusal = check_claim(checked.claimed, rescored)
    errors = [refusal, check_pipeline(given, scored.result)]
    return scored, lines, [error for error in errors if error is not None]


# --- a pull request ---


def score_pull_request(pull: PullRequest, remote: str, rules: Rules, work: Path) -> Artifact:
    """Check a pull request, and score it where the truth is public."""
    about: dict[str, Any] = {
        "pull_request": pull.number,
        "account": pull.account,
        "head": pull.head,
    }
    if pull.base != rules.board.branch:
        return Artifact(kind="nothing", **about)
    repository = Repository.create(work / "pull.git", remote)
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
            return Artifact(kind="nothing", **about)
        about |= found.place._asdict() | {"tree": found.tree, "update": found.update}
        if not found.tree:
            return Artifact(kind="withdrawn", **about)
        about |= _score_touched(pull, repository, branch, found, rules, work)
    except UserError as error:
        about |= {"kind": "refused", "problems": [error]}
    for problem in about.get("problems", ()):
        if isinstance(problem, _OF_BOARD):
            raise problem
    for key in ("problems", "warnings", "claimed"):
        about[key] = tuple(_without(str(text), work) for text in about.get(key, ()))
    return Artifact(**about)


def _without(text: str, work: Path) -> str:
    """Return a text without the path of the folder that CI works in."""
    return text.replace(f"{work}/", "").replace(str(work), "")


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
    scored, facts["claimed"], errors = score_submission(checked, rules.data, rules.run)
    if errors:
        return facts | {"kind": "refused", "problems": errors}
    home = work / "board"
    for other in find_merged(repository, [place.benchmark])[0]:
        if other[:2] == place[:2] and not run_folders(home / other.runs):
            branch.export(other, home)
    run = _next_run(home / place.runs)  # among the runs of the others, as a merge would place it
    save(scored, run)
    write_facts(run, given, pull.head, found.tree)
    facts["warnings"] = [*_copies(run, given, place, known, home), *warnings]
    return facts | {
        "kind": "scored",
        "columns": scored.result.columns,
        "notes": scored.result.notes,
        "truth": scored.result.truth.fingerprint,
        **find_standing(place, home / "runs", work / "cache"),
    }


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
        yield RefusedError(
            f"key 'account' is {given.account or 'missing'}, and this pull request is of account "
            f"{pull.account}",
            where=where,
            fix=f"write account = {pull.account}",
        )
    table = [one for at, one in known.items() if at[:2] == place[:2] and at != place]
    own = sum(one.account == pull.account for one in table)
    if own >= board.limits.entries:
        yield RefusedError(
            f"this account has {counted(own, 'submission')} in this table already",
            where=where,
            expected=f"at most {board.limits.entries} that are shown at once",
            fix="withdraw one of them, or put the new version into its folder",
        )


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
            yield (
                f"every record is that of {one.method!r} of team {one.team!r}, in {at.folder}: "
                "these are the same answers"
            )


def find_standing(place: Place, runs: Path, cache: Path) -> dict[str, Any]:
    """Return the rows of a method and its rank among those of the board, as a build ranks it."""
    cache.mkdir(parents=True, exist_ok=True)
    entries = read_entries(runs, runs / "none", cache, lambda _: None)
    own = next((entry for entry in entries if entry.place == place), None)
    if own is None or own.measured is None:
        raise BoardError(f"no run of {place.path} that can be read: {own.reason if own else ''}")
    measures = own.measured.measures
    members = [e for e in entries if e.measured is not None and e.measured.measures == measures]
    methods, _ = alike(sorted(members, key=lambda one: one.method))
    if own not in methods:  # it is on other queries than the others
        return {"rows": tuple(_rows(own))}
    measured = [one.measured for one in methods if one.measured is not None]
    column, at = headline_first(measured)[0], methods.index(own)
    ranked = rank(measured, column)
    first, last = ranked.ranges[at].tolist()
    others = [n for n in range(len(methods)) if n != at and not ranked.apart[at, n]]
    standing = Standing(
        score=column.title,
        first=first,
        last=last,
        methods=len(methods),
        alike=tuple(sorted(methods[n].method for n in others)),
    )
    return {"rows": tuple(_rows(own)), "standing": standing}


def _rows(own: Entry) -> Iterator[SceneScores]:
    measured, before = own.measured, own.older[0].measured if own.older else None
    assert measured is not None
    known = before.scores if before and before.measures == measured.measures else {}
    parts = {one["id"]: (one["title"], one["queries"]) for one in measured.scenes}
    every = ("average", sum(queries for _, queries in parts.values()))
    for scene, (title, queries) in (parts | {OVERALL: every}).items():
        scores = {}
        for column in measured.score_columns:
            numbers = measured.scores[scene].get(column.key)
            if column.headline and numbers is not None:
                (value, low, high), last = numbers[:3], known.get(scene, {}).get(column.key, [None])
                scores[column.key] = (*map(_finite, (value, low, high, last[0])),)
        yield SceneScores.model_validate({"title": title, "queries": queries, "scores": scores})


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


# --- a sealed truth ---


def score_against_truth(artifact: Artifact, work: Path, rules: Rules, key: Any) -> Artifact:
    """Score a submission that an earlier job has checked, with the key and without network."""
    others = [name for _, name in socket.if_nameindex() if name != "lo"]
    if others:
        what = f"a sealed truth is not opened while there is a network ({', '.join(others)})"
        raise UsageError(what, fix="run it by `unshare --net`, as the workflow does")
    place = artifact.place
    archive = rules.board.archive(place.benchmark)
    if artifact.kind != "sealed" or archive is None:
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
        update = {"kind": "refused", "problems": (str(error),), "truth": "opened"}
        return artifact.model_copy(update=update)
    return artifact.model_copy(update={"answer": answer, "truth": answer.truth_commitment})


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
        repository = Repository.create(work / "board.git", remote)
        repository.fetch({f"refs/heads/{rules.board.branch}": BASE}, blobs=False, depth=1)
        branch = DataBranch(work / "data.git", remote)
        commit = repository.resolve(BASE) or ""
        until = time.monotonic() + _FETCHING_S
        merged = _Merged(repository, branch, rules, work, out, commit, until)
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
            except UserError as fault:
                if isinstance(fault, _OF_BOARD):
                    raise
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
    commit: str
    until: float
    truths: dict[str, str] = field(default_factory=dict)

    def score(self, place: Place, tree: str) -> str:
        """Write a run if none counts, and return a sentence on what was done."""
        sealed = bool(self.rules.board.archive(place.benchmark))
        last = next(iter(run_folders(self.out / place.runs)), None)
        why = "" if last is None else self._outdated(last, sealed=sealed)
        if last is not None and read_run(last).tree == tree and (sealed or not why):
            return why and f"not scored again: {why}; a new commit of the submission is a try at it"
        if faults := read_files(self.repository, self.commit, place, self.rules.board, self.work):
            raise faults[0]
        checked = self._check(place, 0.0)
        given, run = _stated(checked), _next_run(self.out / place.runs)
        if sealed:
            answer = self._read_answer(place, tree)
            run.mkdir(parents=True)
            (run / ANSWER_FILE).write_bytes(answer)
        elif last is not None and not why and _has_same_predictions(last, given):
            if error := check_pipeline(given, read_result(last / RESULT_FILE)):
                raise error
            shutil.copytree(last, run)
        else:
            if checked.predictions is None:
                checked = self._check(place, max(self.until - time.monotonic(), 1.0) / 2)
            scored, _, errors = score_submission(checked, self.rules.data, self.rules.run)
            if errors and checked.claimed is None:
                raise errors[0]
            save(scored, run)
        write_facts(run, given, self.commit, tree)
        return f"scored again: {why}" if why else "scored"

    def _check(self, place: Place, seconds: float) -> CheckedSubmission:
        """Check a submission once more, beside those that were scored before it."""
        earlier = {
            at: one
            for at, one in known_submissions(self.rules.root).items()
            if at != place and run_folders(self.out / at.runs)
        }
        if twin := next(
            (at for at in earlier if at.path.casefold() == place.path.casefold()), None
        ):
            what = f"differs from the folder {twin.folder} of the board only in case"
            raise SubmissionError(what, where=place.path, fix="choose another name")
        folder, board, data = self.work / place.path, self.rules.board, self.rules.data
        checked = check_submission(
            folder, board, data, known=earlier, seconds=seconds, run=self.rules.run
        )
        for error in checked.errors:
            raise SubmissionError(error.what, where=place.path, fix=error.fix)
        return checked

    def _outdated(self, run: Path, *, sealed: bool) -> str:
        """Say what has been replaced since a run; nothing where its scores are comparable."""
        if (run / ANSWER_FILE).is_file():
            answer = read_answer(run)
            name, version = answer.protocol, answer.protocol_version
            marks = answer.protocol_fingerprint, answer.truth_commitment
        else:
            result = read_result(run / RESULT_FILE)
            name, version = result.protocol.name, result.protocol.version
            marks = result.protocol.fingerprint, result.truth.fingerprint
        protocol = find_protocol(name, self.rules.data)
        if version != protocol.version:
            return f"protocol v{version}, now v{protocol.version}"
        if marks[0] != protocol.fingerprint:
            return "other settings of the protocol"
        if name not in self.truths:
            self.truths[name] = (
                _commitment(protocol.benchmark, self.rules.data)
                if sealed
                else truth_fingerprint(read_truths(protocol, self.rules.data)[1])
            )
        return "" if marks[1] == self.truths[name] else "another truth"

    def _read_answer(self, place: Place, tree: str) -> bytes:
        """Return the answer that was given before the merge, to the same files."""
        content = self.branch.read(answer_path(tree))
        if content is None:
            raise SubmissionError(
                "these files were not scored against the sealed truth before they were merged",
                where=place.path,
                fix="revert the merge; merge with `gh pr merge --match-head-commit` after the "
                "comment has the scores",
            )
        truth = SealedAnswer.model_validate_json(content).truth_commitment
        if truth != _commitment(place.benchmark, self.rules.data):
            what = "these files were scored against an earlier truth, not the one sealed now"
            raise SubmissionError(what, where=place.path, fix="let a new commit of it be scored")
        return content


def _stated(checked: CheckedSubmission) -> Submission:
    assert checked.submission is not None  # without errors it was read
    return checked.submission


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
