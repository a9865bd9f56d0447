"""Runs: the scored versions of a submission, as the data branch keeps them.

A run is the folder ``runs/<benchmark>/<track>/<folder>/<number>/`` with ``run.json``, with
``submission.toml`` (without ``contact``), and with ``result.json`` and ``records.csv`` or, of a
sealed benchmark, ``answer.json``. The highest number is shown; the others are history.
"""

from __future__ import annotations

import datetime
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from airzoo_bench.benchmark.folder import find_benchmark
from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.files import atomic_write, read_text
from airzoo_bench.core.validation import Strict, validation_message
from airzoo_bench.core.version import __version__
from airzoo_bench.evaluation.evaluate import truth_fingerprint
from airzoo_bench.evaluation.opening import read_truths
from airzoo_bench.leaderboard.answer import SealedAnswer
from airzoo_bench.leaderboard.board import Place
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, Submission, submission_text
from airzoo_bench.protocol.lookup import find_protocol
from airzoo_bench.results.result import read_result

__all__ = [
    "ANSWER_FILE",
    "FAULT_FILE",
    "RUN_FILE",
    "Claimed",
    "Measure",
    "Run",
    "measure_now",
    "measure_of",
    "newest_run",
    "next_run",
    "read_run",
    "write_facts",
]

RUN_FILE, ANSWER_FILE = "run.json", "answer.json"
FAULT_FILE = "fault.txt"
"""Why CI could not score the files of a submission that were merged last."""

ObjectId = Annotated[str, Field(pattern=r"^([0-9a-f]{40}|[0-9a-f]{64})$")]


class Claimed(Strict):
    """How the result that came with a submission compares with the re-scored one."""

    agrees: bool
    lines: tuple[str, ...]


class Run(Strict):
    """The time (UTC), commit and version of airzoo-bench of a scored submission.

    `tree` is git's id of the submission's folder: the same files have the same.
    """

    schema_version: Literal[1] = Field(default=1, alias="schema")
    scored: Annotated[datetime.datetime, Field(strict=False)]  # JSON has texts for times
    commit: ObjectId
    tree: ObjectId
    version: str
    claimed: Claimed | None = None


def read_run(path: Path) -> Run:
    """Read a run.json."""
    text = read_text(path, SubmissionError, "run file")
    try:
        return Run.model_validate_json(text)
    except ValidationError as error:
        raise SubmissionError(validation_message(error, Run), where=path) from error


def write_facts(
    run: Path, submission: Submission, commit: str, tree: str, claimed: Claimed | None = None
) -> None:
    """Write what a run that is scored now states, beside its result."""
    stated = submission_text(submission.public())
    (run / SUBMISSION_FILE).write_text(stated, encoding="utf-8")
    now = datetime.datetime.now(datetime.UTC).replace(microsecond=0)
    facts = Run(scored=now, commit=commit, tree=tree, version=__version__, claimed=claimed)
    with atomic_write(run / RUN_FILE, "w") as stream:
        stream.write(facts.model_dump_json(by_alias=True, indent=1) + "\n")


def newest_run(root: Path, place: Place) -> Path | None:
    """Return the newest run of a submission below a folder that holds ``runs/``."""
    folder = root / "runs" / place.benchmark / place.track / place.folder
    runs = [one for one in folder.glob("*") if one.name.isdecimal()]
    return max(runs, key=lambda one: int(one.name), default=None)


def next_run(root: Path, place: Place) -> Path:
    """Return the folder of a submission's next run."""
    last = newest_run(root, place)
    number = 1 if last is None else int(last.name) + 1
    return root / "runs" / place.benchmark / place.track / place.folder / str(number)


@dataclass(frozen=True)
class Measure:
    """The protocol and the truth that a score depends on beside the predictions."""

    protocol: str
    version: int
    fingerprint: str
    truth: str

    def outdated(self, now: Measure) -> str:
        """Say what has been replaced since; nothing where scores are comparable."""
        if self.version != now.version:
            return f"protocol v{self.version}, now v{now.version}"
        if self.fingerprint != now.fingerprint:
            return "other settings of the protocol"
        return "" if self.truth == now.truth else "another truth"


def measure_of(run: Path) -> Measure:
    """Return the protocol and truth of a run."""
    sealed = run / ANSWER_FILE
    if sealed.is_file():
        answer = SealedAnswer.model_validate_json(sealed.read_bytes())
        versions = answer.protocol_version, answer.protocol_fingerprint
        return Measure(answer.protocol, *versions, answer.truth_commitment)
    result = read_result(run / "result.json")
    used = result.protocol
    return Measure(used.name, used.version, used.fingerprint, result.truth.fingerprint)


def measure_now(protocol: str, data: Path, *, sealed: bool) -> Measure:
    """Return a protocol and its truth as they are now."""
    found = find_protocol(protocol, data)
    if sealed:
        public = find_benchmark(found.benchmark, data, sealed=True).file.sealed
        truth = "" if public is None else public.commitment
    else:
        _, truths = read_truths(found, data)
        truth = truth_fingerprint(truths)
    return Measure(found.name, found.version, found.fingerprint, truth)
