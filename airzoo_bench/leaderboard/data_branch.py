"""The branch with the board's data, which only CI writes: runs, tries, answers of sealed truths.

A run is the folder ``runs/<benchmark>/<track>/<folder>/<number>/`` with ``run.json``, with
``submission.toml`` (without ``contact``), and with ``result.json`` and ``records.csv`` or, of a
sealed benchmark, ``answer.json``. The highest number is shown; the others are history.
"""

from __future__ import annotations

import csv
import datetime
import io
import re
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, NamedTuple, TypeVar

from pydantic import ConfigDict, Field, ValidationError

from airzoo_bench.core.errors import SubmissionError, counted
from airzoo_bench.core.files import atomic_write, read_text
from airzoo_bench.core.validation import Name, Strict, validation_message
from airzoo_bench.core.version import __version__
from airzoo_bench.leaderboard.board import Limits, Place
from airzoo_bench.leaderboard.git import BoardError, RefusedError, Repository
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, Submission, submission_text
from airzoo_bench.results.result import ScoreColumn

DATA_BRANCH = "leaderboard-data"
RUN_FILE, ANSWER_FILE = "run.json", "answer.json"
FAULT_FILE = "fault.txt"
"""Why CI could not score the files of a submission that were merged last."""

_THEIRS, _OURS = f"refs/heads/{DATA_BRANCH}", "refs/heads/data"
_PUSHES = 10
_TRIES_FILE = "tries.csv"
_WHEN = "%Y-%m-%dT%H:%M:%SZ"

Finite = Annotated[float, Field(allow_inf_nan=False)]
ObjectId = Annotated[str, Field(pattern=r"^([0-9a-f]{40}|[0-9a-f]{64})$")]


# --- runs ---


class Run(Strict):
    """The time (UTC), commit and version of airzoo-bench of a scored submission.

    `tree` is git's id of the submission's folder: the same files have the same.
    """

    model_config = ConfigDict(extra="ignore")  # older runs say more

    schema_version: Literal[1] = Field(default=1, alias="schema")
    scored: Annotated[datetime.datetime, Field(strict=False)]  # JSON has texts for times
    commit: ObjectId
    tree: ObjectId
    version: str


class Estimate(Strict):
    """A score, a multiple of `step`, and its standard error; None is infinite or not known."""

    value: Finite | None
    standard_error: Finite | None
    step: Finite | None = None


class SealedAnswer(Strict):
    """Scores of a sealed benchmark, coarse enough that no try tells the answer of one query.

    `truth_commitment` is SHA-256 over the truth and its salt, which lies in the archive.
    """

    model_config = ConfigDict(extra="ignore")  # earlier answers told scenes by themselves

    schema_version: Literal[1] = Field(alias="schema")
    sealed: Literal[True] = True
    track: str
    protocol: Name
    protocol_version: int
    protocol_fingerprint: str
    benchmark: Name
    truth_commitment: str
    method: str
    predictions_sha256: str
    columns: tuple[ScoreColumn, ...]
    queries: dict[str, int]
    scene_titles: dict[str, str]
    overall: dict[str, Estimate]
    versions: dict[str, str]


M = TypeVar("M", Run, SealedAnswer)


def read_run(folder: Path) -> Run:
    """Read the facts of a run."""
    return _read_json(folder / RUN_FILE, Run, "run file")


def read_answer(folder: Path) -> SealedAnswer:
    """Read the sealed answer of a run."""
    return _read_json(folder / ANSWER_FILE, SealedAnswer, "sealed answer")


def _read_json(path: Path, model: type[M], what: str) -> M:
    try:
        return model.model_validate_json(read_text(path, SubmissionError, what))
    except ValidationError as error:
        raise SubmissionError(validation_message(error, model), where=path) from error


def write_facts(run: Path, submission: Submission, commit: str, tree: str) -> None:
    """Write next to its scores the facts of a run."""
    now = datetime.datetime.now(datetime.UTC).replace(microsecond=0)
    facts = Run(scored=now, commit=commit, tree=tree, version=__version__)
    with atomic_write(run / SUBMISSION_FILE, "w") as stream:
        stream.write(submission_text(submission.public()))
    with atomic_write(run / RUN_FILE, "w") as stream:
        stream.write(facts.model_dump_json(by_alias=True, indent=1) + "\n")


def run_folders(folder: Path) -> list[Path]:
    """Return the folders of a submission's runs, the newest first."""
    found = folder.iterdir() if folder.is_dir() else ()
    numbers = [path for path in found if re.fullmatch(r"[1-9][0-9]{0,5}", path.name)]
    return sorted(numbers, key=lambda path: -int(path.name))


# --- tries ---


