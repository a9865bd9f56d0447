"""The branch with the board's data, which only CI writes: runs, tries, answers of sealed truths."""

from __future__ import annotations

import csv
import datetime
import shutil
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from airzoo_bench.core.errors import counted
from airzoo_bench.leaderboard.answers import FAULT_FILE, TIME, Answer
from airzoo_bench.leaderboard.board import Limits, Place
from airzoo_bench.leaderboard.pull_request import BoardError, RefusedError, Repository

DATA_BRANCH = "leaderboard-data"

_BRANCH, _COPY = f"refs/heads/{DATA_BRANCH}", "refs/remotes/origin/data"
_PUSHES = 8
_TRIES_FILE = "tries.csv"


class Try(NamedTuple):
    """A line of the list of tries at sealed truths, by account and commit."""

    account: str
    benchmark: str
    head: str
    outcome: str  # started, scored, or failed by no fault of the submission: it comes back
    time: str


def check_tries(tries: Sequence[Try], new: Try, limits: Limits) -> None:
    """Refuse one more try than an account has on a sealed benchmark; a commit counts once."""
    last = {one.head: one for one in tries if one[:2] == new[:2] and one.head != new.head}
    since = datetime.datetime.fromisoformat(new.time) - datetime.timedelta(days=limits.days)
    counting = [t for t in last.values() if t.outcome != "failed" and t.time > f"{since:{TIME}}"]
    if len(counting) >= limits.tries:
        had, days = counted(len(counting), "try", "tries"), counted(limits.days, "day")
        what = f"this account has had {had} on {new.benchmark} within {days}"
        raise RefusedError(what, expected=f"at most {limits.tries}", fix="push again later")


class DataBranch:
    """A clone of the branch, with a work tree: nobody but CI writes to it."""

    def __init__(self, folder: Path, remote: str) -> None:
        self.folder, self._repository = folder, Repository(folder, remote)
        self._update()

    def answer_path(self, tree: str) -> Path:
        """Return where the answer to a sealed submission is kept until it is merged."""
        return self.folder / f"answers/{tree}.json"

    def copy_runs(self, places: Iterable[Place], out: Path) -> None:
        """Copy the runs of some submissions into a folder, below ``runs/``."""
        for place in places:
            if (self.folder / place.runs).is_dir():
                shutil.copytree(self.folder / place.runs, out / place.runs, dirs_exist_ok=True)

    def tries(self) -> list[Try]:
        """Return the list of tries."""
        path = self.folder / _TRIES_FILE
        text = path.read_text(encoding="utf-8") if path.is_file() else ""
        return [Try(*row) for row in list(csv.reader(text.splitlines()))[1:]]

    def add_try(self, line: Try, limits: Limits, answer: Answer | None = None) -> None:
        """Add a line to the list of tries, refused where it starts one too many, and an answer."""

        def change() -> None:
            tries = self.tries()
            if line.outcome == "started":
                check_tries(tries, line, limits)
            with (self.folder / _TRIES_FILE).open("w", encoding="utf-8", newline="") as stream:
                csv.writer(stream, lineterminator="\n").writerows([Try._fields, *tries, line])
            if answer is not None:
                path = self.answer_path(answer.tree)
                path.parent.mkdir(exist_ok=True)
                path.write_text(answer.model_dump_json(), encoding="utf-8")

        self._write(change, f"{line.outcome}: {line.benchmark}")

    def add_runs(self, root: Path) -> None:
        """Add the runs below a folder, in place of runs of the same number."""
        fault, target = shutil.ignore_patterns(FAULT_FILE), self.folder / "runs"
        self._write(
            lambda: shutil.copytree(root / "runs", target, dirs_exist_ok=True, ignore=fault), "runs"
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
            time.sleep(0.1 * number)
            self._update()
        said = done.stderr.decode(errors="replace")[-500:]
        raise BoardError(f"git push failed: {said}", where=git.remote, fix="run the job again")

    def _update(self) -> None:
        """Bring the work tree to the branch, which may not be there yet."""
        git = self._repository
        if git.run("ls-remote", "origin", _BRANCH).strip():
            git.fetch({_BRANCH: _COPY}, "--depth=1")
            git.run("reset", "--quiet", "--hard", _COPY)
            git.run("clean", "--quiet", "-dffx")
