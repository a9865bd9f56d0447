"""All checks of the folder of a submission, for the command line and CI alike."""

from __future__ import annotations

import datetime
import os
import stat
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from airzoo_bench.benchmark.folder import benchmark_folders
from airzoo_bench.core.errors import (
    BenchmarkError,
    CameraError,
    PredictionError,
    ResultError,
    SubmissionError,
    UsageError,
    UserError,
    counted,
    first_of,
)
from airzoo_bench.core.files import sha256_of_tree
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.core.validation import nearest
from airzoo_bench.datasets.geometry_checks.splits import compare_splits, read_footprints
from airzoo_bench.evaluation.evaluate import check
from airzoo_bench.evaluation.opening import ReadBy
from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard.board import Board, Known, Limits, Place
from airzoo_bench.leaderboard.fetching import fetch, parse_address
from airzoo_bench.leaderboard.names import alike, fault_of_file_name, skeleton
from airzoo_bench.leaderboard.submission import (
    CLAIMED_FILE,
    SUBMISSION_FILE,
    Submission,
    read_submission,
)
from airzoo_bench.protocol.lookup import find_protocol, load_protocol, shipped_protocols
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.results.result import Result, read_result

__all__ = [
    "DEPTH",
    "FETCHED",
    "MOST_FILES",
    "RENAME",
    "CheckedSubmission",
    "check_submission",
    "size_of_tree",
    "too_many_files",
]

MOST_FILES = 2000
"""The most files and folders that the folder of a submission may hold."""
DEPTH = 12
"""The most parts that a path in the repository has."""
FETCHED = "fetched-predictions"
"""The folder in the data root that keeps predictions at an address, by their hash."""
RENAME = "give it a name of A-Z, a-z, 0-9, _, . and -"

_MOST_CLAIMED_BYTES = 4 << 20  # to read unknown keys takes 150 times their size in memory
_MAX_RANGE_M = 2000.0  # as `check-split` has it


@dataclass(eq=False)
class CheckedSubmission:
    """The content of a submission's folder, its errors and warnings.

    `submission` is None where submission.toml cannot be read; `protocol` where the board does not
    score by it; `predictions` where they are missing, not as announced, or were not to be fetched.
    A submission with any error is refused; warnings are for submitter and maintainers.
    """

    folder: Path
    place: Place
    submission: Submission | None = None
    protocol: Protocol | None = None
    predictions: Path | None = None
    claimed: Result | None = None
    errors: list[UserError] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    @property
    def read_by(self) -> ReadBy:
        """How the predictions are read, for `evaluation`."""
        given = None if self.submission is None else self.submission.predictions
        if given is None:
            return ReadBy()
        return ReadBy(given.reader, None if given.names is None else self.folder / given.names)

    def take(self, found: Iterable[UserError | str]) -> bool:
        """Keep errors and warnings, and return whether there was no error."""
        before = len(self.errors)
        try:
            for one in found:
                if isinstance(one, UserError):
                    self.errors.append(one)
                else:
                    self.warnings.append(one)
        except SubmissionError as error:
            self.errors.append(error)
        return len(self.errors) == before


def check_submission(
    folder: Path,
    board: Board,
    data: Path,
    *,
    known: Sequence[Known] = (),
    fetched: bool = False,
    seconds: float | None = None,
    run: Run = Run(),  # noqa: B008 - frozen
) -> CheckedSubmission:
    """Find all errors of a submission that can be found without scoring it.

    Predictions at an address are fetched where `fetched` is true, within `seconds`.
    """
    found = CheckedSubmission(folder, Place.of(folder))
    # Before anything is read: a folder may hold links, or a million files.
    if not found.take(_check_files(folder, board.limits)):
        return found
    try:
        found.submission = submission = read_submission(folder / SUBMISSION_FILE)
    except SubmissionError as error:
        found.errors.append(error)
        return found
    found.take(_check_names(submission, found.place, known))
    found.take(_check_stated(folder, submission))
    is_placed = found.take(_check_place(found, submission, board, data))
    time = seconds if fetched else 0
    found.take(_find_predictions(found, submission, board.limits, data, time))
    found.take(_check_claim(found, submission))
    if is_placed:
        found.take(_training_warnings(submission, found.place.benchmark, data))
        found.take(_check_predictions(found, submission, data, run))
    return found


