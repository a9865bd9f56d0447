"""The entries of a board: versions of submissions and plain results, with their numbers.

An entry that cannot be shown has a reason instead, and keeps no other from the board.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from airzoo_bench.core.errors import SubmissionError, UserError
from airzoo_bench.leaderboard.board import Place
from airzoo_bench.leaderboard.measured import Measured, measure
from airzoo_bench.leaderboard.runs import ANSWER_FILE, FAULT_FILE, RUN_FILE, Run, read_run
from airzoo_bench.leaderboard.submission import (
    SUBMISSION_FILE,
    PublicSubmission,
    read_public_submission,
    read_submission,
)
from airzoo_bench.results.files import result_paths

__all__ = ["Entry", "read_entries", "read_results", "waiting"]

Note = Callable[[str], None]
RESULT_FILE = "result.json"
_NUMBER = re.compile(r"[1-9][0-9]{0,5}")


@dataclass(frozen=True, eq=False)
class Entry:
    """A version of a submission, or a plain result.

    `place` is its folder on a board, None of a plain result; `number` that of its version. Where
    `measured` is None, `reason` says why. `older` are the earlier versions that can be shown, the
    newest first.
    """

    place: Place | None
    number: int = 0
    submission: PublicSubmission | None = None
    run: Run | None = None
    measured: Measured | None = None
    reason: str = ""
    older: tuple[Entry, ...] = ()

    @property
    def method(self) -> str:
        """The method's name in tables."""
        if self.submission is not None:
            return self.submission.method
        if self.measured is not None:
            return self.measured.method
        return "" if self.place is None else self.place.folder

    @property
    def scored(self) -> str | None:
        """The date of scoring, where it is known."""
        return None if self.run is None else self.run.scored.date().isoformat()


def read_entries(runs: Path, cache: Path, note: Note) -> list[Entry]:
    """Read the submissions below a folder of runs, each with its earlier versions."""
    found = []
    for folder in sorted(path for path in runs.glob("*/*/*") if path.is_dir()):
        place = Place.of(folder)
        if place.fault:
            note(f"{folder}: no submission, and skipped: {place.fault}")
        elif entry := _newest(folder, place, cache, note):
            found.append(entry)
    return found


def _newest(folder: Path, place: Place, cache: Path, note: Note) -> Entry | None:
    """Return the newest version that can be shown, else the reason why none can."""
    numbers = [path for path in folder.iterdir() if _NUMBER.fullmatch(path.name)]
    ordered = sorted(numbers, key=lambda path: -int(path.name))
    versions = [_version(path, place, cache) for path in ordered]
    reasons = [f"version {one.number}: {one.reason}" for one in versions if one.reason]
    if (folder / FAULT_FILE).is_file():  # CI could not score the files that were merged last
        reasons.insert(0, (folder / FAULT_FILE).read_text(encoding="utf-8").strip())
    for reason in reasons:
        note(f"{place.path}: {reason}")
    shown = [one for one in versions if one.measured is not None]
    if shown:
        why = f"a later version is not shown: {reasons[0]}" if reasons else ""
        return replace(shown[0], older=tuple(shown[1:]), reason=why)
    if not reasons:
        note(f"{folder}: no version of a submission in it, and skipped")
        return None
    stated = versions[0].submission if versions else None
    return Entry(place, submission=stated, reason=reasons[0])


def _version(folder: Path, place: Place, cache: Path) -> Entry:
    entry = Entry(place, int(folder.name))
    try:
        files = [folder / name for name in (RESULT_FILE, ANSWER_FILE) if (folder / name).is_file()]
        entry = replace(entry, submission=read_public_submission(folder / SUBMISSION_FILE))
        if len(files) != 1:
            raise SubmissionError(f"holds {len(files)} of {RESULT_FILE} and {ANSWER_FILE}")
        measured = measure(files[0], cache)
        _check_place(entry, measured)
        entry = replace(entry, run=read_run(folder / RUN_FILE))
    except UserError as error:
        return replace(entry, reason=_reason(error))
    return replace(entry, measured=measured)


def _check_place(entry: Entry, measured: Measured) -> None:
    """Refuse numbers that are not of the folder, or of the protocol, that they are shown as."""
    assert entry.place is not None
    assert entry.submission is not None
    if entry.place.table != (measured.benchmark, measured.track):
        raise SubmissionError(f"is of {measured.benchmark} ({measured.track})")
    if entry.submission.protocol != measured.protocol:
        stated = entry.submission.protocol
        raise SubmissionError(f"scored by {measured.protocol}, but submitted for {stated}")


def _reason(error: UserError) -> str:
    """Return what is wrong in one line, with the name of the file but not where it lies."""
    where = "" if error.where is None else f"{Path(error.where).name}: "
    return f"{where}{error.what}".replace("\n", " ")


def read_results(paths: Sequence[Path], cache: Path) -> list[Entry]:
    """Measure plain results, as `table` takes them; a fault of one is the user's own."""
    return [Entry(None, measured=measure(file, cache)) for file in sorted(result_paths(paths))]


def waiting(submissions: Path, entries: Sequence[Entry]) -> list[Entry]:
    """Return the submissions that have no run yet."""
    known = {entry.place for entry in entries}
    found = []
    for path in sorted(submissions.glob(f"*/*/*/{SUBMISSION_FILE}")):
        place = Place.of(path.parent)
        if place in known or place.fault:
            continue
        try:
            stated = read_submission(path).public()
        except UserError as error:
            found.append(Entry(place, reason=_reason(error)))
        else:
            found.append(Entry(place, submission=stated, reason="not scored yet"))
    return found
