"""Boards: what ``leaderboard.toml`` states, and which submissions stand in the repository."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from airzoo_bench.core.errors import SubmissionError, UsageError
from airzoo_bench.core.validation import Count, Name, Strict, read_toml, validated
from airzoo_bench.leaderboard.names import fault_of_file_name
from airzoo_bench.leaderboard.submission import (
    SUBMISSION_FILE,
    Account,
    Submission,
    read_submission,
)

__all__ = [
    "BOARD_FILE",
    "Board",
    "BoardBenchmark",
    "Known",
    "Limits",
    "Place",
    "board_root",
    "known_submissions",
    "read_board",
]

BOARD_FILE = "leaderboard.toml"

Title = Annotated[str, Field(min_length=1, max_length=120)]


class Limits(Strict):
    """Limits of a submission's cost to the board; docs/leaderboard.md names them.

    Each more entry of an account widens the rank ranges of all, since every two are compared.
    """

    committed_bytes: Count = 25_000_000
    url_bytes: Annotated[int, Field(ge=1, le=1 << 40)] = 20_000_000_000
    tries: Count = 4
    days: Count = 30
    entries: Count = 10


class BoardBenchmark(Strict):
    """A benchmark of the board, a protocol a track; `sealed` is the archive of its truth."""

    name: Name
    title: Title
    protocols: Annotated[tuple[Name, ...], Field(min_length=1)]
    sealed: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._/-]*\.age$")] | None = None


class Board(Strict):
    """The benchmarks of a board, and its rules.

    Maintainers are ids of accounts: names can change hands, ids cannot.
    """

    schema_version: Literal[1] = Field(alias="schema")
    title: Title
    url: Annotated[str, Field(pattern=r"^https://\S+$")] | None = None
    repository: Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]+/[A-Za-z0-9_.-]+$")] | None = None
    limits: Limits = Limits()
    benchmarks: Annotated[tuple[BoardBenchmark, ...], Field(min_length=1)]
    maintainers: Annotated[tuple[Account, ...], Field(max_length=100)] = ()

    @property
    def repository_url(self) -> str | None:
        """The address of the repository's page."""
        return self.repository and f"https://github.com/{self.repository}"

    @property
    def data_url(self) -> str | None:
        """The address of the data branch; the path of a file in it may follow."""
        return self.repository_url and f"{self.repository_url}/tree/leaderboard-data"

    @property
    def protocols(self) -> list[str]:
        """All protocols of the board, in its order."""
        return [name for benchmark in self.benchmarks for name in benchmark.protocols]

    def archive(self, benchmark: str) -> str | None:
        """Return the archive of a benchmark's truth, None where the truth is public."""
        return next((one.sealed for one in self.benchmarks if one.name == benchmark), None)


def read_board(path: Path) -> Board:
    """Read a leaderboard.toml."""
    data = read_toml(path, SubmissionError, "leaderboard file")
    return validated(data, Board, SubmissionError, path, "leaderboard file")


def board_root(start: Path) -> Path:
    """Return the folder of the board that a path is in."""
    for folder in (start.resolve(), *start.resolve().parents):
        if (folder / BOARD_FILE).is_file():
            return folder
    raise UsageError(
        f"not in the repository of a board: no {BOARD_FILE} here or above",
        where=start,
        fix="clone the board's repository and go there, or name its folder by --board; "
        "`airzoo-bench leaderboard init` makes a board",
    )


@dataclass(frozen=True, order=True)
class Place:
    """The place of a submission: ``submissions/<benchmark>/<track>/<folder>``."""

    benchmark: str
    track: str
    folder: str

    @classmethod
    def of(cls, folder: Path) -> Place:
        """Take it from the last three parts of a folder's path."""
        return cls(*("", "", "", *folder.resolve().parts)[-3:])

    @property
    def path(self) -> str:
        """Relative to the root of the board's repository."""
        return f"submissions/{self.benchmark}/{self.track}/{self.folder}"

    @property
    def table(self) -> tuple[str, str]:
        """The benchmark and track that it is shown in."""
        return self.benchmark, self.track

    @property
    def fault(self) -> str:
        """Say which of its names could not be that of a submission."""
        parts = (self.benchmark, self.track, self.folder)
        return next(filter(None, map(fault_of_file_name, parts)), "")


@dataclass(frozen=True)
class Known:
    """A submission on the board."""

    place: Place
    stated: Submission


def known_submissions(root: Path) -> Iterator[Known]:
    """Yield the submissions below a board's root that can be read, in the order of their paths."""
    for path in sorted(root.glob(f"submissions/*/*/*/{SUBMISSION_FILE}")):
        place = Place.of(path.parent)
        if not place.fault:
            try:
                yield Known(place, read_submission(path))
            except SubmissionError:  # its own check says so
                continue
