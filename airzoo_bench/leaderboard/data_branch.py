"""The branch with the board's data, which only CI writes: runs, tries, answers of sealed truths."""

from __future__ import annotations

import csv
import datetime
import io
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from airzoo_bench.core.errors import counted
from airzoo_bench.leaderboard.board import Limits, Place
from airzoo_bench.leaderboard.git import BoardError, RefusedError, Repository
from airzoo_bench.leaderboard.runs import RUN_FILE

__all__ = ["DATA_BRANCH", "DataBranch", "Try", "check_tries"]

DATA_BRANCH = "leaderboard-data"

_THEIRS = f"refs/heads/{DATA_BRANCH}"
_OURS = "refs/heads/data"
_PUSHES = 10
_TRIES_FILE = "tries.csv"
_WHEN = "%Y-%m-%dT%H:%M:%SZ"


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
        if (one.account, one.benchmark) == (new.account, new.benchmark):
            if one.outcome == "failed":
                begun.pop(one.head, None)
            else:
                begun.setdefault(one.head, one.when)
    since = new.when - datetime.timedelta(days=limits.days)
    counting = sorted(when for head, when in begun.items() if when > since and head != new.head)
    if len(counting) < limits.tries:
        return
    free = counting[-limits.tries] + datetime.timedelta(days=limits.days)
    raise RefusedError(
        f"this account has had {counted(len(counting), 'try', 'tries')} on {new.benchmark} within "
        f"{counted(limits.days, 'day')}",
        expected=f"at most {limits.tries}",
        fix=f"push again after {free.strftime(_WHEN)}",
    )


class DataBranch:
    """The branch, read and written without a work tree."""

    def __init__(self, folder: Path, remote: str) -> None:
        self._repository = Repository.create(folder, remote)
        self._fetch()

    @classmethod
    @contextmanager
    def opened(cls, remote: str) -> Iterator[DataBranch]:
        """Open it in a temporary folder."""
        with tempfile.TemporaryDirectory() as folder:
            yield cls(Path(folder) / "data.git", remote)

    def read(self, path: str) -> bytes | None:
        """Return the content of a file, None where there is none."""
        tip = self._repository.resolve(_OURS)
        found = tip and self._repository.resolve(f"{tip}:{path}")
        return self._repository.blob(found) if found else None

    def export(self, place: Place, into: Path) -> None:
        """Write the runs of a submission to disk, below ``runs/``."""
        tip = self._repository.resolve(_OURS)
        folder = f"runs/{place.benchmark}/{place.track}/{place.folder}"
        for entry in self._repository.entries(tip, folder) if tip else ():
            self._repository.write_blob(entry.object_id, into / entry.path.decode())

    def tries(self) -> list[Try]:
        """Return the list of tries."""
        text = (self.read(_TRIES_FILE) or b"").decode("utf-8")
        try:
            return [Try(*row) for row in list(csv.reader(io.StringIO(text)))[1:]]
        except TypeError as error:
            raise BoardError(
                "not a list of tries",
                where=_TRIES_FILE,
                fix="put back the file that CI wrote: `git log` of the branch has it",
            ) from error

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
            tip = self._repository.resolve(_OURS)
            commit = self._repository.commit(tip, files, message)
            if self._repository.push(commit, _THEIRS):
                self._fetch()
                return
            time.sleep(0.1 * number)
            self._fetch()
        raise BoardError(
            f"{DATA_BRANCH} was pushed to by others {_PUSHES} times in a row",
            where=self._repository.remote,
            fix="run the job again; if it fails again, see whether the token may push",
        )

    def _fetch(self) -> None:
        if self._repository.remote_has(_THEIRS):
            self._repository.fetch({_THEIRS: _OURS}, blobs=True, depth=1)
