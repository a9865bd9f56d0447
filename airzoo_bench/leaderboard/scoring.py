"""Scoring for a board: a pull request, a sealed submission, or all submissions that are merged."""

from __future__ import annotations

import shutil
import socket
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
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
from airzoo_bench.core.files import sha256_of_tree
from airzoo_bench.evaluation.evaluate import truth_fingerprint
from airzoo_bench.evaluation.opening import read_truths
from airzoo_bench.evaluation.run_files import save
from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard.board import Board, Place, known_submissions
from airzoo_bench.leaderboard.checks import (
    FETCHED,
    FETCHING_S,
    CheckedSubmission,
    check_pipeline,
    check_submission,
    refuse_files,
)
from airzoo_bench.leaderboard.comment import Found
from airzoo_bench.leaderboard.data_branch import (
    ANSWER_FILE,
    FAULT_FILE,
    RESULT_FILE,
    DataBranch,
    read_facts,
    run_folders,
    write_facts,
)
from airzoo_bench.leaderboard.git import BoardError, RefusedError, Repository
from airzoo_bench.leaderboard.measured import Head, entries_of, head_of, read_answer, read_entries
from airzoo_bench.leaderboard.pull_request import PullRequest, fetch_changed, write_files
from airzoo_bench.leaderboard.sealed_scoring import OpenedTruthError, commitment_of, score_sealed
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, Submission, read_submission
from airzoo_bench.leaderboard.tables import make_table
from airzoo_bench.protocol.model import Protocol, find_protocol
from airzoo_bench.results.result import read_result

_OF_BOARD = (BoardError, BenchmarkError, ProtocolError)  # no submitter can put these right
_SAME = 0.99  # of all records: few methods agree in so many


@dataclass(frozen=True)
class Rules:
    """The rules and the means of a board's CI.

    `root` is a checkout of the board's own branch, `data` the folder of benchmark folders.
    """

    board: Board
    root: Path
    data: Path
    run: Run


def answer_path(tree: str) -> str:
    """Return where the data branch keeps the answer to a sealed submission until it is merged."""
    return f"answers/{tree}.json"


# --- a pull request ---


def score_pull_request(pull: PullRequest, remote: str, rules: Rules, work: Path) -> Found:
    """Check a pull request, and score it where the truth is public."""
    about: dict[str, Any] = {"pull_request": pull.number, "account": pull.account}
    about["head"] = pull.head
    if pull.base != rules.board.branch:
        return Found(**about)
    repository, branch = Repository(work / "pull", remote), DataBranch(work / "data", remote)

    def former_owner(place: Place) -> int | None:
        runs = run_folders(branch.folder / place.runs)
        if not runs:
            return None
        return read_submission(runs[0] / SUBMISSION_FILE, public=True).account or 0

    try:
        found = fetch_changed(repository, pull, rules.board, former_owner)
        if found is None:
            return Found(**about)
        about |= found[0]._asdict()
        if not found[1]:
            return Found(kind="withdrawn", **about)
        write_files(repository, pull.head, found[0], rules.board, work)
        about |= _score_written(found[0], pull, branch, rules, work)
    except _OF_BOARD:
        raise
    except UserError as error:
        about |= {"kind": "refused", "problems": [error]}
    for key in ("problems", "warnings"):  # no path of the folder that CI works in
        texts = [str(text).replace(f"{work}/", "") for text in about.get(key, ())]
        about[key] = tuple(text.replace(str(work), "") for text in texts)
    return Found(**about)


def _score_written(
    place: Place, pull: PullRequest, branch: DataBranch, rules: Rules, work: Path
) -> dict[str, Any]:
    """Check and score the one submission that a pull request changes; return its findings."""
    known, folder = known_submissions(rules.root), work / place.path
    checked = check_submission(
        folder, rules.board, rules.data, known=known, seconds=FETCHING_S, run=rules.run
    )
    given, predictions = checked.submission, checked.predictions
    if given is not None:
        checked.errors += _account_errors(given, pull, place, known, rules.board)
    for error in checked.errors:
        if isinstance(error, _OF_BOARD):
            raise error
    if checked.errors or given is None or predictions is None:
        return {"kind": "refused", "problems": checked.errors}
    tree, warnings = sha256_of_tree(folder), checked.warnings
    facts: dict[str, Any] = {"method": given.method, "team": given.team, "tree": tree}
    if rules.board.archive(place.benchmark):
        if predictions.is_relative_to(rules.data / FETCHED):
            # The job that has no network finds them here.
            shutil.copytree(predictions.parent, work / FETCHED / predictions.parent.name)
        return facts | {"kind": "sealed", "warnings": warnings}
    scored, home = checked.score(rules.data, rules.run), work / "board"
    branch.copy_runs({place, *known}, home)
    run = _next_run(home / place.runs)  # among the runs of the others, as a merge would place it
    save(scored, run)
    write_facts(run, given, tree, None)
    # Warnings about others come first: a comment may be cut at its end.
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


