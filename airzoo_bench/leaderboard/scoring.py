"""Scoring for a board: a pull request, a sealed submission, or all submissions that are merged."""

from __future__ import annotations

import re
import shutil
import socket
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.benchmark.folder import find_benchmark
from airzoo_bench.core import errors
from airzoo_bench.core.errors import SubmissionError, UsageError, UserError
from airzoo_bench.core.files import sha256_of_tree
from airzoo_bench.evaluation.evaluate import save, truth_fingerprint
from airzoo_bench.evaluation.predictions import read_truths
from airzoo_bench.leaderboard import answers, checks, git
from airzoo_bench.leaderboard.answers import Answer, run_folders
from airzoo_bench.leaderboard.board import Place, known_submissions
from airzoo_bench.leaderboard.checks import FETCHED, CheckedSubmission, Rules, check_submission
from airzoo_bench.leaderboard.comment import Found
from airzoo_bench.leaderboard.git import DataBranch
from airzoo_bench.leaderboard.pictures import draw_pictures
from airzoo_bench.leaderboard.sealing import OpenedTruthError, commitment_of, read_key, score_sealed
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, Submission, read_submission
from airzoo_bench.leaderboard.tables import empty_table, make_table
from airzoo_bench.protocol.model import find_protocol
from airzoo_bench.results.comparison import make_sample, notes_of, score_intervals
from airzoo_bench.results.records import Method, read_records
from airzoo_bench.results.result import ScoreColumn, read_result
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables import breakdown
from airzoo_bench.tables.comparison import describe_intervals

# No submitter can put these right.
_OF_BOARD = (git.BoardError, errors.BenchmarkError, errors.ProtocolError)
# The parts of a submission that its scores depend on.
_INPUTS = attrgetter("protocol", "predictions.sha256", "predictions.reader", "pipeline")
_RESAMPLING = ResamplingConfig()
_SAME = 0.99  # of all records: few methods agree in so many


def _is_current(head: answers.Head, rules: Rules) -> bool:
    """Whether an answer is by the present protocol and truth."""
    protocol = find_protocol(head.protocol, rules.data)
    is_sealed = head.benchmark in rules.board.archives
    stated = (head.protocol_version, head.protocol_fingerprint, head.sealed)
    if stated != (protocol.version, protocol.fingerprint, is_sealed):
        return False
    if head.protocol not in rules.truths:
        rules.truths[head.protocol] = (
            commitment_of(find_benchmark(head.benchmark, rules.data, sealed=True))
            if is_sealed
            else truth_fingerprint(read_truths(protocol, rules.data)[1])
        )
    return head.truth == rules.truths[head.protocol]


def measure(run: Path, tree: str) -> Answer:
    """Take the numbers that a board shows from the result and the records in a run's folder."""
    result = read_result(run / answers.RESULT_FILE)
    records = read_records(run / answers.RESULT_FILE, result)
    method = Method(result.predictions.method, result, records)
    headline = [column for column in result.columns if column.headline]
    found, sample = score_intervals(method, headline, _RESAMPLING), make_sample([method], headline)
    parts = {"": found.overall, **found.groups}
    made = [one for part in parts.values() for one in part]
    about = "".join(describe_intervals(made, _RESAMPLING, result.unit, lead=""))
    limits = {
        (scene, column.key): (one.low, one.high)
        for scene, part in parts.items()
        for column, one in zip(headline, part, strict=False)
    }
    conditions, by_condition = _by_condition(method, headline)
    own: Any = {"kind": "re-scored", "method": method.name, "notes": notes_of(result)}
    floors = (
        answers.make_row(part.overall, part.scenes, kind="floor", method=name, source=part.meaning)
        for name, part in result.references.items()
    )
    return Answer(
        tree=tree,
        scored=answers.now(),
        version=result.versions["airzoo-bench"],
        head=answers.head_of(result),
        columns=result.columns,
        row=answers.make_row(result.overall, result.scenes, limits, **own, conditions=by_condition),
        floors=tuple(floors),
        about_intervals=f"{about}." if about else "No intervals: too few queries or scenes.",
        conditions=conditions,
        groups=tuple((g, v.shape[1]) for g, v in zip(sample.groups, sample.values, strict=True)),
        values=answers.pack(np.concatenate(sample.values, axis=1), "<f8"),
    )


