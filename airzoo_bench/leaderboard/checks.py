"""All checks of the folder of a submission, for the command line and CI alike."""

from __future__ import annotations

import stat
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from airzoo_bench.core.errors import (
    BenchmarkError,
    SubmissionError,
    UserError,
    agreeing,
    counted,
    printable,
)
from airzoo_bench.core.files import sha256_of_tree
from airzoo_bench.core.validation import nearest
from airzoo_bench.evaluation.evaluate import Evaluation, ReadBy, check, evaluate
from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard.board import Board, Limits, Place, plain_name
from airzoo_bench.leaderboard.fetching import fetch, parse_address
from airzoo_bench.leaderboard.submission import (
    EARLIER_KEYS,
    SUBMISSION_FILE,
    Submission,
    read_submission,
    skeleton,
)
from airzoo_bench.protocol.model import find_protocol
from airzoo_bench.results.result import Result

MOST_FILES = 2000
"""The most files and folders that the folder of a submission may hold."""
FETCHED = "fetched-predictions"
"""The folder in the data root that keeps predictions at an address, by their hash."""
FETCHING_S = 3600.0

_DEPTH = 8  # parts of a path in the folder
_NEAR_PRIOR = 0.01


@dataclass(eq=False)
class CheckedSubmission:
    """A submission's folder, its errors and warnings.

    `submission` is None where submission.toml cannot be read; `predictions` where they are missing,
    not as announced, or were not to be fetched. A submission with any error is refused; warnings
    are for submitter and maintainers.
    """

    folder: Path
    submission: Submission | None = None
    predictions: Path | None = None
    errors: list[UserError] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def score(self, data: Path, run: Run) -> Evaluation:
        """Score a sound submission; an error of its pipeline shows only then."""
        given = self.submission
        if given is None or self.predictions is None:
            raise SubmissionError("no predictions to score", where=self.folder)
        scored = evaluate(
            self.predictions, data=data, protocol=given.protocol, method=given.method, run=run,
            read_by=ReadBy(given.predictions.reader),
        )  # fmt: skip
        check_pipeline(given, scored.result)
        return scored


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
    found = CheckedSubmission(folder)
    place = Place.of_folder(folder)
    try:
        refuse_files(folder, board.limits)
        found.submission = given = read_submission(folder / SUBMISSION_FILE)
        said = [*_check_names(given, place, known), *_told(given, place, known)]
        found.errors += [one for one in said if isinstance(one, UserError)]
        found.warnings += [one for one in said if isinstance(one, str)]
        _check_place(place, given, board, data)
        path = _find_predictions(folder, given, board.limits, data, seconds)
        if path is not None:
            _check_announced(path, given)
            found.predictions = path
            read_by = ReadBy(given.predictions.reader)
            checked = check(path, data=data, protocol=given.protocol, run=run, read_by=read_by)
            found.errors += checked.errors
            found.warnings += checked.notes
    except BenchmarkError as error:
        found.warnings.append(f"predictions were not compared with the benchmark: {error.what}")
    except UserError as error:
        found.errors.append(error)
    return found


# --- files ---


def refuse_files(folder: Path, limits: Limits) -> None:
    """Refuse links and whatever else is no plain file, before any is opened."""
    found = ((path.relative_to(folder), path.lstat()) for path in sorted(folder.rglob("*")))
    check_listing(((p.as_posix(), at.st_mode, at.st_size) for p, at in found), folder, limits)


def check_listing(listing: Iterable[tuple[str, int, int]], where: object, limits: Limits) -> None:
    """Refuse the first fault of the files, by path in the folder, mode and size."""
    names: set[str] = set()
    total = 0
    for path, mode, size in listing:
        total += size * stat.S_ISREG(mode)
        fault = _fault_of_file(path, mode)
        fault = "differs from another name only in case" if path.casefold() in names else fault
        if fault:
            fix = "copy there the file itself, with a name of A-Z, a-z, 0-9, _, . and -"
            raise SubmissionError(fault, where=f"{where}/{printable(path)}", fix=fix)
        names.add(path.casefold())
        if len(names) > MOST_FILES:
            fix = "put the predictions into one archive, such as predictions.zip"
            raise SubmissionError(
                f"more than {MOST_FILES:,} files and folders", where=where, fix=fix
            )
    if total > limits.committed_bytes:
        expected = f"at most {limits.committed_bytes:,} bytes in the repository of this board"
        fix = "publish the predictions, such as on Zenodo, and name them by `submit --url`"
        what = f"its files take {total:,} bytes"
        raise SubmissionError(what, where=where, expected=expected, fix=fix)