def _copies(
    run: Path, given: Submission, place: Place, known: Mapping[Place, Submission], home: Path
) -> Iterator[str]:
    """Warn of answers that are nearly another team's, whatever file they came in."""
    own = set((run / "records.csv").read_bytes().splitlines())
    for at, one in known.items():
        if one.team == given.team or at[:2] != place[:2]:
            continue
        for records in (path / "records.csv" for path in run_folders(home / at.runs)[:1]):
            theirs = records.read_bytes().splitlines() if records.is_file() else []
            same = sum(line in own for line in theirs) / max(len(own), len(theirs))
            if same >= _SAME:
                who = f"{one.method!r} of team {one.team!r}, in {at.folder}"
                yield f"{100 * same:.4g} % of the records are those of {who}"


def find_standing(place: Place, protocol: Protocol, runs: Path, cache: Path) -> dict[str, Any]:
    """Return the row of a method as a build would show it, and methods too near to tell apart."""
    cache.mkdir(parents=True, exist_ok=True)
    entries = entries_of(read_entries(runs, runs / "none", cache), protocol)
    table, ranks = make_table(protocol, "", entries, cache)
    row = next((one for one in table.rows if one.id == place.folder), None)
    if row is None or row.kind != "re-scored":
        raise BoardError(f"no run of {place.path} that can be read: {row.reason if row else ''}")
    methods = {one.id: one.method for one in table.rows}
    first = ranks[table.scores[0].key]
    own = first.ids.index(place.folder)
    near = [name for n, name in enumerate(first.ids) if n != own and not first.apart[own, n]]
    return {
        "kind": "scored",
        "columns": table.scores,
        "scenes": table.scenes,
        "row": row,
        "ranked": len(first.ids),
        "alike": tuple(sorted(methods[name] for name in near)),
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
    checked = _check(work / place.path, rules, {}, 0.0)
    if sha256_of_tree(checked.folder) != found.tree:
        raise SubmissionError("not the files that the first job has checked", where=place.path)
    try:
        answer = score_sealed(checked, rules.root / archive, key, rules.data, rules.run)
    except OpenedTruthError as error:
        error.where = place.path
        update: dict[str, Any] = {"kind": "refused", "problems": (str(error),), "opened": True}
        return found.model_copy(update=update)
    update = {"answer": answer, "opened": True, "row": answer.row}
    update |= {"columns": answer.columns, "scenes": answer.head.scenes}
    return found.model_copy(update=update)


def _check(
    folder: Path, rules: Rules, known: Mapping[Place, Submission], seconds: float
) -> CheckedSubmission:
    """Check a submission once more, and raise its first error."""
    checked = check_submission(
        folder, rules.board, rules.data, known=known, seconds=seconds, run=rules.run
    )
    for error in checked.errors:
        raise type(error)(error.what, where=Place.of_folder(folder).path, fix=error.fix)
    return checked


# --- the board's branch ---


def score_merged(remote: str, rules: Rules, out: Path) -> Iterator[tuple[Place, str | UserError]]:
    """Score all submissions on the board's branch without a run that counts.

    A run counts while the predictions, the protocol and the truth are those of today. Against a
    sealed truth nothing is scored here: the answer from before the merge is the run. The error of a
    submission without a score is yielded, and left for the board to show.
    """
    folders = sorted(rules.root.resolve().glob("submissions/*/*/*"))
    names = {one.name for one in rules.board.benchmarks}
    places = [
        place
        for place, path in ((Place.of_folder(path), path) for path in folders)
        if place.benchmark in names and path.is_dir() and path.resolve() == path  # and no link
    ]
    truths: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as folder:
        branch = DataBranch(Path(folder), remote)
        (out / "runs").mkdir(parents=True, exist_ok=True)
        branch.copy_runs(places, out)
        for place in places:
            try:
                if said := _score_place(place, branch, rules, out, truths):
                    yield place, said
            except _OF_BOARD:
                raise
            except UserError as fault:
                (out / place.runs).mkdir(parents=True, exist_ok=True)
                why = str(fault).replace("\n", " ")
                (out / place.runs / FAULT_FILE).write_text(f"{why}\n", encoding="utf-8")
                yield place, fault


def _score_place(
    place: Place, branch: DataBranch, rules: Rules, out: Path, truths: dict[str, str]
) -> str:
    """Score a merged submission where no run of it counts, and say what was done."""
    folder, last = rules.root / place.path, next(iter(run_folders(out / place.runs)), None)
    if not place.is_plain or not (folder / SUBMISSION_FILE).is_file():
        return "no submission, and skipped"
    # Which of two alike came first: the one that has a run.
    known = {
        at: one
        for at, one in known_submissions(rules.root).items()
        if at == place or run_folders(out / at.runs)
    }
    refuse_files(folder, rules.board.limits)  # or a hash would follow its links
    sealed = rules.board.archive(place.benchmark) is not None
    tree, counts = sha256_of_tree(folder), last is not None and _counts(last, rules, truths)
    if last is not None and read_facts(last).tree == tree and (sealed or counts):
        return "" if counts else "not scored again by another truth: commit it again to try"
    given = (checked := _check(folder, rules, known, 0.0)).submission
    assert given is not None  # without errors it was read
    run = _next_run(out / place.runs)
    if sealed:
        answer = branch.folder / answer_path(tree)
        if not answer.is_file():
            what = "these files were not scored against the sealed truth before they were merged"
            fix = "revert the merge, and merge as the comment says once it has the scores"
            raise SubmissionError(what, where=place.path, fix=fix)
        if not _is_current(read_answer(answer).head, rules, truths):
            what = "these files were scored against an earlier truth, not the one sealed now"
            raise SubmissionError(what, where=place.path, fix="let a new commit of it be scored")
        run.mkdir(parents=True)
        shutil.copyfile(answer, run / ANSWER_FILE)
    elif last is not None and counts and _has_same_predictions(last, given):
        check_pipeline(given, read_result(last / RESULT_FILE))
        write_facts(last, given, tree, read_facts(last).scored)
        return "new words, the same scores"
    else:
        if checked.predictions is None:
            checked = _check(folder, rules, known, FETCHING_S)
        save(checked.score(rules.data, rules.run), run)
    write_facts(run, given, tree, None)
    return "scored" if last is None or counts else "scored again: another protocol or truth"


def _counts(run: Path, rules: Rules, truths: dict[str, str]) -> bool:
    """Whether a run has the present protocol and truth."""
    answer = run / ANSWER_FILE
    found = (
        read_answer(answer).head if answer.is_file() else head_of(read_result(run / RESULT_FILE))
    )
    return _is_current(found, rules, truths)


def _is_current(head: Head, rules: Rules, truths: dict[str, str]) -> bool:
    protocol, sealed = find_protocol(head.protocol, rules.data), head.sealed
    stated = (head.protocol_version, head.protocol_fingerprint)
    is_sealed = rules.board.archive(head.benchmark) is not None
    if stated != (protocol.version, protocol.fingerprint) or sealed != is_sealed:
        return False
    if head.protocol not in truths:
        truths[head.protocol] = (
            commitment_of(find_benchmark(head.benchmark, rules.data, sealed=True))
            if sealed
            else truth_fingerprint(read_truths(protocol, rules.data)[1])
        )
    return head.truth == truths[head.protocol]


def _has_same_predictions(run: Path, given: Submission) -> bool:
    """Whether a run has the scores of a submission: the same predictions, read alike."""
    before = read_submission(run / SUBMISSION_FILE, public=True)
    one, other = (
        (said.protocol, said.predictions.sha256, said.predictions.reader)
        for said in (before, given)
    )
    return one == other
