"""All checks of the folder of a submission, for the command line and CI alike."""

from __future__ import annotations

import datetime
import math
import os
import stat
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import (
    CameraError,
    PredictionError,
    ResultError,
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
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.leaderboard.board import Board, Limits, Place, plain_name
from airzoo_bench.leaderboard.fetching import fetch, parse_address
from airzoo_bench.leaderboard.names import alike, skeleton
from airzoo_bench.leaderboard.submission import (
    CLAIMED_FILE,
    SUBMISSION_FILE,
    Submission,
    read_submission,
)
from airzoo_bench.protocol.lookup import find_protocol
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.results.comparable import check_comparable
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import Result, ScoreColumn, read_result

__all__ = [
    "DEPTH",
    "FETCHED",
    "MOST_FILES",
    "CheckedSubmission",
    "check_claim",
    "check_listing",
    "check_pipeline",
    "check_submission",
    "size_of_tree",
]

MOST_FILES = 2000
"""The most files and folders that the folder of a submission may hold."""
DEPTH = 12
"""The most parts that a path in the repository has."""
FETCHED = "fetched-predictions"
"""The folder in the data root that keeps predictions at an address, by their hash."""

_MOST_CLAIMED_BYTES = 4 << 20  # to read unknown keys takes 150 times their size in memory
_SAME = 1e-9  # scores that differ by no more differ by rounding alone
_MOVED = 1e-3  # the part of a scene's queries that another machine may answer otherwise
_NEAR_PRIOR = 0.01
_SHOWN = 5


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
    claimed: Result | None = None
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
    # Before anything is read: a folder may hold links, or a million files.
    found.take(check_listing(_listing(folder), folder, board.limits))
    if found.errors:
        return found
    try:
        found.submission = submission = read_submission(folder / SUBMISSION_FILE)
    except SubmissionError as error:
        found.errors.append(error)
        return found
    found.take(_check_names(submission, found.place, known))
    found.take(_check_stated(folder, submission))
    found.take(_find_protocol(found, submission, board, data))
    found.take(_find_predictions(found, submission, board.limits, data, seconds))
    found.take(_read_claim(found, submission))
    if found.protocol is not None and found.predictions is not None:
        found.take(_check_predictions(found, found.predictions, data, run))
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
            yield SubmissionError(
                f"more than {MOST_FILES:,} files and folders",
                where=where,
                fix="put the predictions into one archive, such as predictions.zip",
            )
            return
    if total > limits.committed_bytes:
        yield SubmissionError(
            f"its files take {total:,} bytes",
            where=where,
            expected=f"at most {limits.committed_bytes:,} bytes in the repository of this board",
            fix="publish the predictions, such as on Zenodo, and name them by `submit --url`",
        )


def _fault_of_file(path: str, mode: int, names: set[str]) -> str:
    parts = path.split("/")
    if path.casefold() in names:
        return "differs from another name only in case"
    if not all(map(plain_name, parts)):
        return "the name is not plain"
    if len(parts) + 4 > DEPTH:  # submissions, the benchmark, the track and the folder come before
        return f"lies in more than {DEPTH} folders"
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        return "is no file: a link, a submodule, a pipe or a device"
    return "is an executable file" if stat.S_ISREG(mode) and mode & stat.S_IXUSR else ""


def size_of_tree(path: Path) -> int:
    """Return the bytes of a file, or of all files of a folder."""
    files = [path] if path.is_file() else [one for one in path.rglob("*") if one.is_file()]
    return sum(one.stat().st_size for one in files)


# --- statements ---


def _wrong(what: str, expected: str | None = None, fix: str | None = None) -> SubmissionError:
    return SubmissionError(what, where=SUBMISSION_FILE, expected=expected, fix=fix)


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
            yield _wrong(
                f"key '{key}' is {name!r}, which looks like {other!r} on this board",
                "a name that nobody takes for another's",
                f"{key} = {other!r} if it is the same, else another name",
            )
    if "official" in submission.method.casefold() and strangers:
        yield f"method {submission.method!r} says that it is official: see whether it is"
    for at, one in others.items():
        if at[:2] == place[:2]:
            yield from _compare_in_table(submission, one, at.folder)


def _compare_in_table(
    submission: Submission, other: Submission, folder: str
) -> Iterator[UserError | str]:
    by, same_team = f"of team {other.team!r}, in {folder}", other.team == submission.team
    if not same_team and other.predictions.sha256 == submission.predictions.sha256:
        yield f"the predictions are to the last byte those of {other.method!r} {by}"
    if same_team and skeleton(other.method) == skeleton(submission.method):
        yield _wrong(
            f"your team has a method {other.method!r} here already, in {folder}",
            "a name a row",
            f'put the new version into {folder}, or name it such as "{other.method} v2"',
        )
    elif other.method == submission.method:
        yield f"{other.method!r} is on this board already, {by}"


def _check_stated(folder: Path, submission: Submission) -> Iterator[UserError | str]:
    """Yield faults of submission.toml against the day and against the files next to it."""
    given = submission.predictions
    if submission.supersedes is not None:
        yield "key 'supersedes' is ignored: withdraw the earlier submission"
    today = datetime.datetime.now(datetime.UTC).date()
    if submission.date > today + datetime.timedelta(days=1):  # it may be tomorrow elsewhere
        yield _wrong(f"key 'date' is {submission.date}, which is to come", f"such as {today}")
    stated = {SUBMISSION_FILE, CLAIMED_FILE, given.file, given.names}
    strange = sorted(entry.name for entry in folder.iterdir() if entry.name not in stated)
    if strange:
        yield SubmissionError(
            f"holds files that submission.toml does not name: {first_of(strange, noun='entry')}",
            where=folder,
            expected=f"{SUBMISSION_FILE}, the predictions, {CLAIMED_FILE} and the list of names",
            fix="remove them",
        )
    for key, name in (("file", given.file), ("names", given.names)):
        if name is not None and not (folder / name).exists():
            what = f"key 'predictions.{key}' is {name!r}, which is not there"
            raise SubmissionError(what, where=folder, fix="copy it there, or correct the key")


def _find_protocol(
    found: CheckedSubmission, submission: Submission, board: Board, data: Path
) -> Iterator[UserError | str]:
    """Find the protocol, and yield faults of the folder's place."""
    place, benchmarks = found.place, {one.name: one for one in board.benchmarks}
    if place.benchmark not in benchmarks or not place.is_plain:
        raise SubmissionError(
            f"no place for a submission{nearest(place.benchmark, [*benchmarks])}",
            where=place.path,
            expected=f"submissions/BENCHMARK/TRACK/FOLDER, BENCHMARK of {', '.join(benchmarks)}",
            fix="move the folder; `airzoo-bench submit` finds its place",
        )
    protocols = benchmarks[place.benchmark].protocols
    if submission.protocol not in protocols:
        raise _wrong(
            f"key 'protocol' is {submission.protocol!r}, by which this board does not score "
            f"{place.benchmark}{nearest(submission.protocol, [*protocols])}",
            f"one of {', '.join(protocols)}",
            "correct the key, or the folder",
        )
    protocol = find_protocol(submission.protocol, data)
    if (protocol.benchmark, protocol.track) != place[:2]:
        raise _wrong(
            f"key 'protocol' is {protocol.name!r}, of the {protocol.track} track of "
            f"{protocol.benchmark}; the folder is of {place.track} of {place.benchmark}",
            fix="move the folder, or correct the key",
        )
    found.protocol = protocol
    for name in submission.training_data:
        first, second = sorted(one.casefold().replace("_", "-") for one in (name, place.benchmark))
        if first == second or second.startswith(f"{first}-"):
            yield (
                f"the training data {name!r} are, or are of one dataset with, the benchmark "
                f"{place.benchmark}: say in `summary` which part of it was trained on"
            )


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
            raise _wrong(
                f"key 'predictions.bytes' is {given.size:,}",
                f"at most {limits.url_bytes:,}, the limit of this board",
                "write smaller predictions: fewer ranks, half precision, or compressed",
            )
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
                "the file that was announced, to the last byte",
                f"write {key} = {there}, or put the right predictions there",
            )
            return
    found.predictions = path


