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
from airzoo_bench.core.validation import Name
from airzoo_bench.leaderboard.board import Place
from airzoo_bench.leaderboard.measured import Measured, Model, Row, Scene, Score
from airzoo_bench.leaderboard.submission import Account
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.tables.intervals import score_texts
from airzoo_bench.tables.method_table import UNITS
from airzoo_bench.tables.model import plain

MARK = "<!-- airzoo-bench leaderboard -->"
MOST_BYTES = 65_300
"""GitHub takes 65,536 characters."""

_LONGEST_BLOCK, _LONGEST_SPAN, _MOST_PARTS = 4000, 120, 200
_CUT = "\n_The rest did not fit into a comment; the job's log has all of it._\n"
_NOTHING = (
    "This pull request changes no submission: it is not for the board's branch, or all below "
    "`submissions/` is as it was where it began. (A submission is a folder "
    "`submissions/<benchmark>/<track>/<folder>`, committed.)\n"
)
_NOT_OPENED = (
    "Nothing is wrong with it. It was not scored against the sealed truth: the job was not "
    "approved, or failed by no fault of the submission. This does not count as a try.\n"
)
_ROUNDED = "Rounded to half a standard error, so that no try tells the answer of one query.\n"
_WITHDRAWN = "Its rows leave the board when this is merged; its scores stay in its history.\n"


class Found(Model):
    """The findings on a pull request at the commit `head`.

    The kind is ``nothing`` where it changes no submission, and ``sealed`` where it is sound and to
    be scored, or scored, against a sealed truth. `tree` is a hash of the submission's files, and
    `opened` whether the truth was. `row` is the one that the board would show, among `ranked`
    methods, of which those of `alike` are not told apart from it.
    """

    schema_version: Literal[3] = Field(default=3, alias="schema")
    kind: Literal["nothing", "refused", "scored", "sealed", "withdrawn"] = "nothing"
    pull_request: Account
    account: Account
    head: Annotated[str, Field(pattern=r"^([0-9a-f]{40}|[0-9a-f]{64})$")]
    benchmark: Name | None = None
    track: Name | None = None
    folder: Name | None = None
    tree: str = ""
    method: str = ""
    team: str = ""
    problems: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    columns: tuple[ScoreColumn, ...] = ()
    scenes: tuple[Scene, ...] = ()
    row: Row | None = None
    ranked: int = 0
    alike: tuple[str, ...] = ()
    opened: bool = False
    answer: Measured | None = None

    @property
    def place(self) -> Place:
        """The folder of the submission."""
        if self.benchmark is None or self.track is None or self.folder is None:
            raise SubmissionError("the findings are not about a submission")
        return Place(self.benchmark, self.track, self.folder)


def write_found(path: Path, found: Found) -> None:
    """Write findings, whole or not at all."""
    with atomic_write(path, "w") as stream:
        stream.write(found.model_dump_json(by_alias=True, indent=1) + "\n")


def read_found(path: Path) -> Found:
    """Read findings that another job of the same run has written."""
    try:
        return Found.model_validate_json(read_text(path, SubmissionError, "file of findings"))
    except ValueError as error:
        raise SubmissionError(f"not a file of findings: {error}", where=path) from error


# --- the comment ---


def comment_on(found: Found) -> str:
    """Return the comment's text, at most `MOST_BYTES` long; its end is never cut."""
    last = f"\nThis is about commit {found.head[:12]} alone; another push is looked at anew.\n"
    if found.kind in ("scored", "sealed", "withdrawn"):
        merge = f"gh pr merge {found.pull_request} --squash --match-head-commit {found.head}"
        last += f"Maintainers: `{merge}` merges it and nothing that was pushed later.\n"
    room = MOST_BYTES - len(last.encode()) - len(_CUT.encode())
    parts: list[str] = []
    for part in (f"{MARK}\n", *_parts(found)):
        room -= len(part.encode()) + 1
        if room < 0:
            return "\n".join([*parts, _CUT, last])
        parts.append(part)
    return "\n".join([*parts, last])


def _parts(found: Found) -> Iterator[str]:
    """Yield the paragraphs, the most important first."""
    if found.kind == "nothing":
        yield _NOTHING
        return
    name = f"{code(found.method)} by {code(found.team)}"
    if not found.method:
        name = code(found.place.path) if found.folder else "This pull request"
    end = {"refused": " is refused", "withdrawn": " is withdrawn"}.get(found.kind, "")
    yield f"### {name}{end}\n"
    yield from map(_block, found.problems)
    if found.row is not None:
        yield from _scores(found, found.row)
    if found.kind == "withdrawn":
        yield _WITHDRAWN
    if found.kind == "sealed":
        yield _ROUNDED if found.row else _NOT_OPENED
    for title, lines in (("Warnings", found.warnings), ("Notes", found.row and found.row.notes)):
        if lines:
            yield f"{title}:\n\n" + _block("\n".join(lines))
    if found.kind == "refused":
        counts = "The truth was opened: this is a try" if found.opened else "This is no try"
        yield f"`airzoo-bench submission check FOLDER` finds faults on your machine. {counts}.\n"


def _scores(found: Found, row: Row) -> Iterator[str]:
    columns = [column for column in found.columns if column.headline]
    first = row.scores.get(columns[0].key) if columns else None
    if first is not None and first.rank is not None:
        ranks = " to ".join(map(str, dict.fromkeys(first.rank)))
        yield f"Rank **{ranks}** of {found.ranked} by {code(columns[0].title)}.\n"
    if found.alike:
        names = ", ".join(code(name) for name in found.alike[:_MOST_PARTS])
        yield f"Not told apart from {names} (paired test, 5 %, Holm).\n"
    lines = [
        [code(scene.title), f"{scene.queries or 0:,}"]
        + [_text(c, *row.scenes[scene.id].get(c.key, (None,))) for c in columns]
        for scene in found.scenes[:_MOST_PARTS]
        if scene.id in row.scenes
    ]
    every = ["`average`", f"{sum(scene.queries or 0 for scene in found.scenes):,}"]
    overall = [row.scores.get(column.key, Score()) for column in columns]
    yield _table(columns, [*lines, every + list(map(_estimate, columns, overall))])
    if len(row.history) > 1:
        before = [row.history[1].scores.get(column.key) for column in columns]
        pairs = list(zip(columns, before, (one.value for one in overall), strict=True))
        if any(old != new for _, old, new in pairs):
            changed = [f"{_text(c, old)} → {_text(c, new)}" for c, old, new in pairs]
            yield f"Changed since the last version:\n\n{_table(columns, [every + changed])}"
        else:
            yield "No score differs from those of the last version.\n"


def _estimate(column: ScoreColumn, score: Score) -> str:
    """Write an average with its interval or, of a sealed truth, its standard error."""
    if score.standard_error is None:
        return _text(column, score.value, score.low, score.high)
    return f"{_text(column, score.value)} ± {_text(column, score.standard_error)}"


def _text(column: ScoreColumn, value: float | None, *limits: float | None) -> str:
    """Write a value and its interval."""
    shown, *ends = score_texts(column, (value, *limits))
    return f"{shown} [{', '.join(ends)}]" if {*limits} - {None} else shown


def _table(columns: Sequence[ScoreColumn], rows: Sequence[Sequence[str]]) -> str:
    titles = ["Scene", "Queries"]
    titles += [
        f"{code(c.title)} {UNITS[c.unit]} {'↑' if c.higher_is_better else '↓'}" for c in columns
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