# --- files ---


def _check_files(folder: Path, limits: Limits) -> Iterator[UserError]:
    """Yield what is wrong with the files, whatever they hold; none is opened."""
    count = size = 0
    names: set[str] = set()
    pending = [folder]
    while pending:
        for entry in sorted(os.scandir(pending.pop()), key=lambda one: one.name):
            path, found = Path(entry.path), entry.stat(follow_symlinks=False)
            inner = path.relative_to(folder).as_posix()
            if fault := _fault_of_file(inner, found.st_mode, names):
                fix = RENAME if "name" in fault else "copy there the file itself, not executable"
                yield SubmissionError(fault, where=path, expected="plain files", fix=fix)
                return
            names.add(inner.casefold())
            count, size = count + 1, size + found.st_size * stat.S_ISREG(found.st_mode)
            if count > MOST_FILES:
                yield too_many_files(folder)
                return
            if stat.S_ISDIR(found.st_mode):
                pending.append(path)
    if size > limits.committed_bytes:
        yield SubmissionError(
            f"its files take {size:,} bytes",
            where=folder,
            expected=f"at most {limits.committed_bytes:,} bytes in the repository of this board",
            fix="publish the predictions, such as on Zenodo, and name them by `submit --url`",
        )


def _fault_of_file(inner: str, mode: int, names: set[str]) -> str:
    parts = inner.split("/")
    if inner.casefold() in names:
        return "differs from another name only in case"
    if fault := fault_of_file_name(parts[-1]):
        return fault
    if len(parts) + 4 > DEPTH:  # submissions, the benchmark, the track and the folder come before
        return f"lies in more than {DEPTH} folders"
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        return "a link, a pipe or a device, and no file"
    return "is an executable file" if stat.S_ISREG(mode) and mode & stat.S_IXUSR else ""


def too_many_files(where: object) -> SubmissionError:
    """Return the error of a folder with more files than a submission may have."""
    fix = "put the predictions into one archive, such as predictions.zip, or give their URL"
    return SubmissionError(f"more than {MOST_FILES:,} files and folders", where=where, fix=fix)


# --- statements ---


def _wrong(what: str, expected: str | None = None, fix: str | None = None) -> SubmissionError:
    return SubmissionError(what, where=SUBMISSION_FILE, expected=expected, fix=fix)


def _check_names(
    submission: Submission, place: Place, known: Sequence[Known]
) -> Iterator[UserError | str]:
    """Yield names that readers would take for another's, and predictions that are another's."""
    others = [one for one in known if one.place != place]
    strangers = [one for one in others if one.stated.team != submission.team]
    yield from _alike("team", submission.team, [one.stated.team for one in others])
    yield from _alike("method", submission.method, [one.stated.method for one in strangers])
    if "official" in submission.method.casefold() and strangers:
        yield f"method {submission.method!r} says that it is official: see whether it is"
    for one in others:
        if one.place.table == place.table:
            yield from _same_in_table(submission, one)


def _alike(key: str, name: str, others: Iterable[str]) -> Iterator[UserError]:
    if other := next((other for other in others if alike(name, other)), None):
        yield _wrong(
            f"key '{key}' is {name!r}, which looks like {other!r} on this board",
            "a name that nobody takes for another's",
            f"{key} = {other!r} if it is the same, else another name",
        )


def _same_in_table(submission: Submission, one: Known) -> Iterator[UserError | str]:
    other, folder = one.stated, one.place.folder
    by = f"of team {other.team!r}, in {folder}"
    if other.team != submission.team and other.predictions.sha256 == submission.predictions.sha256:
        yield f"the predictions are to the last byte those of {other.method!r} {by}"
    if skeleton(other.method) != skeleton(submission.method):
        return
    if other.team == submission.team:
        yield _wrong(
            f"your team has a method {other.method!r} here already, in {folder}",
            "a name a row",
            f'put the new version into {folder}, or name it such as "{other.method} v2"',
        )
    elif other.method == submission.method:
        yield f"{other.method!r} is on this board already, {by}"


