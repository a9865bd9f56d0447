"""What a board shows: the newest version of each submission, plain results, and their history."""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from airzoo_bench.core.errors import SubmissionError, UserError, counted
from airzoo_bench.leaderboard.names import fault_of_file_name
from airzoo_bench.leaderboard.runs import RUN_FILE, Run, read_run
from airzoo_bench.leaderboard.submission import (
    SUBMISSION_FILE,
    PublicSubmission,
    read_public_submission,
)
from airzoo_bench.results.files import records_path, result_paths

__all__ = ["Entry", "Faults", "read_entries", "result_entries", "waiting"]

T = TypeVar("T")
RESULT, ANSWER = "result.json", "answer.json"
_NUMBER = re.compile(r"[1-9][0-9]{0,5}")
_SHOWN = 20


class Faults:
    """What keeps a board from being built, each with its own message."""

    def __init__(self) -> None:
        self.found: list[UserError] = []

    def caught(self, work: Callable[[], T]) -> T | None:
        """Return what something gives, or keep the error of the user that it ends with."""
        try:
            return work()
        except UserError as error:
            self.found.append(error)
            return None

    def refuse(self) -> None:
        """Raise what was found, all in one message."""
        if len(self.found) == 1:
            raise self.found[0]
        if self.found:
            shown = "\n".join(f"- {error}" for error in self.found[:_SHOWN])
            more = len(self.found) - _SHOWN
            rest = f"\n- and {more} more" if more > 0 else ""
            raise SubmissionError(
                f"{counted(len(self.found), 'fault')}, and no board without what they are of:\n"
                f"{shown}{rest}",
                fix="correct or remove each; the board that stands is left as it is",
            )


@dataclass(frozen=True)
class Entry:
    """A version of a submission, or a plain result.

    Attributes
    ----------
    name : str
        The submission's folder; of a plain result empty until its method is known.
    number : int
        Of the version.
    place : str
        ``runs/<benchmark>/<track>/<folder>/<number>``; empty for a plain result.
    file : Path
        ``result.json`` or ``answer.json``.
    digest : str
        Of everything that is read of it.
    older : tuple of Entry
        Its earlier versions, the newest first.
    """

    name: str
    number: int
    place: str
    file: Path
    submission: PublicSubmission | None
    run: Run | None
    digest: str
    older: tuple[Entry, ...] = field(default=())

    @property
    def sealed(self) -> bool:
        """Whether it was scored against a sealed truth."""
        return self.file.name == ANSWER

    @property
    def scored(self) -> str | None:
        """The date of scoring, where it is known."""
        return None if self.run is None else self.run.scored.date().isoformat()

    @property
    def measured_seconds_per_query(self) -> float | None:
        """What a query took where CI made the predictions itself, or some that score as they do."""
        made = None if self.run is None else self.run.made_again
        if made is None or not (made.same_bytes or made.alike):
            return None
        return made.seconds_per_query


def read_entries(
    runs: Path, faults: Faults, note: Callable[[str], None] = lambda _: None
) -> list[Entry]:
    """Read the newest versions of all submissions, each with its earlier ones."""
    found = []
    for folder in sorted(path for path in runs.glob("*/*/*") if path.is_dir()):
        versions = [faults.caught(partial(_entry, runs, one)) for one in _versions(folder, note)]
        if all(versions) and versions:
            newest, *older = [one for one in versions if one is not None]
            found.append(replace(newest, older=tuple(older)))
    return _one_of_each_name(found, note)


def _versions(folder: Path, note: Callable[[str], None]) -> list[Path]:
    """Return the folders of versions, the newest first; all else is noted and skipped."""
    if fault := fault_of_file_name(folder.name):
        note(f"{folder}: no submission, and skipped: {fault}")
        return []
    inside = [path for path in folder.iterdir() if path.is_dir()]
    versions = [path for path in inside if _NUMBER.fullmatch(path.name)]
    for path in inside:
        if path not in versions:
            note(f"{path}: no version of a submission, and skipped")
    if not inside:
        note(f"{folder}: no version of a submission in it, and skipped")
    return sorted(versions, key=lambda path: -int(path.name))


def _one_of_each_name(entries: Sequence[Entry], note: Callable[[str], None]) -> list[Entry]:
    """Leave out folders whose names differ from one that was scored before only in case."""
    first: dict[str, Entry] = {}
    for entry in sorted(entries, key=_first_scored):
        name = entry.place.rpartition("/")[0].casefold()
        if first.setdefault(name, entry) is not entry:
            note(f"{entry.place}: skipped: differs from {first[name].name} only in case")
    shown = {entry.place for entry in first.values()}
    return [entry for entry in entries if entry.place in shown]


def _first_scored(entry: Entry) -> tuple[float, str]:
    versions = (entry, *entry.older)
    return min(one.run.scored.timestamp() for one in versions if one.run), entry.place


def _entry(runs: Path, version: Path) -> Entry:
    files = [version / name for name in (RESULT, ANSWER) if (version / name).is_file()]
    if len(files) != 1:
        raise SubmissionError(
            f"holds {'both' if files else 'neither'} {RESULT} and {ANSWER}".replace(
                "neither result.json and", "neither result.json nor"
            ),
            where=version,
            expected="one of them",
        )
    return Entry(
        version.parent.name,
        int(version.name),
        f"runs/{version.relative_to(runs).as_posix()}",
        files[0],
        read_public_submission(version / SUBMISSION_FILE),
        read_run(version / RUN_FILE),
        _digest(files[0], version / SUBMISSION_FILE, version / RUN_FILE),
    )


def result_entries(paths: Sequence[Path]) -> list[Entry]:
    """Return plain results as entries without a submission; see `result_paths`."""
    return [
        Entry("", 1, "", file, None, None, _digest(file)) for file in sorted(result_paths(paths))
    ]


def _digest(file: Path, *others: Path) -> str:
    digest = hashlib.sha256()
    for path in (file, records_path(file), *others):
        content = path.read_bytes() if path.is_file() else b""
        digest.update(len(content).to_bytes(8, "big"))
        digest.update(content)
    return digest.hexdigest()


def waiting(submissions: Path, entries: Sequence[Entry]) -> list[str]:
    """Say which submissions have no run yet, and so no row."""
    known = Counter(
        one.place.split("/", 1)[1].rpartition("/")[0]
        for entry in entries
        for one in (entry, *entry.older)
        if one.place
    )
    folders = [
        path.parent.relative_to(submissions)
        for path in submissions.glob(f"*/*/*/{SUBMISSION_FILE}")
    ]
    names = [one.as_posix() for one in folders if not any(map(fault_of_file_name, one.parts))]
    return [
        f"{name} has not been scored yet: no row" for name in sorted(names) if name not in known
    ]
