"""The branch with the board's data: a ledger and runs, which only CI writes."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.leaderboard.ci.git import BoardError, Repository
from airzoo_bench.leaderboard.ci.ledger import LEDGER_FILE, Line, parse_ledger, write_ledger
from airzoo_bench.leaderboard.ci.paths import checked_path

__all__ = ["DATA_BRANCH", "DataBranch"]

DATA_BRANCH = "leaderboard-data"

_THEIRS = f"refs/heads/{DATA_BRANCH}"
_OURS = "refs/heads/data"
_TRIES = 10
_MOST_FILES = 1_000_000


@dataclass(frozen=True)
class DataBranch:
    """The branch, read and written without a work tree."""

    repository: Repository

    @classmethod
    def open(cls, folder: Path, remote: str) -> DataBranch:
        """Fetch the newest commit, where there is one, into a new bare repository."""
        branch = cls(Repository.create(folder, remote))
        branch._fetch()
        return branch

    def read(self, path: str) -> bytes | None:
        """Return the content of a file, None where there is none."""
        tip = self._tip()
        found = None if tip is None else self.repository.resolve(f"{tip}:{path}")
        return None if found is None else self.repository.blob(found)

    def ledger(self) -> list[Line]:
        """Return the lines of the ledger."""
        return parse_ledger(self.read(LEDGER_FILE))

    def export(self, into: Path, under: str = "runs") -> None:
        """Write the files of a folder to disk."""
        tip = self._tip()
        if tip is None:
            return
        for entry in self.repository.entries(tip, under, _MOST_FILES):
            path = into / checked_path(entry.path)
            path.parent.mkdir(parents=True, exist_ok=True)
            self.repository.write_blob(entry.object_id, path)

    def append(
        self,
        line: Line,
        check: Callable[[list[Line]], None] = lambda _: None,
        files: Mapping[str, bytes] | None = None,
    ) -> None:
        """Add a line to the ledger, after what others have added meanwhile."""

        def change(branch: DataBranch) -> Mapping[str, bytes]:
            lines = branch.ledger()
            check(lines)
            return {**(files or {}), LEDGER_FILE: write_ledger([*lines, line])}

        self.write(change, f"{line.outcome}: {line.place.path}")

    def write(self, change: Callable[[DataBranch], Mapping[str, bytes]], message: str) -> None:
        """Commit files and push them; where somebody else was faster, again on top of that."""
        for number in range(_TRIES):
            files = change(self)
            if not files:
                return
            commit = self.repository.commit(self._tip(), files, message)
            if self.repository.push(commit, _THEIRS):
                self._fetch()
                return
            time.sleep(0.1 * number)
            self._fetch()
        raise BoardError(
            f"{DATA_BRANCH} was pushed to by others {_TRIES} times in a row",
            where=self.repository.git.remote,
            fix="run the job again; if it fails again, see whether the token may push",
        )

    def _tip(self) -> str | None:
        return self.repository.resolve(_OURS)

    def _fetch(self) -> None:
        if self.repository.remote_has(_THEIRS):
            self.repository.fetch({_THEIRS: _OURS}, blobs=True, depth=1)