def _fault_of_file(path: str, mode: int) -> str:
    parts = path.split("/")
    if not all(map(plain_name, parts)):
        return "the name is not plain"
    if len(parts) > _DEPTH:
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
    given: Submission, place: Place, known: Mapping[Place, Submission]
) -> Iterator[UserError | str]:
    """Yield names that readers would take for another's; look-alikes are told to the reviewer."""
    for at, one in known.items():
        if at == place:
            continue
        whose = f"of team {one.team!r}, in {at.path}"
        for key in ("team", "method"):
            name, other = getattr(given, key), getattr(one, key)
            if name != other and name.casefold() == other.casefold():
                what = f"key '{key}' is {name!r}, which differs from {other!r} only in case"
                yield _wrong(what, f"{key} = {other!r} if it is the same, else another name")
            elif name != other and skeleton(name) == skeleton(other):
                yield f"{key} {name!r} looks like {other!r} {whose}"
        if at[:2] == place[:2]:
            if at.folder.casefold() == place.folder.casefold():
                what = f"differs from the folder {at.folder} of the board only in case"
                yield SubmissionError(what, where=place.path, fix="choose another name")
            if one.method == given.method:
                yield f"{one.method!r} is on this board already, {whose}"
            if one.team != given.team and one.predictions.sha256 == given.predictions.sha256:
                yield f"the predictions are to the last byte those of {one.method!r} {whose}"


def _told(given: Submission, place: Place, known: Mapping[Place, Submission]) -> Iterator[str]:
    """Yield notes on what anybody can write, and on keys of earlier submissions."""
    yield from (f"key '{key}' is ignored" for key in EARLIER_KEYS if key in given.model_fields_set)
    others = [one for at, one in known.items() if at != place]
    accounts = {one.account for one in others if one.team == given.team}
    if accounts and given.account not in accounts:
        yield f"team {given.team!r} is on the board already, by another account"
    if "official" in given.method.casefold() and {one.team for one in others} - {given.team}:
        yield f"method {given.method!r} says that it is official: see whether it is"


def _check_place(place: Place, given: Submission, board: Board, data: Path) -> None:
    """Refuse a protocol by which the board does not score at the folder's place."""
    benchmarks = {one.name: one.protocols for one in board.benchmarks}
    protocols = (find_protocol(name, data) for name in benchmarks.get(place.benchmark, ()))
    fitting = [one.name for one in protocols if one.track == place.track and place.is_plain]
    if given.protocol not in fitting:
        what = f"key 'protocol' is {given.protocol!r}, which does not score {place.path}"
        fix = f"one of {', '.join(fitting or board.protocols)}, in submissions/BENCHMARK/TRACK/NAME"
        raise _wrong(f"{what}{nearest(given.protocol, fitting)}", fix)


# --- predictions ---


def _find_predictions(
    folder: Path, given: Submission, limits: Limits, data: Path, seconds: float
) -> Path | None:
    """Return where the predictions lie, once they are fetched if they are to be."""
    stated = given.predictions
    if stated.url is None and not (folder / str(stated.file)).exists():
        raise _wrong(f"key 'predictions.file' is {stated.file!r}, which is not there", "copy it")
    if stated.url is None:
        return folder / str(stated.file)
    parse_address(stated.url)  # which is refused without a network too
    if stated.size > limits.url_bytes:
        fix = f"at most {limits.url_bytes:,}, the limit of this board"
        raise _wrong(f"key 'predictions.bytes' is {stated.size:,}", fix)
    home = data / FETCHED / stated.sha256
    if seconds:
        return fetch(stated.url, home, size=stated.size, sha256=stated.sha256, seconds=seconds)
    # A name that begins with a dot is of a file that is being fetched.
    return next(iter(sorted(home.glob("[!.]*"))), None)


def _check_announced(path: Path, given: Submission) -> None:
    """Refuse predictions that are not the announced ones."""
    stated = given.predictions
    sizes, sums = (stated.size, size_of_tree(path)), (stated.sha256, sha256_of_tree(path))
    for key, (announced, there) in (("bytes", sizes), ("sha256", sums)):
        if there != announced:
            what = f"key 'predictions.{key}' is {announced}, but that of {path.name} is {there}"
            raise _wrong(what, f"write {key} = {there}, or put the right predictions there")


def check_pipeline(given: Submission, result: Result) -> None:
    """Refuse predictions that are the prior where the submission does not say so."""
    near = sum(counts.get("near_prior", 0) for counts in result.counts.values())
    total = sum(counts["queries"] for counts in result.counts.values())
    if near > _NEAR_PRIOR * total and "prior" not in given.pipeline.uses:
        raise SubmissionError(
            f"{near:,} of {counted(total, 'pose')} {agreeing(near, 'is', 'are')} the photo's own "
            "prior, which pipeline.uses does not name",
            fix='add "prior" to pipeline.uses, or leave queries without an answer out',
        )