def _by_condition(
    method: Method, scores: Sequence[ScoreColumn]
) -> tuple[tuple[answers.Conditions, ...], dict[str, dict[str, tuple[answers.Number, ...]]]]:
    """Return conditions, and headline scores by their groups."""
    conditions, found = [], {}
    if method.result.unit != "query" or not scores:
        return (), {}
    values = np.array([method.records[score.key].to_numpy(np.float64) for score in scores])
    medians = np.array([score.average == "median" for score in scores])
    for by in breakdown.condition_names(method):
        groups = breakdown.group_records(method.records, by)
        means = breakdown.group_averages(values, medians, groups).tolist()
        labels, counts = tuple(groups.categories), tuple(np.bincount(groups.codes).tolist())
        title = breakdown.condition_title(by)
        conditions.append(answers.Conditions(by=by, title=title, labels=labels, counts=counts))
        found[by] = {
            score.key: tuple(None if np.isnan(one) else one for one in row)
            for score, row in zip(scores, means, strict=True)
        }
    return tuple(conditions), found


def _score_into(run: Path, checked: CheckedSubmission, tree: str, rules: Rules) -> Answer:
    """Score a sound submission into the folder of a run."""
    scored = checked.score(rules.data, rules.run)
    save(scored, run, partial(draw_pictures, scored, rules.run))
    answer = measure(run, tree)
    answers.write_run(run, checked.sound, answer)
    return answer


# --- a pull request ---


def score_pull_request(pull: git.PullRequest, remote: str, rules: Rules, work: Path) -> Found:
    """Check a pull request, and score it where the truth is public."""
    found = Found(pull_request=pull.number, account=pull.account, head=pull.head)
    about: dict[str, Any] = {}
    if pull.base != rules.board.branch:
        return found
    repository = git.Repository(work / "pull", remote)
    branch = DataBranch(work / "data", remote)
    try:
        changed = git.fetch_changed(repository, pull, rules.board, branch.find_owner)
        if changed is None:
            return found
        about = {"place": changed[0], "kind": "withdrawn"}
        if changed[1]:
            git.write_files(repository, pull.head, changed[0], rules.board, work)
            about |= _score_written(changed[0], pull, branch, rules, work)
    except _OF_BOARD:
        raise
    except UserError as error:
        about |= {"kind": "refused", "problems": [error]}
    own = re.compile(f"{re.escape(str(work))}/?")  # the folder that CI works in is not told
    for key in ("problems", "warnings"):
        about[key] = tuple(own.sub("", str(text)) for text in about.get(key, ()))
    return found.model_copy(update=about)


def _score_written(
    place: Place, pull: git.PullRequest, branch: DataBranch, rules: Rules, work: Path
) -> dict[str, Any]:
    """Check and score the one submission that a pull request changes; return its findings."""
    known, folder = known_submissions(rules.root), work / place.path
    checked = check_submission(folder, rules, known, checks.FETCHING_S)
    given, predictions = checked.submission, checked.predictions
    own = given.account if given else pull.account
    if pull.account not in (own, *rules.board.maintainers):
        what = f"key 'account' is {own or 'missing'}, but that of the pull request is "
        fix = f"write account = {pull.account}"
        checked.errors.append(git.RefusedError(f"{what}{pull.account}", where=place.path, fix=fix))
    for fault in (one for one in checked.errors if isinstance(one, _OF_BOARD)):
        raise fault
    if checked.errors or given is None or predictions is None:
        return {"kind": "refused", "problems": checked.errors}
    tree = sha256_of_tree(folder)
    facts: dict[str, Any] = {"method": given.method, "team": given.team, "tree": tree}
    if place.benchmark in rules.board.archives:
        if predictions.is_relative_to(rules.data / FETCHED):
            # The job that has no network finds them here.
            shutil.copytree(predictions.parent, work / FETCHED / predictions.parent.name)
        return facts | {"kind": "sealed", "warnings": checked.warnings}
    home = work / "board"
    branch.copy_runs({place, *known}, home)
    run = answers.next_run(home / place.runs)  # among the runs of the others, as after a merge
    answer = _score_into(run, checked, tree, rules)
    entries = answers.read_entries(home / "runs", home / "none", lambda _, make: make())
    rows = make_table(empty_table(given.protocol, rules.data, ""), entries, work / "cache")["rows"]
    row = answers.Row(**next(row for row in rows if row["id"] == place.folder))
    # Warnings about others come first: a comment may be cut at its end.
    facts["warnings"] = [*_find_copies(run, given, place, known, home), *checked.warnings]
    facts["ranked"] = sum(bool(one["history"]) for one in rows)
    answer = answer.model_copy(update={"row": row, "values": ""})
    return facts | {"kind": "scored", "answer": answer}


