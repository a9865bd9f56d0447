"""All checks of the folder of a submission, for the command line and CI alike."""

from __future__ import annotations

import datetime
import os
import stat
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from airzoo_bench.core.errors import (
    BenchmarkError,
    CameraError,
    PredictionError,
    SubmissionError,
    UsageError,
    UserError,
    agreeing,
    counted,
    first_of,
)
from airzoo_bench.core.files import sha256_of_tree
from airzoo_bench.core.validation import nearest
from airzoo_bench.evaluation.evaluate import check
from airzoo_bench.evaluation.opening import ReadBy
from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard.board import Board, Limits, Place, plain_name
from airzoo_bench.leaderboard.fetching import fetch, parse_address
from airzoo_bench.leaderboard.submission import (
    CLAIMED_FILE,
    EARLIER_KEYS,
    SUBMISSION_FILE,
    Submission,
    alike,
    read_submission,
    skeleton,
)
from airzoo_bench.protocol.model import Protocol, find_protocol
from airzoo_bench.results.result import Result

MOST_FILES = 2000
"""The most files and folders that the folder of a submission may hold."""
FETCHED = "fetched-predictions"
"""The folder in the data root that keeps predictions at an address, by their hash."""

_DEPTH = 12  # parts of a path in the repository
_NEAR_PRIOR = 0.01


@dataclass(eq=False)
class CheckedSubmission:
    """A submission's folder, its errors and warnings.

    `submission` is None where submission.toml cannot be read; `protocol` where the board does not
    score by it; `predictions` where they are missing, not as announced, or were not to be fetched.
    A submission with any error is refused; warnings are for submitter and maintainers.
    """

    folder: Path
    place: Place
    submission: Submission | None = None
    protocol: Protocol | None = None
    predictions: Path | None = None
    errors: list[UserError] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    @property
    def read_by(self) -> ReadBy:
        """How the predictions are read, for `evaluation`."""
        if self.submission is None:
            return ReadBy()
        given = self.submission.predictions
        return ReadBy(given.reader, None if given.names is None else self.folder / given.names)

    def take(self, found: Iterable[UserError | str]) -> None:
        """Add errors and warnings."""
        try:
            for one in found:
                if isinstance(one, UserError):
                    self.errors.append(one)
                else:
                    self.warnings.append(one)
        except SubmissionError as error:
            self.errors.append(error)


def check_submission(
    folder: Path,
    board: Board,
    data: Path,
    *,
    known: Mapping[Place, Submission],
    seconds: float = 0.0,
    run: Run = Run(),  # noqa: B008 - frozen
) -> CheckedSubmission:
    """Find all errors of a submission that can be found without scoring it.

    Predictions at an address are fetched within `seconds`, and not where these are 0.
    """
    found = CheckedSubmission(folder, Place.of_folder(folder))
    found.take(check_listing(_listing(folder), folder, board.limits))  # before anything is read
    if found.errors:
        return found
    try:
        found.submission = submission = read_submission(folder / SUBMISSION_FILE)
    except SubmissionError as error:
        found.errors.append(error)
        return found
    found.take(_check_names(submission, found.place, known))
    found.take(_check_stated(folder, submission))
    try:
        found.protocol = _find_protocol(found.place, submission, board, data)
    except SubmissionError as error:
        found.errors.append(error)
    found.take(_find_predictions(found, submission, board.limits, data, seconds))
    if found.protocol is None or found.predictions is None:
        return found
    try:
        path, named = found.predictions, submission.protocol
        checked = check(path, data=data, protocol=named, run=run, read_by=found.read_by)
        found.take([*checked.errors, *checked.notes])
    except BenchmarkError as error:
        found.take([f"predictions were not compared with the benchmark: {error.what}"])
    except (PredictionError, CameraError, UsageError) as error:
        found.errors.append(error)
    return found


# --- files ---


