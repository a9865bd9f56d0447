"""The findings of CI on a pull request, and the comment that is made of them alone.

Whatever strangers wrote stands in code spans and blocks without backticks: there, GitHub
renders no link, no image, no mention and no reference.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.files import atomic_write, read_text
from airzoo_bench.core.validation import Name, Strict
from airzoo_bench.leaderboard.board import Place
from airzoo_bench.leaderboard.data_branch import Estimate, Finite, SealedAnswer
from airzoo_bench.leaderboard.submission import Account
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.tables.model import plain, show_number

__all__ = [
    "MARK",
    "MOST_BYTES",
    "Artifact",
    "SceneScores",
    "Standing",
    "code",
    "comment_on",
    "read_artifact",
    "write_artifact",
]

MARK = "<!-- airzoo-bench leaderboard -->"
MOST_BYTES = 65_300
"""GitHub takes 65,536 characters."""

_LONGEST_BLOCK, _LONGEST_SPAN, _MOST_PARTS = 4000, 120, 200
_CUT = "\n_The rest did not fit into a comment; the job's log has all of it._\n"
_UNITS = {"share": "%", "m": "m", "deg": "°"}

Numbers = Annotated[  # JSON has lists
    tuple[Finite | None, Finite | None, Finite | None, Finite | None], Field(strict=False)
]
Commit = Annotated[str, Field(pattern=r"^([0-9a-f]{40}|[0-9a-f]{64})$")]


class SceneScores(Strict):
    """A row of the table, a scene or all of them: value, interval, and the last version's value.

    None is infinite, or not known.
    """

    title: str
    queries: int
    scores: dict[str, Numbers]


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
    `claimed` how a claimed result compares, `update` whether the folder is on the board already,
    `truth` the fingerprint of the truth once it was opened.
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
    problems: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    columns: tuple[ScoreColumn, ...] = ()
    rows: tuple[SceneScores, ...] = ()
    standing: Standing | None = None
    claimed: tuple[str, ...] = ()
    update: bool = False
    truth: str = ""
    answer: SealedAnswer | None = None

    @property
    def place(self) -> Place:
        """The folder of the submission."""
        if self.benchmark is None or self.track is None or self.folder is None:
            raise SubmissionError("the artifact is not about a submission")
        return Place(self.benchmark, self.track, self.folder)


def write_artifact(path: Path, artifact: Artifact) -> None:
    """Write an artifact, whole or not at all."""
    with atomic_write(path, "w") as stream:
        stream.write(artifact.model_dump_json(by_alias=True, indent=1) + "\n")


def read_artifact(path: Path) -> Artifact:
    """Read an artifact that another job of the same run has written."""
    try:
        return Artifact.model_validate_json(read_text(path, SubmissionError, "artifact"))
    except ValueError as error:
        raise SubmissionError(f"not an artifact: {error}", where=path) from error


# --- the comment ---


def comment_on(artifact: Artifact) -> str:
    """Return the comment's text, at most `MOST_BYTES` long; its end is never cut."""
    head, number = artifact.head, artifact.pull_request
    last = f"\nThis is about commit {head[:12]} alone; another push is looked at anew.\n"
    if artifact.kind in ("scored", "sealed", "withdrawn"):
        merge = f"gh pr merge {number} --squash --match-head-commit {head}"
        last += f"Maintainers: `{merge}` merges it and nothing that was pushed later.\n"
    room = MOST_BYTES - len(last.encode()) - len(_CUT.encode())
    parts: list[str] = []
    for part in (f"{MARK}\n", *_parts(artifact)):
        room -= len(part.encode()) + 1
        if room < 0:
            return "\n".join([*parts, _CUT, last])
        parts.append(part)
    return "\n".join([*parts, last])


def _parts(artifact: Artifact) -> Iterator[str]:
    """Yield the paragraphs, the most important first."""
    if artifact.kind == "nothing":
        yield (
            "This pull request changes no submission: it is not for the board's branch, or all "
            "below `submissions/` is as it was where it began. (A submission is a folder "
            "`submissions/<benchmark>/<track>/<folder>`, committed.)\n"
        )
        return
    name = f"{code(artifact.method)} by {code(artifact.team)}"
    if not artifact.method:
        name = code(artifact.place.path) if artifact.folder else "This pull request"
    end = {"refused": " is refused", "withdrawn": " is withdrawn"}.get(artifact.kind, "")
    yield f"### {name}{end}\n"
    yield from map(_block, artifact.problems)
    if artifact.kind == "withdrawn":
        yield "Its rows leave the board when this is merged; its scores stay in its history.\n"
    elif artifact.kind == "scored":
        yield from _scores(artifact)
    elif artifact.kind == "sealed":
        yield from _sealed(artifact)
    if artifact.claimed:
        yield "The claimed result differs from the re-scored one, which counts:\n"
        yield _block("\n".join(artifact.claimed))
    for title, lines in (("Warnings", artifact.warnings), ("Notes", artifact.notes)):
        if lines:
            yield f"{title}:\n"
            yield _block("\n".join(lines))
    if artifact.kind == "refused":
        yield (
            "`airzoo-bench submission check FOLDER` finds faults of the folder on your own "
            "machine. " + ("The truth was opened: this counts as a try.\n" if artifact.truth
                           else "Nothing of this counts as a try.\n")
        )  # fmt: skip


