"""Runs: what the data branch keeps of a submission that was scored.

A run is the folder ``runs/<benchmark>/<track>/<folder>/<number>/`` with ``run.json``, with
``submission.toml`` (without ``contact``), and with ``result.json`` and ``records.csv`` or, of a
sealed benchmark, ``answer.json``. The highest number is shown; the others are history.
"""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.files import atomic_write, read_text
from airzoo_bench.core.validation import Positive, Strict, validation_message
from airzoo_bench.core.version import __version__
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, Submission, submission_text

__all__ = [
    "RUN_FILE",
    "Claimed",
    "MadeAgain",
    "Run",
    "newest_runs",
    "read_run",
    "write_facts",
    "write_run",
]

RUN_FILE = "run.json"

ObjectId = Annotated[str, Field(pattern=r"^([0-9a-f]{40}|[0-9a-f]{64})$")]


class Claimed(Strict):
    """How the result that came with a submission compares with the re-scored one.

    Attributes
    ----------
    agrees : bool
        What disagrees is refused; on the board it may only stand after a change of the truth.
    lines : tuple of str
        What was compared, in sentences.
    """

    agrees: bool
    lines: tuple[str, ...]


class MadeAgain(Strict):
    """What CI measured when it made the predictions of the suite's own baseline again.

    Attributes
    ----------
    same_bytes : bool
        Whether they are those of the submission; another processor may round otherwise.
    alike : bool
        Whether they are, or score as these do: only then it is the submission's time.
    """

    seconds_per_query: Positive
    same_bytes: bool
    alike: bool = False


class Run(Strict):
    """When a submission was scored, at which commit, by which version.

    Attributes
    ----------
    scored : datetime
        In UTC.
    commit : str
        Where the submission's files were read from.
    tree : str
        Git's id of the submission's folder: the same files have the same.
    version : str
        Of airzoo-bench.
    claimed : Claimed or None
        None where no result came with it.
    made_again : MadeAgain or None
        None where CI could not make the predictions.
    """

    schema_version: Literal[1] = Field(default=1, alias="schema")
    scored: Annotated[datetime.datetime, Field(strict=False)]  # JSON has texts for times
    commit: ObjectId
    tree: ObjectId
    version: str
    claimed: Claimed | None = None
    made_again: MadeAgain | None = None


def read_run(path: Path) -> Run:
    """Read a run.json."""
    text = read_text(path, SubmissionError, "run file")
    try:
        return Run.model_validate_json(text)
    except ValidationError as error:
        raise SubmissionError(validation_message(error, Run), where=path) from error


def write_run(path: Path, run: Run) -> None:
    """Write a run.json, whole or not at all."""
    with atomic_write(path, "w") as stream:
        stream.write(run.model_dump_json(by_alias=True, indent=1) + "\n")


def write_facts(
    run: Path,
    submission: Submission,
    commit: str,
    tree: str,
    claimed: Claimed | None = None,
    made_again: MadeAgain | None = None,
) -> None:
    """Write what is stated of a run that is scored now, beside its result: all but the contact."""
    stated = submission_text(submission.public())
    (run / SUBMISSION_FILE).write_text(stated, encoding="utf-8")
    now = datetime.datetime.now(datetime.UTC).replace(microsecond=0)
    facts = Run(
        scored=now,
        commit=commit,
        tree=tree,
        version=__version__,
        claimed=claimed,
        made_again=made_again,
    )
    write_run(run / RUN_FILE, facts)


def newest_runs(table: Path) -> dict[str, Path]:
    """Return the newest run of each folder of a benchmark's track."""
    found = {}
    for folder in sorted(path for path in table.glob("*") if path.is_dir()):
        numbers = [int(one.name) for one in folder.iterdir() if one.name.isdecimal()]
        if numbers:
            found[folder.name] = folder / str(max(numbers))
    return found
