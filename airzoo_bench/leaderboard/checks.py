"""All that CI checks of the folder of a submission, for the command line and CI alike."""

from __future__ import annotations

import datetime
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from airzoo_bench.core.errors import (
    CameraError,
    PredictionError,
    ResultError,
    SubmissionError,
    UsageError,
    UserError,
)
from airzoo_bench.core.validation import SAFE_NAME, nearest
from airzoo_bench.evaluation.evaluate import check
from airzoo_bench.evaluation.opening import ReadBy
from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard.baselines import check_baseline
from airzoo_bench.leaderboard.board import Board, BoardBenchmark
from airzoo_bench.leaderboard.known import Known, Place, check_names
from airzoo_bench.leaderboard.names import fault_of_file_name
from airzoo_bench.leaderboard.predictions_given import check_entries, check_folder, find_predictions
from airzoo_bench.leaderboard.submission import (
    CLAIMED_FILE,
    SUBMISSION_FILE,
    Submission,
    read_submission,
)
from airzoo_bench.leaderboard.training_data import training_warnings
from airzoo_bench.protocol.lookup import find_protocol
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.results.result import Result, read_result

__all__ = ["CheckedSubmission", "check_submission"]


_MOST_CLAIMED_BYTES = 4 << 20
"""To read a file of unknown keys takes some 150 times its size in memory."""


@dataclass(eq=False)
class CheckedSubmission:
    """What was found in the folder of a submission.

    Attributes
    ----------
    folder : Path
    place : Place
        Where it stands, by the folder's path.
    submission : Submission or None
        None where submission.toml cannot be read; an error says why.
    benchmark : BoardBenchmark or None
        The board's, where it has one of the folder's name.
    protocol : Protocol or None
        As it is found by its name, where the board is of it.
    predictions : Path or None
        Where the predictions lie on this disk; None where they are not there, are not what was
        announced, or were not to be fetched.
    claimed : Result or None
        The result.json of the submitter.
    errors : list of UserError
        A submission with any is refused.
    warnings : list of str
        What submitter and maintainers must know, and is no error.
    """

    folder: Path
    place: Place
    submission: Submission | None = None
    benchmark: BoardBenchmark | None = None
    protocol: Protocol | None = None
    predictions: Path | None = None
    claimed: Result | None = None
    errors: list[UserError] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    @property
    def read_by(self) -> ReadBy:
        """How the predictions are to be read, for `evaluation`."""
        given = None if self.submission is None else self.submission.predictions
        if given is None:
            return ReadBy()
        return ReadBy(given.reader, None if given.names is None else self.folder / given.names)

    def take(self, found: Iterable[UserError | str]) -> bool:
        """Keep errors and warnings; returns whether there was no error."""
        before = len(self.errors)
        for one in found:
            if isinstance(one, UserError):
                self.errors.append(one)
            else:
                self.warnings.append(one)
        return len(self.errors) == before


def check_submission(
    folder: Path,
    board: Board,
    data: Path,
    *,
    known: Sequence[Known] | None = None,
    fetch: bool = False,
    until: float | None = None,
    run: Run = Run(),  # noqa: B008 - frozen
) -> CheckedSubmission:
    """Find all errors of a submission that can be found without scoring it."""
    checked = CheckedSubmission(folder, Place.of(folder))
    # Before anything is read: what is in a folder may be links, or a million files.
    if not checked.take(check_folder(folder, board.limits)):
        return checked
    try:
        submission = read_submission(folder / SUBMISSION_FILE)
    except SubmissionError as error:
        checked.errors.append(error)
        return checked
    checked.submission = submission
    if submission.supersedes is not None:
        checked.warnings.append("key 'supersedes' is ignored: withdraw the earlier submission")
    if known is not None:
        checked.take(check_names(submission, checked.place, known))
    checked.take(_dated(submission))
    checked.take(check_entries(folder, submission))
    placed = checked.take(_placed(checked, submission, board, data))
    try:
        checked.predictions = find_predictions(
            folder, submission, board.limits, data, fetch=fetch, until=until
        )
    except SubmissionError as error:
        checked.errors.append(error)
    checked.take(_claimed(checked, submission))
    if placed:
        checked.take(training_warnings(submission, checked.place.benchmark, data))
        checked.take(_content(checked, submission, data, run))
    return checked


def _dated(submission: Submission) -> Iterator[UserError]:
    today = datetime.datetime.now(datetime.UTC).date()
    if submission.date > today + datetime.timedelta(days=1):  # it may be tomorrow elsewhere
        yield SubmissionError(
            f"key 'date' is {submission.date}, which is to come",
            where=SUBMISSION_FILE,
            expected=f"the day on which the predictions were made, such as {today}",
            fix="correct the key",
        )


