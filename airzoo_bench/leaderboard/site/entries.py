"""What a board shows: the newest version of each submission, plain results, and their history."""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from airzoo_bench.core.errors import SubmissionError, UserError
from airzoo_bench.core.plurals import counted
from airzoo_bench.core.validation import SAFE_NAME
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
        """Raise what was found, all in one message.

        Raises
        ------
        UserError
            The only one, or one that holds the messages of all.
        """
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


def read_entries(runs: Path, faults: Faults) -> list[Entry]:
    """Read the newest versions of all submissions, each with its earlier ones.

    Parameters
    ----------
    runs : Path
        With ``<benchmark>/<track>/<folder>/<number>/``; none where it is missing.
    faults : Faults
        Takes what is wrong with any of them.

    Returns
    -------
    list of Entry
        Sorted by place. What a submission of the same team supersedes is its history.
    """
    found: dict[tuple[str, str], Entry] = {}
    for folder in sorted(path for path in runs.glob("*/*/*") if path.is_dir()):
        versions = [faults.caught(partial(_entry, runs, one)) for one in _versions(folder, faults)]
        if all(versions) and versions:
            newest, *older = [one for one in versions if one is not None]
            table = folder.parent.relative_to(runs).as_posix()
            found[table, folder.name] = replace(newest, older=tuple(older))
    return _superseded(found, faults)


def _versions(folder: Path, faults: Faults) -> list[Path]:
    inside = [path for path in folder.iterdir() if path.is_dir()]
    if not inside or not all(_NUMBER.fullmatch(path.name) for path in inside):
        faults.found.append(
            SubmissionError(
                "holds no versions" if not inside else "holds what is no version",
                where=folder,
                expected="folders 1, 2, ... with result.json and records.csv, or answer.json",
            )
        )
        return []
    if not re.fullmatch(SAFE_NAME, folder.name):
        faults.found.append(SubmissionError("not a plain name", where=folder))
        return []
    return sorted(inside, key=lambda path: -int(path.name))


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


def _superseded(found: dict[tuple[str, str], Entry], faults: Faults) -> list[Entry]:
    """Make submissions that another supersedes the history of that one."""
    heirs: dict[tuple[str, str], tuple[str, str]] = {}
    for (table, name), entry in found.items():
        old = (table, entry.submission.supersedes or "") if entry.submission else (table, "")
        if old not in found:
            continue
        given = found[old].submission
        team = given.team if given is not None else None
        if entry.submission is None or entry.submission.team != team or old in heirs:
            faults.found.append(
                SubmissionError(
                    f"supersedes {old[1]}, which is of another team or superseded already",
                    where=entry.place,
                )
            )
            continue
        heirs[old] = (table, name)
    newest = [key for key in found if key not in heirs]
    shown = [replace(found[key], older=tuple(_lineage(key, found, heirs))) for key in newest]
    reached = {one.place for entry in shown for one in (entry, *entry.older)}
    lost = [entry.place for entry in found.values() if entry.place not in reached]
    if lost:
        faults.found.append(SubmissionError("supersede each other", where=", ".join(lost)))
    return shown


def _lineage(
    key: tuple[str, str],
    found: dict[tuple[str, str], Entry],
    heirs: dict[tuple[str, str], tuple[str, str]],
) -> Iterator[Entry]:
    yield from found[key].older
    for old in sorted(one for one, heir in heirs.items() if heir == key):
        yield replace(found[old], older=())
        yield from _lineage(old, found, heirs)


def waiting(submissions: Path, entries: Sequence[Entry]) -> list[str]:
    """Say which submissions have no run yet, and so no row.

    Parameters
    ----------
    submissions : Path
        With ``<benchmark>/<track>/<folder>/submission.toml``.
    entries : sequence of Entry
        All that are shown.
    """
    known = Counter(
        one.place.split("/", 1)[1].rpartition("/")[0]
        for entry in entries
        for one in (entry, *entry.older)
        if one.place
    )
    folders = sorted(path.parent for path in submissions.glob(f"*/*/*/{SUBMISSION_FILE}"))
    names = [folder.relative_to(submissions).as_posix() for folder in folders]
    return [f"{name} has not been scored yet: no row" for name in names if name not in known]
