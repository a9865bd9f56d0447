"""All checks of the folder of a submission, for the command line and CI alike."""

from __future__ import annotations

import stat
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from airzoo_bench.core.errors import BenchmarkError, SubmissionError, UserError, counted, printable
from airzoo_bench.core.files import sha256_of_tree
from airzoo_bench.core.validation import nearest
from airzoo_bench.evaluation.evaluate import Evaluation, check, evaluate
from airzoo_bench.evaluation.predictions import ReadRequest
from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard import submission
from airzoo_bench.leaderboard.board import PLAIN_NAME, Board, Limits, Place
from airzoo_bench.leaderboard.fetching import fetch, parse_address
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, Submission, read_submission
from airzoo_bench.protocol.model import find_protocol
from airzoo_bench.results.result import Result

MOST_FILES = 2000  # and folders in the folder of a submission
FETCHED = "fetched-predictions"  # the folder of the data root with those of an address, by hash
FETCHING_S = 3600.0

_DEPTH = 8  # parts of a path in the folder
_NEAR_PRIOR = 0.01


@dataclass(frozen=True)
class Rules:
    """The rules of a board, and the means to check and score by them."""

    board: Board
    root: Path  # a checkout of the board's own branch
    data: Path  # the folder of benchmark folders
    run: Run
    truths: dict[str, str] = field(default_factory=dict)  # fingerprints that were read, by protocol


@dataclass(eq=False)
class CheckedSubmission:
    """A submission's folder, and its errors and warnings; with any error it is refused."""

    folder: Path
    submission: Submission | None = None  # where it can be read
    predictions: Path | None = None  # where they are as announced, and here
    errors: list[UserError] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    @property
    def sound(self) -> Submission:
        """The submission, if it has no errors; else the first one is raised."""
        for error in self.errors:
            raise type(error)(error.what, where=Place.from_folder(self.folder).path, fix=error.fix)
        assert self.submission is not None  # without errors it was read
        return self.submission

    def score(self, data: Path, run: Run) -> Evaluation:
        """Score a sound submission; an error of its pipeline shows only then."""
        given = self.sound
        if self.predictions is None:
            raise BenchmarkError("the predictions are not here; add --fetch", where=self.folder)
        names: Any = {"protocol": given.protocol, "method": given.method}
        request = ReadRequest(given.predictions.reader)
        scored = evaluate(self.predictions, data=data, **names, run=run, request=request)
        check_pipeline(given, scored.result)
        return scored


def check_submission(
    folder: Path, rules: Rules, known: Mapping[Place, Submission], seconds: float = 0.0
) -> CheckedSubmission:
    """Find all errors of a submission that can be found without scoring it.

    Predictions at an address are fetched within `seconds`, and not where these are 0.
    """
    found, place = CheckedSubmission(folder), Place.from_folder(folder)
    board, data = rules.board, rules.data
    try:
        refuse_files(folder, board.limits)
        found.submission = given = read_submission(folder / SUBMISSION_FILE)
        claims = [*_check_claims(given, place, known)]
        found.warnings += [one for one in claims if isinstance(one, str)]
        found.errors += [one for one in claims if isinstance(one, UserError)]
        benchmarks = {one.name: one.protocols for one in board.benchmarks}
        protocols = (find_protocol(name, data) for name in benchmarks.get(place.benchmark, ()))
        fitting = [one.name for one in protocols if one.track == place.track and place.is_plain]
        if given.protocol not in fitting:
            what = f"key 'protocol' is {given.protocol!r}, which does not score {place.path}"
            fix = f"one of {', '.join(fitting or board.protocols)}, in submissions/BENCHMARK/TRACK"
            raise _wrong(f"{what}{nearest(given.protocol, fitting)}", fix)
        found.predictions = _find_predictions(folder, given, board.limits, data, seconds)
        if (path := found.predictions) is not None:
            request = ReadRequest(given.predictions.reader)
            seen = check(path, data=data, protocol=given.protocol, run=rules.run, request=request)
            found.errors += seen.errors
            found.warnings += seen.notes
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
    names, total = set[str](), 0
    for path, mode, size in listing:
        is_file, parts = stat.S_ISREG(mode), path.split("/")
        total += size * is_file
        is_other = not is_file and not stat.S_ISDIR(mode)
        faults = {
            "the name is not plain": not all(map(PLAIN_NAME.fullmatch, parts)),
            f"lies in more than {_DEPTH} folders": len(parts) > _DEPTH,
            "is no file: a link, a submodule, a pipe or a device": is_other,
            "is an executable file": is_file and bool(mode & stat.S_IXUSR),
            "differs from another name only in case": path.casefold() in names,
        }
        if fault := next((what for what, holds in faults.items() if holds), ""):
            fix = "copy there the file itself, with a name of A-Z, a-z, 0-9, _, . and -"
            raise SubmissionError(fault, where=f"{where}/{printable(path)}", fix=fix)
        names.add(path.casefold())
        if len(names) > MOST_FILES:
            what = f"more than {MOST_FILES:,} files and folders"
            fix = "put the predictions into one archive, such as predictions.zip"
            raise SubmissionError(what, where=where, fix=fix)
    if total > limits.committed_bytes:
        expected = f"at most {limits.committed_bytes:,} bytes in the repository of this board"
        fix = "publish the predictions, such as on Zenodo, and name them by `submit --url`"
        what = f"its files take {total:,} bytes"
        raise SubmissionError(what, where=where, expected=expected, fix=fix)