def _check_predictions(
    found: CheckedSubmission, predictions: Path, data: Path, run: Run
) -> Iterator[UserError | str]:
    """Check the predictions as `airzoo-bench check` does."""
    assert found.protocol is not None
    try:
        checked = check(
            predictions, data=data, protocol=found.protocol.name, run=run, read_by=found.read_by
        )
    except (PredictionError, CameraError, UsageError) as error:
        yield error
        return
    yield from checked.errors
    yield from checked.notes


def check_pipeline(submission: Submission, result: Result) -> UserError | None:
    """Return an error where predictions are the prior and the submission does not say so."""
    near = sum(counts.get("near_prior", 0) for counts in result.counts.values())
    total = sum(counts["queries"] for counts in result.counts.values())
    if near <= _NEAR_PRIOR * total or "prior" in submission.pipeline.uses:
        return None
    return SubmissionError(
        f"{near:,} of {counted(total, 'pose')} {agreeing(near, 'is', 'are')} the photo's own "
        "prior, which pipeline.uses does not name",
        expected='uses = ["prior"] where GPS and gimbal angles are used, also as a fallback',
        fix='add "prior" to pipeline.uses, or leave queries without an answer out',
    )


# --- the claimed result ---


def _read_claim(found: CheckedSubmission, submission: Submission) -> Iterator[UserError]:
    """Read the submitter's own result, and hold it to the submission."""
    path, fix = found.folder / CLAIMED_FILE, "leave it out: CI scores anyway"
    if not path.exists():
        return
    if (size := path.stat().st_size) > _MOST_CLAIMED_BYTES:
        expected = f"at most {_MOST_CLAIMED_BYTES:,}"
        yield SubmissionError(f"has {size:,} bytes", where=path, expected=expected, fix=fix)
        return
    try:
        found.claimed = claimed = read_result(path)
    except ResultError as error:
        yield error
        return
    for what, says, expected in (
        ("protocol", claimed.protocol.name, submission.protocol),
        ("method", claimed.predictions.method, submission.method),
        ("SHA-256", claimed.predictions.sha256, submission.predictions.sha256),
    ):
        if says != expected:
            what = f"its {what} is {says!r}, not {expected!r} as of this submission"
            yield SubmissionError(what, where=path, fix=f"score it again, or {fix}")