def _listing(folder: Path) -> Iterator[tuple[str, int, int]]:
    """Yield path, mode and size of all files and folders; none is opened."""
    pending = [folder]
    while pending:
        for entry in sorted(os.scandir(pending.pop()), key=lambda one: one.name):
            found = entry.stat(follow_symlinks=False)
            size = found.st_size * stat.S_ISREG(found.st_mode)
            yield Path(entry.path).relative_to(folder).as_posix(), found.st_mode, size
            if stat.S_ISDIR(found.st_mode):
                pending.append(Path(entry.path))


def check_listing(
    listing: Iterable[tuple[str, int, int]], where: object, limits: Limits
) -> Iterator[UserError]:
    """Yield the first fault of the files, by path in the folder, mode and size."""
    names: set[str] = set()
    total = 0
    for path, mode, size in listing:
        total += size
        if fault := _fault_of_file(path, mode, names):
            fix = "copy there the file itself, with a name of A-Z, a-z, 0-9, _, . and -"
            shown = "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in path[:200])
            yield SubmissionError(fault, where=f"{where}/{shown}", expected="plain files", fix=fix)
            return
        names.add(path.casefold())
        if len(names) > MOST_FILES:
            fix = "put the predictions into one archive, such as predictions.zip"
            what = f"more than {MOST_FILES:,} files and folders"
            yield SubmissionError(what, where=where, fix=fix)
            return
    if total > limits.committed_bytes:
        expected = f"at most {limits.committed_bytes:,} bytes in the repository of this board"
        fix = "publish the predictions, such as on Zenodo, and name them by `submit --url`"
        what = f"its files take {total:,} bytes"
        yield SubmissionError(what, where=where, expected=expected, fix=fix)


def _fault_of_file(path: str, mode: int, names: set[str]) -> str:
    parts = path.split("/")
    if path.casefold() in names:
        return "differs from another name only in case"
    if not all(map(plain_name, parts)):
        return "the name is not plain"
    if len(parts) + 4 > _DEPTH:  # submissions, the benchmark, the track and the folder come before
        return f"lies in more than {_DEPTH} folders"
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        return "is no file: a link, a submodule, a pipe or a device"
    return "is an executable file" if stat.S_ISREG(mode) and mode & stat.S_IXUSR else ""


def size_of_tree(path: Path) -> int:
    """Return the bytes of a file, or of all files of a folder."""
    files = [path] if path.is_file() else [one for one in path.rglob("*") if one.is_file()]
    return sum(one.stat().st_size for one in files)


# --- statements ---


def _wrong(what: str, fix: str) -> SubmissionError:
    return SubmissionError(what, where=SUBMISSION_FILE, fix=fix)


def _check_names(
    submission: Submission, place: Place, known: Mapping[Place, Submission]
) -> Iterator[UserError | str]:
    """Yield names that readers would take for another's, and predictions that are another's."""
    others = {at: one for at, one in known.items() if at != place}
    strangers = [one for one in others.values() if one.team != submission.team]
    for key, name, taken in (
        ("team", submission.team, [one.team for one in others.values()]),
        ("method", submission.method, [one.method for one in strangers]),
    ):
        if other := next((other for other in taken if alike(name, other)), None):
            fix = f"{key} = {other!r} if it is the same, else another name"
            yield _wrong(f"key '{key}' is {name!r}, which looks like {other!r} on this board", fix)
    if "official" in submission.method.casefold() and strangers:
        yield f"method {submission.method!r} says that it is official: see whether it is"
    for at, one in others.items():
        if at[:2] != place[:2]:
            continue
        by, same_team = f"of team {one.team!r}, in {at.folder}", one.team == submission.team
        if not same_team and one.predictions.sha256 == submission.predictions.sha256:
            yield f"the predictions are to the last byte those of {one.method!r} {by}"
        if same_team and skeleton(one.method) == skeleton(submission.method):
            fix = f"put the new version into {at.folder}, or name it otherwise"
            yield _wrong(f"your team has a method {one.method!r} here already, in {at.folder}", fix)
        elif one.method == submission.method:
            yield f"{one.method!r} is on this board already, {by}"