def _find_copies(
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


# --- a sealed truth ---


def score_against_truth(found: Found, work: Path, rules: Rules) -> Found:
    """Score a submission that an earlier job has checked, with the key and without network."""
    others = [name for _, name in socket.if_nameindex() if name != "lo"]
    if others:
        what = f"a sealed truth is not opened while there is a network ({', '.join(others)})"
        raise UsageError(what, fix="run it by `unshare --net`, as the workflow does")
    place = found.place
    archive = rules.board.archives.get(place.benchmark) if place else None
    if found.kind != "sealed" or place is None or archive is None:
        raise SubmissionError("the truth of this benchmark is not sealed")
    if (work / FETCHED).is_dir():
        shutil.copytree(work / FETCHED, rules.data / FETCHED, dirs_exist_ok=True)
    checked = check_submission(work / place.path, rules, {})
    if sha256_of_tree(checked.folder) != found.tree:
        raise SubmissionError("not the files that the first job has checked", where=place.path)
    try:
        path, key = rules.root / archive, read_key()
        opened = score_sealed(checked, found.tree, path, key, rules.data, rules.run)
    except OpenedTruthError as error:
        update = {"kind": "refused", "problems": (str(error.inside(place.path)),), "opened": True}
        return found.model_copy(update=update)
    return found.model_copy(update={"answer": opened, "opened": True})


# --- the board's branch ---


def score_merged(remote: str, rules: Rules, out: Path) -> Iterator[tuple[Place, str | UserError]]:
    """Score all merged submissions without a run by today's predictions, protocol and truth.

    Against a sealed truth nothing is scored here: the answer from before the merge is the run. The
    error of a submission without a score is yielded, and left for the board to show.
    """
    names = {one.name for one in rules.board.benchmarks}
    found = sorted(rules.root.resolve().glob("submissions/*/*/*"))
    every = (Place.from_folder(p) for p in found if p.is_dir() and p.resolve() == p)
    places = [place for place in every if place.benchmark in names and place.is_plain]
    with tempfile.TemporaryDirectory() as folder:
        branch = DataBranch(Path(folder), remote)
        (out / "runs").mkdir(parents=True, exist_ok=True)
        branch.copy_runs(places, out)
        for place in places:
            try:
                if said := _score_place(place, branch, rules, out):
                    yield place, said
            except _OF_BOARD:
                raise
            except UserError as fault:
                (out / place.runs).mkdir(parents=True, exist_ok=True)
                why = str(fault).replace("\n", " ")
                (out / place.runs / answers.FAULT_FILE).write_text(f"{why}\n", encoding="utf-8")
                yield place, fault


def _score_place(place: Place, branch: DataBranch, rules: Rules, out: Path) -> str:
    """Score a merged submission where no run of it counts, and say what was done."""
    folder, last = rules.root / place.path, next(iter(run_folders(out / place.runs)), None)
    before = None
    with suppress(UserError):  # an answer that cannot be read does not count
        before = None if last is None else answers.read_answer(last / answers.RUN_FILE)
    checks.refuse_files(folder, rules.board.limits)  # or a hash would follow its links
    tree, sealed = sha256_of_tree(folder), place.benchmark in rules.board.archives
    counts = before is not None and _is_current(before.head, rules)
    if before is not None and before.tree == tree and (sealed or counts):
        return "" if counts else "not scored again by another truth: commit it again to try"
    # Which of two alike came first: the one that has a run.
    every = known_submissions(rules.root).items()
    known = {at: one for at, one in every if at == place or run_folders(out / at.runs)}
    checked, run = check_submission(folder, rules, known), answers.next_run(out / place.runs)
    given = checked.sound
    if sealed:
        path = branch.answer_path(tree)
        answer = answers.read_answer(path) if path.is_file() else None
        if answer is None or not _is_current(answer.head, rules):
            what = "these files were not scored against the sealed truth before they were merged"
            fix = "revert the merge, and merge as the comment says once it has the scores"
            raise SubmissionError(what, where=place.path, fix=fix)
        answers.write_run(run, given, answer)
    elif (
        last
        and before
        and counts
        and _INPUTS(given) == _INPUTS(read_submission(last / SUBMISSION_FILE, public=True))
    ):
        answers.write_run(last, given, before.model_copy(update={"tree": tree}))
        return "new words, the same scores"
    else:
        if checked.predictions is None:
            checked = check_submission(folder, rules, known, checks.FETCHING_S)
        _score_into(run, checked, tree, rules)
    return "scored" if before is None or counts else "scored again: another protocol or truth"