def check_claim(claimed: Result, scored: Scored) -> tuple[list[str], UserError | None]:
    """Return the scores that were claimed otherwise, and the error where that is no rounding.

    On another machine max(1, 0.1 %) of a scene's queries may be answered otherwise; a retrieval has
    one score everywhere.
    """
    result = scored.result
    try:
        check_comparable(("claimed", "re-scored"), (claimed, result))
        if {*claimed.scenes} != {*result.scenes} or {*claimed.overall} != {*result.overall}:
            raise ResultError("the claimed result.json is of other scenes or scores")
    except ResultError as error:
        return [f"claimed and re-scored differ: {error.what}"], error
    of_scene = scored.records["scene"].to_numpy(str)
    lines, refused = [], []
    for column in result.columns:
        values = scored.records[column.key].to_numpy(np.float64)
        limits = [_claimable(values[of_scene == s], column, result) for s in result.scenes]
        low, high = np.mean(limits, axis=0)
        says, is_ = claimed.overall[column.key], result.overall[column.key]
        if says != is_ and abs(says - is_) > _SAME:
            lines.append(f"{column.title}: claimed {says:.9g}, re-scored {is_:.9g}")
            if not low - _SAME <= says <= high + _SAME:
                refused.append(lines[-1])
    if not refused:
        return lines, None
    return lines, SubmissionError(
        f"{counted(len(refused), 'score')} of the claimed result.json cannot be found again:\n    "
        + "\n    ".join(refused[:_SHOWN]),
        expected="the scores of these predictions on any machine; docs/submission.md says how near",
        fix="score the predictions of this folder again with `airzoo-bench eval ... --out DIR`, "
        "or leave result.json out: CI scores anyway",
    )


def _claimable(values: Floats, column: ScoreColumn, result: Result) -> tuple[float, float]:
    """Return the limits of a scene's score when some queries are answered otherwise."""
    moved = max(1, int(_MOVED * len(values))) if result.unit == "query" else _MOVED
    moved = 0 if result.track == "retrieval" else moved
    if column.average == "median":
        steps = math.ceil(moved)
        ordered = np.concatenate([np.zeros(steps), np.sort(values), np.full(steps, np.inf)])
        middle = np.array([(len(values) - 1) // 2, len(values) // 2])
        return float(ordered[middle].mean()), float(ordered[middle + 2 * steps].mean())
    largest = 1.0 if column.unit == "share" else float(values.max())
    mean, reach = float(values.mean()), moved * largest / len(values)
    return mean - reach, mean + reach