def _check_stated(folder: Path, submission: Submission) -> Iterator[UserError | str]:
    """Yield what submission.toml says against the day and against the files next to it."""
    given = submission.predictions
    if submission.supersedes is not None:
        yield "key 'supersedes' is ignored: withdraw the earlier submission"
    today = datetime.datetime.now(datetime.UTC).date()
    if submission.date > today + datetime.timedelta(days=1):  # it may be tomorrow elsewhere
        yield _wrong(
            f"key 'date' is {submission.date}, which is to come",
            f"the day on which the predictions were made, such as {today}",
        )
    stated = {SUBMISSION_FILE, CLAIMED_FILE, given.file, given.names}
    strange = sorted(entry.name for entry in folder.iterdir() if entry.name not in stated)
    if strange:
        yield SubmissionError(
            f"holds files that submission.toml does not name: {first_of(strange, noun='entry')}",
            where=folder,
            expected=f"{SUBMISSION_FILE}, the predictions, {CLAIMED_FILE} (optional), and the list "
            "of names where predictions.names gives one",
            fix="remove them",
        )
    for key, name in (("file", given.file), ("names", given.names)):
        if name is not None and not (folder / name).exists():
            yield SubmissionError(
                f"key 'predictions.{key}' is {name!r}, which is not there",
                where=folder,
                expected="a file, or a folder of predictions, next to submission.toml",
                fix="copy it there, or correct the key",
            )


def _check_place(
    found: CheckedSubmission, submission: Submission, board: Board, data: Path
) -> Iterator[UserError]:
    """Yield what is wrong with the place of a folder: its benchmark, its track, its name."""
    place, benchmarks = found.place, {one.name: one for one in board.benchmarks}
    if place.benchmark not in benchmarks or place.fault:
        yield SubmissionError(
            f"no place for a submission{nearest(place.benchmark, [*benchmarks])}",
            where=place.path,
            expected="submissions/BENCHMARK/TRACK/FOLDER, with BENCHMARK one of "
            f"{', '.join(benchmarks)}, and FOLDER a plain name",
            fix="move the folder; `airzoo-bench submit` finds its place",
        )
        return
    protocols = benchmarks[place.benchmark].protocols
    if submission.protocol not in protocols:
        yield _wrong(
            f"key 'protocol' is {submission.protocol!r}, by which this board does not score "
            f"{place.benchmark}{nearest(submission.protocol, list(protocols))}",
            f"one of {', '.join(protocols)}",
            "correct the key, or the folder",
        )
        return
    protocol = find_protocol(submission.protocol, data)
    if (protocol.benchmark, protocol.track) != place.table:
        yield _wrong(
            f"key 'protocol' is {protocol.name!r}, of the {protocol.track} track of "
            f"{protocol.benchmark}; the folder is of {place.track} of {place.benchmark}",
            f"a folder in submissions/{protocol.benchmark}/{protocol.track}",
            "move the folder, or correct the key",
        )
        return
    found.protocol = protocol


# --- predictions ---


def _find_predictions(
    found: CheckedSubmission,
    submission: Submission,
    limits: Limits,
    data: Path,
    seconds: float | None,
) -> Iterator[UserError]:
    """Find the predictions, once they are known to be the announced ones; 0 s fetch nothing."""
    given = submission.predictions
    path = None if given.file is None else found.folder / given.file
    if given.url is not None:
        parse_address(given.url)  # which is refused without a network too
        if given.size > limits.url_bytes:
            yield _wrong(
                f"key 'predictions.bytes' is {given.size:,}",
                f"at most {limits.url_bytes:,}, the limit of this board",
                "write smaller predictions: fewer ranks, half precision, or compressed",
            )
            return
        home = data / FETCHED / given.sha256
        # A name that begins with a dot is of a file that is being fetched.
        path = next(iter(sorted(home.glob("[!.]*"))), None)
        if seconds != 0:
            path = fetch(given.url, home, size=given.size, sha256=given.sha256, seconds=seconds)
    if path is None or not path.exists():
        return
    key, announced, is_ = "bytes", str(given.size), str(size_of_tree(path))
    if announced == is_:
        key, announced, is_ = "sha256", given.sha256, sha256_of_tree(path)
    if announced != is_:
        yield _wrong(
            f"key 'predictions.{key}' is {announced}, but that of {path.name} is {is_}",
            "the file that was announced, to the last byte",
            f"write {key} = {is_}, or put the right predictions there",
        )
        return
    found.predictions = path