def _placed(
    checked: CheckedSubmission, submission: Submission, board: Board, data: Path
) -> Iterator[UserError | str]:
    """Yield what is wrong with the place of a folder: its benchmark, its track, its name."""
    place = checked.place
    benchmarks = {one.name: one for one in board.benchmarks}
    benchmark = benchmarks.get(place.benchmark)
    is_plain = re.match(SAFE_NAME, place.folder) and not fault_of_file_name(place.folder)
    if benchmark is None or not is_plain:
        yield SubmissionError(
            f"no place for a submission{nearest(place.benchmark, [*benchmarks])}",
            where="/".join(("submissions", place.benchmark, place.track, place.folder)),
            expected="submissions/BENCHMARK/TRACK/FOLDER, with BENCHMARK one of "
            f"{', '.join(benchmarks)}, and FOLDER of letters, digits, dots and hyphens, and no "
            "device of Windows such as con",
            fix="move the folder; `airzoo-bench submission new` finds its place",
        )
        return
    checked.benchmark = benchmark
    if submission.protocol not in benchmark.protocols:
        yield SubmissionError(
            f"key 'protocol' is {submission.protocol!r}, by which this board does not score "
            f"{place.benchmark}{nearest(submission.protocol, list(benchmark.protocols))}",
            where=SUBMISSION_FILE,
            expected=f"one of {', '.join(benchmark.protocols)}",
            fix="correct the key, or the folder",
        )
        return
    protocol = find_protocol(submission.protocol, data)
    if (protocol.benchmark, protocol.track) != (place.benchmark, place.track):
        yield SubmissionError(
            f"key 'protocol' is {protocol.name!r}, of the {protocol.track} track of "
            f"{protocol.benchmark}; the folder is of {place.track} of {place.benchmark}",
            where=SUBMISSION_FILE,
            expected=f"a folder in submissions/{protocol.benchmark}/{protocol.track}",
            fix="move the folder, or correct the key",
        )
        return
    checked.protocol = protocol
    yield from check_baseline(submission, protocol.track)


def _claimed(checked: CheckedSubmission, submission: Submission) -> Iterator[UserError]:
    """Read the submitter's own result, and hold it to what the submission says."""
    path = checked.folder / CLAIMED_FILE
    if not path.exists():
        return
    if (size := path.stat().st_size) > _MOST_CLAIMED_BYTES:
        yield SubmissionError(
            f"has {size:,} bytes",
            where=path,
            expected=f"at most {_MOST_CLAIMED_BYTES:,}, more than a result of this suite takes",
            fix="leave it out: CI scores anyway",
        )
        return
    try:
        claimed = read_result(path)
    except ResultError as error:
        yield error
        return
    checked.claimed = claimed
    protocol = checked.protocol
    pairs = {
        "protocol": (claimed.protocol.name, submission.protocol),
        "method": (claimed.predictions.method, submission.method),
        "SHA-256 of the predictions": (claimed.predictions.sha256, submission.predictions.sha256),
    }
    if protocol is not None:
        pairs["fingerprint of the protocol"] = (claimed.protocol.fingerprint, protocol.fingerprint)
    for what, (says, is_) in pairs.items():
        if says != is_:
            yield SubmissionError(
                f"its {what} is {says!r}",
                where=path,
                expected=f"{is_!r}, as of this submission",
                fix="score these predictions again with `airzoo-bench eval ... --out DIR --method "
                f"{submission.method!r}`, or leave the file out: CI scores anyway",
            )


def _content(
    checked: CheckedSubmission, submission: Submission, data: Path, run: Run
) -> Iterator[UserError | str]:
    """Check the predictions as `airzoo-bench check` does."""
    if checked.predictions is None:
        return
    try:
        found = check(
            checked.predictions,
            data=data,
            protocol=submission.protocol,
            run=run,
            read_by=checked.read_by,
        )
    except (PredictionError, CameraError, UsageError) as error:
        yield _of_submission(error)
        return
    yield from map(_of_submission, found.errors)
    yield from found.notes


def _of_submission(error: UserError) -> UserError:
    """Return a fault as it is mended here, where the protocol is a key and no option."""
    if "--protocol" not in (error.fix or ""):
        return error
    return SubmissionError(
        error.what,
        where=error.where,
        expected=error.expected,
        fix=f"correct key 'protocol' in {SUBMISSION_FILE}, or put the right predictions there",
    )
