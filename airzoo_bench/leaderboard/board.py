"""What a board states of itself, in ``leaderboard.toml`` at the root of its repository."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.validation import Count, Name, Strict, read_toml, validated

__all__ = ["BOARD_FILE", "Board", "BoardBenchmark", "Limits", "read_board"]

BOARD_FILE = "leaderboard.toml"

Title = Annotated[str, Field(min_length=1, max_length=120)]
Account = Annotated[int, Field(ge=1, lt=1 << 63)]


class Limits(Strict):
    """What a submission may cost the board.

    Attributes
    ----------
    committed_bytes, url_bytes : int
        Of all files of a submission in the repository, and of predictions at an address.
    tries, days : int
        Scored tries of one account within so many days, on a sealed benchmark.
    entries : int
        Submissions of one account that a table shows at once: each more widens the rank ranges
        of all, since every two are compared.
    """

    committed_bytes: Count = 25_000_000
    url_bytes: Annotated[int, Field(ge=1, le=1 << 40)] = 20_000_000_000
    tries: Count = 4
    days: Count = 30
    entries: Count = 10


class BoardBenchmark(Strict):
    """A benchmark that the board is of.

    Attributes
    ----------
    name : str
        Of the benchmark folder in the data root, and of the folder below submissions/.
    protocols : tuple of str
        One a track.
    sealed : str or None
        The archive of the truth, relative to the repository; none where the truth is public.
    """

    name: Name
    title: Title
    protocols: Annotated[tuple[Name, ...], Field(min_length=1)]
    sealed: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._/-]*\.age$")] | None = None


class Board(Strict):
    """The benchmarks of a board, and its rules.

    Attributes
    ----------
    repository : str or None
        Its name on GitHub.
    maintainers : tuple of int
        Ids of the accounts that may change every submission; names can change hands, ids cannot.
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
        """Where the repository is seen."""
        return self.repository and f"https://github.com/{self.repository}"

    @property
    def data_url(self) -> str | None:
        """Where the branch of the data is seen; the path of a file in it may follow."""
        return self.repository_url and f"{self.repository_url}/tree/leaderboard-data"

    @property
    def addresses(self) -> tuple[str | None, str | None, str | None, str | None]:
        """The site, the repository's name, and where it and the branch of the data are seen."""
        return self.url, self.repository, self.repository_url, self.data_url

    @property
    def protocols(self) -> list[str]:
        """All that the board scores by, in its order."""
        return [name for benchmark in self.benchmarks for name in benchmark.protocols]


def read_board(path: Path) -> Board:
    """Read a leaderboard.toml."""
    data = read_toml(path, SubmissionError, "leaderboard file")
    return validated(data, Board, SubmissionError, path, "leaderboard file")
