"""Boards: the content of ``leaderboard.toml``, places of submissions, and a new board's files."""

from __future__ import annotations

import re
from contextlib import suppress
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from pydantic import Field

from airzoo_bench.core.errors import SubmissionError, UsageError, first_of
from airzoo_bench.core.files import atomic_write
from airzoo_bench.core.validation import Count, Name, Strict, read_toml, validated
from airzoo_bench.core.version import __version__
from airzoo_bench.leaderboard import submission
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, Account

BOARD_FILE = "leaderboard.toml"

Title = Annotated[str, Field(min_length=1, max_length=120)]

# No option, and no device of Windows, also with an ending: no clone there could have such a file.
PLAIN_NAME = re.compile(
    r"(?!(con|prn|aux|nul|com[0-9]|lpt[0-9])(\.|\Z))[a-z0-9_][a-z0-9._-]{0,119}(?<!\.)",
    re.IGNORECASE | re.ASCII,
)


class Limits(Strict):
    """Limits of the cost of a submission; docs/leaderboard.md explains each."""

    committed_bytes: Count = 25_000_000
    url_bytes: Annotated[int, Field(ge=1, le=1 << 40)] = 20_000_000_000
    tries: Count = 4
    days: Count = 30


class BoardBenchmark(Strict):
    """A benchmark of the board, a protocol a track; `sealed` is the archive of its truth."""

    name: Name
    title: Title
    protocols: Annotated[tuple[Name, ...], Field(min_length=1)]
    sealed: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._/-]*\.age$")] | None = None


class Board(Strict):
    """The benchmarks of a board, and its rules; docs/leaderboard.md explains each key."""

    schema_version: Literal[1] = Field(alias="schema")
    title: Title
    url: Annotated[str, Field(pattern=r"^https://\S+$")] | None = None
    repository: Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]+/[A-Za-z0-9_.-]+$")] | None = None
    branch: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._/-]*$")] = "main"
    limits: Limits = Limits()
    benchmarks: Annotated[tuple[BoardBenchmark, ...], Field(min_length=1)]
    maintainers: Annotated[tuple[Account, ...], Field(max_length=100)] = ()

    @property
    def protocols(self) -> list[str]:
        """All protocols of the board, in its order."""
        return [name for benchmark in self.benchmarks for name in benchmark.protocols]

    @property
    def archives(self) -> dict[str, str]:
        """The archives of sealed truths, by benchmark."""
        return {one.name: one.sealed for one in self.benchmarks if one.sealed is not None}


def read_board(path: Path) -> Board:
    """Read a leaderboard.toml."""
    data = read_toml(path, SubmissionError, "leaderboard file")
    return validated(data, Board, SubmissionError, path, "leaderboard file")


def board_root(start: Path) -> Path:
    """Return the folder of the board that a path is in."""
    for folder in (start.resolve(), *start.resolve().parents):
        if (folder / BOARD_FILE).is_file():
            return folder
    fix = "clone the board's repository and go there; `airzoo-bench leaderboard init` makes one"
    raise UsageError(f"no {BOARD_FILE} here or above", where=start, fix=fix)


class Place(NamedTuple):
    """The place of a submission: ``submissions/<benchmark>/<track>/<folder>``."""

    benchmark: Name
    track: Name
    folder: Name

    @classmethod
    def from_folder(cls, folder: Path) -> Place:
        """Return the place that the last three parts of a folder's path name."""
        return cls(*("", "", "", *folder.resolve().parts)[-3:])

    @property
    def path(self) -> str:
        """Its folder in the board's repository."""
        return "/".join(("submissions", *self))

    @property
    def runs(self) -> str:
        """The folder of its runs on the branch of the board's data."""
        return "/".join(("runs", *self))

    @property
    def is_plain(self) -> bool:
        """Whether its names are allowed for a submission."""
        return all(map(PLAIN_NAME.fullmatch, self))


def known_submissions(root: Path) -> dict[Place, submission.Submission]:
    """Return the submissions below a board's root that can be read, in the order of their paths."""
    found = {}
    for path in sorted(root.glob(f"submissions/*/*/*/{SUBMISSION_FILE}")):
        place = Place.from_folder(path.parent)
        with suppress(SubmissionError):  # its own check says so
            if place.is_plain:
                found[place] = submission.read_submission(path)
    return found


# --- a new board ---


def write_starter(folder: Path, repository: str | None) -> list[Path]:
    """Write the files of a new board, into a folder where none of them is yet."""
    home = Path(str(files("airzoo_bench.leaderboard") / "starter"))
    owner, _, name = (repository or "OWNER/REPOSITORY").partition("/")
    off = "# " if repository is None else ""
    host = f'{off}url = "https://{owner}.github.io/{name}/"\n{off}repository = "{owner}/{name}"'
    found = {}
    for path in sorted(path for path in home.rglob("*") if path.is_file()):
        hidden = re.sub("(^|/)_", r"\1.", path.relative_to(home).as_posix())  # ".ci" of "_ci"
        text = path.read_text("utf-8").replace("@VERSION@", __version__)
        found[folder / hidden] = text.replace("@HOST@", host)
    if there := [path.relative_to(folder) for path in found if path.exists()]:
        what = f"these files are there already, and none is replaced: {first_of(there)}"
        raise UsageError(what, where=folder, fix="name another folder, or move them away")
    for path, text in found.items():
        with atomic_write(path, "w") as stream:
            stream.write(text)
    (folder / ".ci/get-data").chmod(0o755)
    return [*found]