def _scores(artifact: Artifact) -> Iterator[str]:
    if standing := artifact.standing:
        ranks = f"{standing.first}" + f" to {standing.last}" * (standing.last != standing.first)
        yield f"Rank **{ranks}** of {standing.methods} by {code(standing.score)}.\n"
        if standing.alike:
            names = ", ".join(code(name) for name in standing.alike[:_MOST_PARTS])
            yield f"Not told apart from {names} (paired test, 5 %, Holm).\n"
    columns = [column for column in artifact.columns if column.headline]
    rows = artifact.rows[-_MOST_PARTS:]
    yield _table(
        columns,
        [
            [code(r.title), f"{r.queries:,}", *(_number(c, r.scores[c.key][:3]) for c in columns)]
            for r in rows
        ],
    )
    if not artifact.update:
        return
    changed = [
        [code(r.title), f"{r.queries:,}", *(
            f"{_number(c, r.scores[c.key][3:])} → {_number(c, r.scores[c.key][:1])}"
            for c in columns
        )]
        for r in rows
        if any(one[3] is not None and one[3] != one[0] for one in r.scores.values())
    ]  # fmt: skip
    if changed:
        yield "Changed since the last version:\n\n" + _table(columns, changed)
    else:
        yield "No score differs from those of the last version.\n"


def _sealed(artifact: Artifact) -> Iterator[str]:
    answer = artifact.answer
    if answer is None:
        yield (
            "Nothing is wrong with it. It was not scored against the sealed truth: the job was not "
            "approved, or failed by no fault of the submission. This does not count as a try.\n"
        )
        return
    columns = [column for column in answer.columns if column.headline]
    cells = [_estimate(column, answer.overall.get(column.key)) for column in columns]
    yield _table(columns, [["`average`", f"{sum(answer.queries.values()):,}", *cells]])
    yield "Rounded to half a standard error, so that no try tells the answer of one query.\n"


def _number(column: ScoreColumn, numbers: Sequence[float | None]) -> str:
    """Write a value and its interval; None is infinite."""
    value, *limits = (
        "inf" if one is None else show_number(100 * one if column.unit == "share" else one, 2)
        for one in numbers
    )
    known = any(one is not None for one in numbers[1:])
    return f"{value} [{', '.join(limits)}]" if known else value


def _estimate(column: ScoreColumn, found: Estimate | None) -> str:
    if found is None:
        return "–"
    error = found.standard_error
    spread = "" if error is None else f" ± {_number(column, [error])}"
    return _number(column, [found.value]) + spread


def _table(columns: Sequence[ScoreColumn], rows: Sequence[Sequence[str]]) -> str:
    titles = ["Scene", "Queries"]
    titles += [
        f"{code(c.title)} {_UNITS[c.unit]} {'↑' if c.higher_is_better else '↓'}" for c in columns
    ]
    rules = ["---", *["---:"] * (len(titles) - 1)]
    return "".join(f"| {' | '.join(row)} |\n" for row in [titles, rules, *rows])


def code(text: str) -> str:
    """Return a stranger's text as a code span that is safe in a table's cell."""
    shown = plain(text).replace("`", "'").replace("|", "/").replace("\\", "/")
    cut = shown if len(shown) <= _LONGEST_SPAN else f"{shown[: _LONGEST_SPAN - 3]}..."
    return f"`{cut or ' '}`"


def _block(text: str) -> str:
    """Return lines of strangers as a block of code."""
    cut = text if len(text) <= _LONGEST_BLOCK else f"{text[:_LONGEST_BLOCK]}\n..."
    shown = "".join(
        letter if letter.isprintable() or letter == "\n" else "\N{REPLACEMENT CHARACTER}"
        for letter in cut.replace("`", "'")
    )
    return f"````text\n{shown}\n````\n"
