"""The branch with the board's data, which only CI writes: runs, tries, answers of sealed truths.

A run is the folder ``runs/<benchmark>/<track>/<folder>/<number>/`` with ``run.json``, with
``submission.toml`` (without ``contact``), and with ``result.json`` and ``records.csv`` or, of a
sealed benchmark, ``answer.json``. The highest number is shown; the others are history.
"""

from __future__ import annotations

import csv
import datetime
import re
import shutil
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from pydantic import ConfigDict, Field, ValidationError

from airzoo_bench.core.errors import SubmissionError, counted
from airzoo_bench.core.files import atomic_write, read_text
from airzoo_bench.core.validation import Strict, validation_message
from airzoo_bench.core.version import __version__
from airzoo_bench.leaderboard.board import Limits, Place
from airzoo_bench.leaderboard.git import BoardError, RefusedError, Repository
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, Submission, submission_text

DATA_BRANCH = "leaderboard-data"
RUN_FILE, RESULT_FILE, ANSWER_FILE = "run.json", "result.json", "answer.json"
FAULT_FILE = "fault.txt"
"""Why CI could not score the files of a submission that were merged last."""

_BRANCH, _COPY = f"refs/heads/{DATA_BRANCH}", "refs/remotes/origin/data"
_PUSHES = 10
_TRIES_FILE = "tries.csv"
_WHEN = "%Y-%m-%dT%H:%M:%SZ"
# Git's words where somebody else has pushed since, before or while this push was received.
_OVERTAKEN = re.compile(rb"\[rejected\]|cannot lock ref|failed to update ref|incorrect old value")


# --- runs ---


class RunFacts(Strict):
    """When (UTC) and by which version of airzoo-bench a submission was scored.

    `tree` is a hash of the submission's files.
    """

    model_config = ConfigDict(extra="ignore")  # older runs say more

    schema_version: Literal[1] = Field(default=1, alias="schema")
    scored: Annotated[datetime.datetime, Field(strict=False)]  # JSON has texts for times
    tree: str
    version: str


def read_facts(run: Path) -> RunFacts:
    """Read the facts of a run."""
    path = run / RUN_FILE
    try:
        return RunFacts.model_validate_json(read_text(path, SubmissionError, "run file"))
    except ValidationError as error:
        raise SubmissionError(validation_message(error, RunFacts), where=path) from error


def write_facts(run: Path, given: Submission, tree: str, scored: datetime.datetime | None) -> None:
    """Write next to its scores the facts of a run, which was scored now where nothing is said."""
    now = datetime.datetime.now(datetime.UTC).replace(microsecond=0)
    facts = RunFacts(scored=scored or now, tree=tree, version=__version__)
    with atomic_write(run / SUBMISSION_FILE, "w") as stream:
        stream.write(submission_text(given.public()))
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
    """A clone of the branch, with a work tree: nobody but CI writes to it."""

    def __init__(self, folder: Path, remote: str) -> None:
        self.folder, self._repository = folder, Repository(folder, remote)
        self._update()

    def copy_runs(self, places: Iterable[Place], out: Path) -> None:
        """Copy the runs of some submissions into a folder, below ``runs/``."""
        for place in places:
            if (self.folder / place.runs).is_dir():
                shutil.copytree(self.folder / place.runs, out / place.runs, dirs_exist_ok=True)

    def tries(self) -> list[Try]:
        """Return the list of tries."""
        path = self.folder / _TRIES_FILE
        if not path.is_file():
            return []
        with path.open(encoding="utf-8", newline="") as stream:
            return [Try(*row) for row in list(csv.reader(stream))[1:]]

    def add_try(self, line: Try, limits: Limits, files: Mapping[str, bytes]) -> None:
        """Add a line to the list of tries, refused where it starts one too many, and files."""

        def change() -> None:
            tries = self.tries()
            if line.outcome == "started":
                check_tries(tries, line, limits)
            with (self.folder / _TRIES_FILE).open("w", encoding="utf-8", newline="") as stream:
                csv.writer(stream, lineterminator="\n").writerows([Try._fields, *tries, line])
            for name, content in files.items():
                (self.folder / name).parent.mkdir(exist_ok=True)
                (self.folder / name).write_bytes(content)

        self._write(change, f"{line.outcome}: {line.benchmark}")

    def add_runs(self, root: Path) -> None:
        """Add the runs below a folder, in place of runs of the same number."""
        fault = shutil.ignore_patterns(FAULT_FILE)
        source, target = root / "runs", self.folder / "runs"
        self._write(
            lambda: shutil.copytree(source, target, dirs_exist_ok=True, ignore=fault), "runs"
        )

    def _write(self, change: Callable[[], object], message: str) -> None:
        """Commit a change and push it; where somebody else was faster, again on top of that."""
        git = self._repository
        for number in range(_PUSHES):
            change()
            git.run("add", "--all", "--force")
            if not git.run("status", "--porcelain"):
                return
            git.run("commit", "--quiet", "-m", message)
            done = git.call("push", "--quiet", "--porcelain", "origin", f"HEAD:{_BRANCH}")
            if not done.returncode:
                return
            if not _OVERTAKEN.search(done.stdout):
                raise BoardError(f"git push failed: {done.stderr.decode(errors='replace')[-500:]}")
            time.sleep(0.1 * number)
            self._update()
        raise BoardError(
            f"{DATA_BRANCH} was pushed to by others {_PUSHES} times in a row",
            where=git.remote,
            fix="run the job again; if it fails again, see whether the token may push",
        )

    def _update(self) -> None:
        git = self._repository
        if git.run("ls-remote", "origin", _BRANCH).strip():
            git.fetch({_BRANCH: _COPY}, "--depth=1")
            git.run("reset", "--quiet", "--hard", _COPY)
            git.run("clean", "--quiet", "-dffx")