def size_of_tree(path: Path) -> int:
    """Return the bytes of a file, or of all files of a folder."""
    return sum(one.stat().st_size for one in (path, *path.rglob("*")) if one.is_file())


# --- statements ---


def _wrong(what: str, fix: str) -> SubmissionError:
    return SubmissionError(what, where=SUBMISSION_FILE, fix=fix)


def _check_claims(
    given: Submission, place: Place, known: Mapping[Place, Submission]
) -> Iterator[UserError | str]:
    """Yield names that readers would take for another's, and notes on claims for the reviewer."""
    ignored = (key for key in submission.EARLIER_KEYS if key in given.model_fields_set)
    yield from (f"key '{key}' is ignored" for key in ignored)
    if given.account is None:
        yield "key 'account' is missing: CI takes this from maintainers only; write account = ID"
    others = {at: one for at, one in known.items() if at != place}
    for at, one in others.items():
        is_rival, whose = at[:2] == place[:2], f"of team {one.team!r}, in {at.path}"
        names = {"team": (given.team, one.team), "method": (given.method, one.method)}
        names |= {"folder": (place.folder, at.folder)} if is_rival else {}
        for key, (name, other) in names.items():
            if name != other and name.casefold() == other.casefold():
                what = f"{key} {name!r} differs from {other!r} only in case"
                yield _wrong(what, f"write {other!r} if it is the same, else another name")
            elif name != other and submission.skeleton(name) == submission.skeleton(other):
                yield f"{key} {name!r} looks like {other!r} {whose}"
        if is_rival and one.method == given.method:
            yield f"{one.method!r} is on this board already, {whose}"
        is_copy = one.predictions.sha256 == given.predictions.sha256 and one.team != given.team
        if is_rival and is_copy:
            yield f"the predictions are to the last byte those of {one.method!r} {whose}"
    accounts = {one.account for one in others.values() if one.team == given.team}
    if accounts and given.account not in accounts:
        yield f"team {given.team!r} is on the board already, by another account"
    if "official" in given.method.casefold() and {o.team for o in others.values()} - {given.team}:
        yield f"method {given.method!r} says that it is official: see whether it is"


# --- predictions ---


def _find_predictions(
    folder: Path, given: Submission, limits: Limits, data: Path, seconds: float
) -> Path | None:
    """Return where the announced predictions lie, once they are fetched if they are to be."""
    stated = given.predictions
    path: Path | None = folder / str(stated.file)
    if stated.url is not None:
        parse_address(stated.url)  # which is refused without a network too
        if stated.size > limits.url_bytes:
            fix = f"at most {limits.url_bytes:,}, the limit of this board"
            raise _wrong(f"key 'predictions.bytes' is {stated.size:,}", fix)
        home = data / FETCHED / stated.sha256
        if seconds:
            return fetch(stated.url, home, size=stated.size, sha256=stated.sha256, seconds=seconds)
        # A name that begins with a dot is of a file that is being fetched.
        path = next(iter(sorted(home.glob("[!.]*"))), None)
    elif path is not None and not path.exists():
        raise _wrong(f"key 'predictions.file' is {stated.file!r}, which is not there", "copy it")
    if path is not None:
        there = {"bytes": size_of_tree(path), "sha256": sha256_of_tree(path)}
        announced = {"bytes": stated.size, "sha256": stated.sha256}
        for key in (key for key in there if there[key] != announced[key]):
            what = f"key 'predictions.{key}' is {announced[key]}, but that of {path.name} is "
            fix = f"write {key} = {there[key]}, or put the right predictions there"
            raise _wrong(f"{what}{there[key]}", fix)
    return path


def check_pipeline(given: Submission, result: Result) -> None:
    """Refuse predictions that are the prior where the submission does not say so."""
    near = sum(counts.get("near_prior", 0) for counts in result.counts.values())
    total = sum(counts["queries"] for counts in result.counts.values())
    if near > _NEAR_PRIOR * total and "prior" not in given.pipeline.uses:
        what = f"{near:,} of {counted(total, 'pose')}: the photo's own prior, which pipeline.uses "
        fix = 'add "prior" to pipeline.uses, or leave queries without an answer out'
        raise SubmissionError(f"{what}does not name", fix=fix)