def size_of_tree(path: Path) -> int:
    """Return the bytes of a file, or of all files of a folder."""
    files = [path] if path.is_file() else [one for one in path.rglob("*") if one.is_file()]
    return sum(one.stat().st_size for one in files)


def _check_claim(found: CheckedSubmission, submission: Submission) -> Iterator[UserError]:
    """Read the submitter's own result, and hold it to what the submission says."""
    path = found.folder / CLAIMED_FILE
    if not path.exists():
        return
    if (size := path.stat().st_size) > _MOST_CLAIMED_BYTES:
        expected = f"at most {_MOST_CLAIMED_BYTES:,}, more than a result of this suite takes"
        fix = "leave it out: CI scores anyway"
        yield SubmissionError(f"has {size:,} bytes", where=path, expected=expected, fix=fix)
        return
    try:
        found.claimed = claimed = read_result(path)
    except ResultError as error:
        yield error
        return
    used = claimed.protocol
    pairs = {
        "protocol": (used.name, submission.protocol),
        "method": (claimed.predictions.method, submission.method),
        "SHA-256 of the predictions": (claimed.predictions.sha256, submission.predictions.sha256),
    }
    if found.protocol is not None:
        pairs["fingerprint of the protocol"] = (used.fingerprint, found.protocol.fingerprint)
    for what, (says, is_) in pairs.items():
        if says != is_:
            yield SubmissionError(
                f"its {what} is {says!r}",
                where=path,
                expected=f"{is_!r}, as of this submission",
                fix="score these predictions again with `airzoo-bench eval ... --out DIR --method "
                f"{submission.method!r}`, or leave the file out: CI scores anyway",
            )


def _check_predictions(
    found: CheckedSubmission, submission: Submission, data: Path, run: Run
) -> Iterator[UserError | str]:
    """Check the predictions as `airzoo-bench check` does."""
    if found.predictions is None:
        return
    given = {"protocol": submission.protocol, "run": run, "read_by": found.read_by}
    try:
        checked = check(found.predictions, data=data, **given)  # type: ignore[arg-type]
    except (PredictionError, CameraError, UsageError) as error:
        yield error
        return
    yield from checked.errors
    yield from checked.notes


def _training_warnings(submission: Submission, benchmark: str, data: Path) -> Iterator[str]:
    """Warn of training data that are, or may hold, the benchmark's ground."""
    if not submission.training_data:
        return
    here = [*benchmark_folders(data)]
    shipped = [load_protocol(path).benchmark for path in shipped_protocols().values()]
    known = [*dict.fromkeys([*DATASETS.names(), *shipped, *here])]
    for name in submission.training_data:
        if _same_dataset(name, benchmark):
            yield (
                f"the training data {name!r} are, or are of one dataset with, the benchmark "
                f"{benchmark}: say in `summary` which part of it was trained on"
            )
        elif name not in known and (meant := nearest(name, known)):
            yield f"training data {name!r} are no dataset that is known here{meant}"
        if name == benchmark or name not in here or benchmark not in here:
            continue
        try:
            train, test = (read_footprints(data / one, _MAX_RANGE_M) for one in (name, benchmark))
        except BenchmarkError as error:
            yield f"training data {name!r} were not compared with the benchmark: {error.what}"
            continue
        found = compare_splits(train, test)
        if len(found.pairs):
            yield (
                f"training data {name!r} see the ground of {counted(found.tainted, 'test photo')} "
                f"of {len(test.ids):,}: `airzoo-bench check-split {name} {benchmark}` lists them"
            )


def _same_dataset(one: str, other: str) -> bool:
    """Tell whether two ids are alike, or one names a part of the other, such as gta-uav-cross."""
    first, second = sorted((one.casefold().replace("_", "-"), other.casefold().replace("_", "-")))
    return second == first or second.startswith(f"{first}-")
