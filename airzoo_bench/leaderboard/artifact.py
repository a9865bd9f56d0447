"""The findings of CI on a pull request: a JSON file, the comment's only source."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from airzoo_bench.core.errors import SubmissionError, UserError
from airzoo_bench.core.files import atomic_write, read_text
from airzoo_bench.core.validation import Name, Strict
from airzoo_bench.leaderboard.answer import SealedAnswer
from airzoo_bench.leaderboard.board import Place
from airzoo_bench.leaderboard.submission import Account
from airzoo_bench.results.result import ScoreColumn

__all__ = [
    "Artifact",
    "Problem",
    "SceneScores",
    "Shown",
    "Standing",
    "problem_of",
    "read_artifact",
    "write_artifact",
]

Finite = Annotated[float, Field(allow_inf_nan=False)]
Commit = Annotated[str, Field(pattern=r"^([0-9a-f]{40}|[0-9a-f]{64})$")]


class Problem(Strict):
    """Why a pull request is refused, in the parts of a `UserError`."""

    what: str
    where: str | None = None
    expected: str | None = None
    fix: str | None = None

    def error(self) -> UserError:
        """Return the error that the terminal prints."""
        return SubmissionError(self.what, where=self.where, expected=self.expected, fix=self.fix)


class Shown(Strict):
    """A score, its interval, and the score of the last version; None is infinite."""

    value: Finite | None
    low: Finite | None = None
    high: Finite | None = None
    before: Finite | None = None


class SceneScores(Strict):
    """A row of the table: a scene, or all of them."""

    title: str
    queries: int
    scores: dict[str, Shown]


class Standing(Strict):
    """The rank range of a method in its table, and the methods that it is not told from."""

    score: str
    first: int
    last: int
    methods: int
    alike: tuple[str, ...]


class Artifact(Strict):
    """The outcome of a pull request, at the commit `head`.

    The kind is ``nothing`` where it changes no submission, and ``sealed`` where it is sound and to
    be scored, or scored, against a sealed truth. `tree` is git's id of the submission's folder,
    `claimed` how a claimed result compares, `agrees` None where none was claimed, `update` whether
    the folder is on the board already, `truth` the fingerprint of the truth once it was opened.
    """

    schema_version: Literal[1] = Field(default=1, alias="schema")
    kind: Literal["nothing", "refused", "scored", "sealed", "withdrawn"]
    pull_request: Account
    account: Account
    head: Commit
    benchmark: Name | None = None
    track: Name | None = None
    folder: Name | None = None
    tree: str = ""
    method: str = ""
    team: str = ""
    problems: tuple[Problem, ...] = ()
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    columns: tuple[ScoreColumn, ...] = ()
    rows: tuple[SceneScores, ...] = ()
    standing: Standing | None = None
    claimed: tuple[str, ...] = ()
    agrees: bool | None = None
    update: bool = False
    truth: str = ""
    answer: SealedAnswer | None = None

    @property
    def place(self) -> Place:
        """The folder of the submission."""
        if self.benchmark is None or self.track is None or self.folder is None:
            raise SubmissionError("the artifact is not about a submission")
        return Place(self.benchmark, self.track, self.folder)


def problem_of(error: UserError, work: Path | None = None) -> Problem:
    """Return an error as the artifact keeps it, without the path of the folder that CI works in."""
    given = {name: getattr(error, name) for name in Problem.model_fields}
    if work is not None:
        given = {name: text and without(text, work) for name, text in given.items()}
    return Problem(**given)


def without(text: str, work: Path) -> str:
    """Return a text without the path of the folder that CI works in."""
    return text.replace(f"{work}/", "").replace(str(work), "")


def write_artifact(path: Path, artifact: Artifact) -> None:
    """Write an artifact, whole or not at all."""
    with atomic_write(path, "w") as stream:
        stream.write(artifact.model_dump_json(by_alias=True, indent=1) + "\n")


def read_artifact(path: Path) -> Artifact:
    """Read an artifact that another job of the same run has written."""
    text = read_text(path, SubmissionError, "artifact")
    try:
        return Artifact.model_validate_json(text)
    except ValueError as error:
        raise SubmissionError(f"not an artifact: {error}", where=path) from error