class Try(NamedTuple):
    """A line of the list of tries at sealed truths, by account and commit, with the time in UTC.

    The outcome is ``started`` before the truth is opened, ``scored``, or ``failed``, by no fault of
    the submission, which gives the try back.
    """

    account: str
    benchmark: str
    head: str
    outcome: str
    time: str

    @classmethod
    def now(cls, account: int, benchmark: str, head: str, outcome: str) -> Try:
        """Make the line of this moment."""
        moment = datetime.datetime.now(datetime.UTC).strftime(_WHEN)
        return cls(str(account), benchmark, head, outcome, moment)

    @property
    def when(self) -> datetime.datetime:
        """The time, with its time zone."""
        return datetime.datetime.strptime(self.time, _WHEN).replace(tzinfo=datetime.UTC)


def check_tries(tries: Sequence[Try], new: Try, limits: Limits) -> None:
    """Refuse one more try than an account has on a sealed benchmark; a commit counts once."""
    begun: dict[str, datetime.datetime] = {}
    for one in tries:
        if one[:2] == new[:2]:
            if one.outcome == "failed":
                begun.pop(one.head, None)
            else:
                begun.setdefault(one.head, one.when)
    span = datetime.timedelta(days=limits.days)
    counting = sorted(w for head, w in begun.items() if w > new.when - span and head != new.head)
    if len(counting) >= limits.tries:
        raise RefusedError(
            f"this account has had {counted(len(counting), 'try', 'tries')} on {new.benchmark} "
            f"within {counted(limits.days, 'day')}",
            expected=f"at most {limits.tries}",
            fix=f"push again after {(counting[-limits.tries] + span).strftime(_WHEN)}",
        )


# --- the branch ---


class DataBranch:
    """The branch, read and written without a work tree."""

    def __init__(self, folder: Path, remote: str) -> None:
        self._repository = Repository(folder, remote)
        self._fetch()

    def read(self, path: str) -> bytes | None:
        """Return the content of a file, None where there is none."""
        found = self._repository.resolve(f"{_OURS}:{path}")
        return self._repository.blob(found) if found else None

    def export(self, place: Place, into: Path) -> None:
        """Write the runs of a submission to disk, below ``runs/``."""
        tip = self._repository.resolve(_OURS)
        for path, _, object_id in self._repository.entries(tip, place.runs) if tip else ():
            (into / path).parent.mkdir(parents=True, exist_ok=True)
            (into / path).write_bytes(self._repository.blob(object_id))

    def tries(self) -> list[Try]:
        """Return the list of tries."""
        text = (self.read(_TRIES_FILE) or b"").decode("utf-8")
        try:
            return [Try(*row) for row in list(csv.reader(io.StringIO(text)))[1:]]
        except TypeError as error:
            fix = "put back the file that CI wrote: `git log` of the branch has it"
            raise BoardError("not a list of tries", where=_TRIES_FILE, fix=fix) from error

    def add_try(self, line: Try, limits: Limits, files: Mapping[str, bytes]) -> None:
        """Add a line to the list of tries, refused where it starts one too many, and files."""

        def change() -> Mapping[str, bytes]:
            tries = self.tries()
            if line.outcome == "started":
                check_tries(tries, line, limits)
            stream = io.StringIO(newline="")
            csv.writer(stream, lineterminator="\n").writerows([Try._fields, *tries, line])
            return {**files, _TRIES_FILE: stream.getvalue().encode()}

        self._write(change, f"{line.outcome}: {line.benchmark}")

    def add_runs(self, root: Path) -> list[str]:
        """Add the runs below a folder that the branch does not have, and return their paths."""
        runs = {
            path.parent.relative_to(root).as_posix(): path.parent
            for path in sorted(root.glob(f"runs/*/*/*/*/{RUN_FILE}"))
        }
        added: list[str] = []

        def change() -> Mapping[str, bytes]:
            added[:] = [name for name in runs if self.read(f"{name}/{RUN_FILE}") is None]
            return {
                f"{name}/{path.name}": path.read_bytes()
                for name in added
                for path in sorted(runs[name].iterdir())
            }

        self._write(change, "runs")
        return added

    def _write(self, change: Callable[[], Mapping[str, bytes]], message: str) -> None:
        """Commit files and push them; where somebody else was faster, again on top of that."""
        for number in range(_PUSHES):
            files = change()
            if not files:
                return
            commit = self._repository.commit(self._repository.resolve(_OURS), files, message)
            pushed = self._repository.push(commit, _THEIRS)
            time.sleep(0 if pushed else 0.1 * number)
            self._fetch()
            if pushed:
                return
        raise BoardError(
            f"{DATA_BRANCH} was pushed to by others {_PUSHES} times in a row",
            where=self._repository.remote,
            fix="run the job again; if it fails again, see whether the token may push",
        )

    def _fetch(self) -> None:
        if self._repository.run("ls-remote", "origin", _THEIRS).strip():
            self._repository.fetch({_THEIRS: _OURS}, blobs=True, depth=1)
