"""The findings of CI on a pull request, and the comment that is made of them alone.

Whatever strangers wrote stands in code spans and blocks without backticks: there, GitHub
renders no link, no image, no mention and no reference.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.files import read_text
from airzoo_bench.leaderboard.answers import Answer, Hash, Model, Number, Score
from airzoo_bench.leaderboard.board import Place
from airzoo_bench.leaderboard.submission import Account
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.tables.layouts import UNITS, score_texts
from airzoo_bench.tables.model import plain

MARK = "<!-- airzoo-bench leaderboard -->"

_LONGEST_BLOCK, _LONGEST_SPAN, _MOST_SCENES = 6000, 120, 200  # GitHub takes 65,536 characters
_SAID = {
    "nothing": "This pull request changes no submission below `submissions/` that is for the "
    "board's branch.\n",
    "not opened": "Nothing is wrong with it. It was not scored against the sealed truth: the job "
    "was not approved, or failed by no fault of the submission. This does not count as a try.\n",
    "sealed": "Rounded to half a standard error, so that no try tells the answer of one query.\n",
    "withdrawn": "Its rows leave the board when this is merged; its scores stay in its history.\n",
    "refused": "`airzoo-bench submission check FOLDER` finds faults on your machine.\n",
}


class Found(Model):
    """The findings on a pull request; ``sealed`` is a sound one against a sealed truth."""

    kind: Literal["nothing", "refused", "scored", "sealed", "withdrawn"] = "nothing"
    pull_request: Account
    account: Account
    head: Annotated[str, Field(pattern=r"^([0-9a-f]{40}|[0-9a-f]{64})$")]
    place: Place | None = None
    tree: Hash = ""
    method: str = ""
    team: str = ""
    problems: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    answer: Answer | None = None  # with the row that the board would show, among ranked methods
    ranked: int = 0
    opened: bool = False  # the truth was


def read_found(path: Path) -> Found:
    """Read findings that another job of the same run has written."""
    return Found.model_validate_json(read_text(path, SubmissionError, "file of findings"))


def comment_on(found: Found) -> str:
    """Return the comment's text; the job's log has what is too long for it."""
    about = f"\nThis is about commit {found.head[:12]} alone; another push is looked at anew.\n"
    parts = [f"{MARK}\n", *_parts(found), about]
    if found.kind in ("scored", "sealed", "withdrawn"):
        merge = f"gh pr merge {found.pull_request} --squash --match-head-commit {found.head}"
        parts[-1] += f"Maintainers: `{merge}` merges it and nothing that was pushed later.\n"
    return "\n".join(parts)


def _parts(found: Found) -> Iterator[str]:
    """Yield the paragraphs, the most important first."""
    kind, answer = found.kind, found.answer
    if kind != "nothing":
        name = code("/".join(found.place)) if found.place else "This pull request"
        name = f"{code(found.method)} by {code(found.team)}" if found.method else name
        yield f"### {name}{f' is {kind}' if kind in ('refused', 'withdrawn') else ''}\n"
    if found.problems:
        yield _block("\n\n".join(found.problems))
    if answer is not None:
        yield from _scores(answer, found.ranked)
    if said := _SAID.get("not opened" if kind == "sealed" and answer is None else kind):
        yield said
    if kind == "refused" and found.opened:
        yield "The truth was opened: this is a try.\n"
    for title, lines in (("Warnings", found.warnings), ("Notes", answer and answer.row.notes)):
        if lines:
            yield f"{title}:\n\n" + _block("\n".join(lines))


def _scores(answer: Answer, ranked: int) -> Iterator[str]:
    """Yield the rank, and the scores by scene, over all scenes, and of the last version."""
    columns, row = [column for column in answer.columns if column.headline], answer.row
    overall = [row.scores.get(column.key, Score()) for column in columns]
    if columns and overall[0].rank is not None:
        ranks = " to ".join(map(str, dict.fromkeys(overall[0].rank)))
        yield f"Rank **{ranks}** of {ranked} by {code(columns[0].title)}.\n"
    scenes = answer.head.scenes
    heads = (f"{code(c.title)} {UNITS[c.unit]} {'↓↑'[c.higher_is_better]}" for c in columns)
    lines = [["Scene", "Queries", *heads], ["---", *["---:"] * (1 + len(columns))]]
    lines += [
        [code(scene.title), f"{scene.queries or 0:,}"]
        + [_text(c, *row.scenes[scene.id].get(c.key, (None,))) for c in columns]
        for scene in scenes[:_MOST_SCENES]
        if scene.id in row.scenes
    ]
    every = f"{sum(scene.queries or 0 for scene in scenes):,}"
    average = [_text(c, s.value, s.low, s.high) for c, s in zip(columns, overall, strict=True)]
    lines.append(["`average`", every, *average])
    if len(row.history) > 1:
        before = [_text(column, row.history[1].scores.get(column.key)) for column in columns]
        lines.append(["the last version", every, *before])
    yield "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _text(column: ScoreColumn, value: Number, *limits: Number) -> str:
    """Write a value and its interval."""
    shown, *ends = score_texts(column, (value, *limits))
    return f"{shown} [{', '.join(ends)}]" if {*limits} - {None} else shown


def code(text: str) -> str:
    """Return a stranger's text as a code span that is safe in a table's cell."""
    shown = plain(text).replace("`", "'").replace("|", "/").replace("\\", "/")
    return f"`{shown[:_LONGEST_SPAN] or ' '}`"


def _block(text: str) -> str:
    """Return lines of strangers as a block of code."""
    lines = text[:_LONGEST_BLOCK].replace("`", "'").split("\n")
    return "````text\n" + "\n".join(map(plain, lines)) + "\n````\n"