def _check_stated(folder: Path, submission: Submission) -> Iterator[UserError | str]:
    """Yield faults of submission.toml against the day and against the files next to it."""
    given = submission.predictions
    for key in EARLIER_KEYS:
        if getattr(submission, key) is not None:
            yield f"key '{key}' is ignored"
    today = datetime.datetime.now(datetime.UTC).date()
    if submission.date > today + datetime.timedelta(days=1):  # it may be tomorrow elsewhere
        yield _wrong(f"key 'date' is {submission.date}, which is to come", f"such as {today}")
    stated = {SUBMISSION_FILE, CLAIMED_FILE, given.file, given.names}
    strange = sorted(entry.name for entry in folder.iterdir() if entry.name not in stated)
    if strange:
        what = f"holds files that submission.toml does not name: {first_of(strange, noun='entry')}"
        yield SubmissionError(what, where=folder, fix="remove them")
    for key, name in (("file", given.file), ("names", given.names)):
        if name is not None and not (folder / name).exists():
            what = f"key 'predictions.{key}' is {name!r}, which is not there"
            raise SubmissionError(what, where=folder, fix="copy it there, or correct the key")


def _find_protocol(place: Place, submission: Submission, board: Board, data: Path) -> Protocol:
    """Find the protocol, which is one of the folder's place."""
    benchmarks = {one.name: one for one in board.benchmarks}
    if place.benchmark not in benchmarks or not place.is_plain:
        what = f"no place for a submission{nearest(place.benchmark, [*benchmarks])}"
        expected = f"submissions/BENCHMARK/TRACK/FOLDER, BENCHMARK of {', '.join(benchmarks)}"
        raise SubmissionError(what, where=place.path, expected=expected)
    protocols = benchmarks[place.benchmark].protocols
    if submission.protocol not in protocols:
        near, what = nearest(submission.protocol, [*protocols]), submission.protocol
        what = f"key 'protocol' is {what!r}, by which this board does not score {place.benchmark}"
        raise _wrong(f"{what}{near}", f"one of {', '.join(protocols)}")
    protocol = find_protocol(submission.protocol, data)
    if (protocol.benchmark, protocol.track) != place[:2]:
        raise _wrong(
            f"key 'protocol' is {protocol.name!r}, of the {protocol.track} track of "
            f"{protocol.benchmark}; the folder is of {place.track} of {place.benchmark}",
            "move the folder, or correct the key",
        )
    return protocol


# --- predictions ---


def _find_predictions(
    found: CheckedSubmission, submission: Submission, limits: Limits, data: Path, seconds: float
) -> Iterator[UserError]:
    """Find the predictions, once they are known to be the announced ones."""
    given = submission.predictions
    path = None if given.file is None else found.folder / given.file
    if given.url is not None:
        parse_address(given.url)  # which is refused without a network too
        if given.size > limits.url_bytes:
            fix = f"at most {limits.url_bytes:,}, the limit of this board"
            raise _wrong(f"key 'predictions.bytes' is {given.size:,}", fix)
        home = data / FETCHED / given.sha256
        # A name that begins with a dot is of a file that is being fetched.
        path = next(iter(sorted(home.glob("[!.]*"))), None)
        if seconds:
            path = fetch(given.url, home, size=given.size, sha256=given.sha256, seconds=seconds)
    if path is None or not path.exists():
        return
    for key, announced, measure in (
        ("bytes", given.size, size_of_tree),
        ("sha256", given.sha256, sha256_of_tree),
    ):
        if (there := measure(path)) != announced:
            yield _wrong(
                f"key 'predictions.{key}' is {announced}, but that of {path.name} is {there}",
                f"write {key} = {there}, or put the right predictions there",
            )
            return
    found.predictions = path


def check_pipeline(submission: Submission, result: Result) -> UserError | None:
    """Return an error where predictions are the prior and the submission does not say so."""
    near = sum(counts.get("near_prior", 0) for counts in result.counts.values())
    total = sum(counts["queries"] for counts in result.counts.values())
    if near <= _NEAR_PRIOR * total or "prior" in submission.pipeline.uses:
        return None
    return SubmissionError(
        f"{near:,} of {counted(total, 'pose')} {agreeing(near, 'is', 'are')} the photo's own "
        "prior, which pipeline.uses does not name",
        fix='add "prior" to pipeline.uses, or leave queries without an answer out',
    )
