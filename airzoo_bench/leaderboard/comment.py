"""The comment on a pull request: Markdown, made of the artifact alone, bounded, without markup.

Whatever strangers wrote stands in code spans and blocks without backticks: there, GitHub
renders no link, no image, no mention and no reference.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from airzoo_bench.leaderboard.answer import Estimate, SealedAnswer
from airzoo_bench.leaderboard.artifact import Artifact, Shown
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.tables.model import plain, show_number

__all__ = ["MARK", "MOST_BYTES", "code", "comment_on"]

MARK = "<!-- airzoo-bench leaderboard -->"
MOST_BYTES = 65_300
"""GitHub takes 65,536 characters; mteb cuts here too."""

_LONGEST_BLOCK, _LONGEST_SPAN, _MOST_PARTS = 4000, 120, 200
_CUT = "\n_The rest did not fit into a comment; the job's log has all of it._\n"


def comment_on(artifact: Artifact) -> str:
    """Return the comment's text, at most `MOST_BYTES` long; its end is always kept."""
    last = _scored_commit(artifact)
    room = MOST_BYTES - len(last.encode()) - len(_CUT.encode())
    kept: list[str] = []
    for part in (f"{MARK}\n", *_PARTS[artifact.kind](artifact)):
        room -= len(part.encode()) + 1
        if room < 0:
            return "\n".join([*kept, _CUT, last])
        kept.append(part)
    return "\n".join([*kept, last])


def _scored_commit(artifact: Artifact) -> str:
    head, number = artifact.head, artifact.pull_request
    lines = [f"\nThis is about commit {head[:12]} alone; another push is looked at anew."]
    if artifact.kind in ("scored", "sealed", "withdrawn"):
        merge = f"gh pr merge {number} --squash --match-head-commit {head}"
        lines.append(f"Maintainers: `{merge}` merges it and nothing that was pushed later.")
    return "\n".join(lines) + "\n"


# --- by kind ---


def _nothing(artifact: Artifact) -> Iterator[str]:
    yield (
        "This pull request changes no submission: it is not for the board's branch, or all below "
        "`submissions/` is as it was where it began. (A submission is a folder "
        "`submissions/<benchmark>/<track>/<folder>`, committed.)\n"
    )


def _refused(artifact: Artifact) -> Iterator[str]:
    yield f"### {_named(artifact)} is refused\n"
    for problem in artifact.problems:
        yield _block(str(problem.error()))
    yield from _claimed(artifact)
    yield from _listed("Warnings", artifact.warnings)
    yield (
        "`airzoo-bench submission check FOLDER` finds faults of the folder on your own machine. "
        + (
            "The truth was opened: this counts as a try.\n"
            if artifact.truth
            else "Nothing of this counts as a try.\n"
        )
    )


def _withdrawn(artifact: Artifact) -> Iterator[str]:
    yield f"### {_named(artifact)} is withdrawn\n"
    yield "Its rows leave the board when this is merged; what was scored stays in its history.\n"


def _scored(artifact: Artifact) -> Iterator[str]:
    yield f"### {_named(artifact)}\n"
    if standing := artifact.standing:
        ranks = f"{standing.first}"
        if standing.last != standing.first:
            ranks += f" to {standing.last}"
        yield f"Rank **{ranks}** of {standing.methods} by {code(standing.score)}.\n"
        if standing.alike:
            names = [code(name) for name in standing.alike[:_MOST_PARTS]]
            yield f"Not told apart from {', '.join(names)} (paired test, 5 %, Holm).\n"
    columns = [column for column in artifact.columns if column.headline]
    titles = [_title(column) for column in columns]
    rows = artifact.rows[-_MOST_PARTS:]
    yield _markdown(
        ["Scene", "Queries", *titles],
        [
            [code(row.title), f"{row.queries:,}", *(_number(c, row.scores[c.key]) for c in columns)]
            for row in rows
        ],
    )
    if artifact.update:
        changed = [
            [code(row.title), *(_change(column, row.scores[column.key]) for column in columns)]
            for row in rows
            if any(s.before is not None and s.before != s.value for s in row.scores.values())
        ]
        yield (
            "Changed since the last version:\n\n" + _markdown(["Scene", *titles], changed)
            if changed
            else "No score differs from those of the last version.\n"
        )
    yield from _claimed(artifact)
    yield from _listed("Warnings", artifact.warnings)
    yield from _listed("Notes", artifact.notes)


def _sealed(artifact: Artifact) -> Iterator[str]:
    yield f"### {_named(artifact)}\n"
    if artifact.answer is None:
        yield (
            "Nothing is wrong with it. It was not scored against the sealed truth: the job was not "
            "approved, or failed by no fault of the submission. This does not count as a try.\n"
        )
    else:
        yield _sealed_table(artifact.answer)
        yield "Rounded to half a standard error, so that no try tells the answer of one query.\n"
    yield from _listed("Warnings", artifact.warnings)


_PARTS: dict[str, Callable[[Artifact], Iterator[str]]] = {
    "nothing": _nothing,
    "refused": _refused,
    "scored": _scored,
    "sealed": _sealed,
    "withdrawn": _withdrawn,
}


# --- parts ---


def _sealed_table(answer: SealedAnswer) -> str:
    columns = [column for column in answer.columns if column.headline]
    cells = [_estimate(column, answer.overall.get(column.key)) for column in columns]
    titles = ["Scene", "Queries", *(_title(column) for column in columns)]
    return _markdown(titles, [["`average`", f"{sum(answer.queries.values()):,}", *cells]])


def _claimed(artifact: Artifact) -> Iterator[str]:
    if artifact.agrees is None:
        return
    word = "does not contradict" if artifact.agrees else "differs from"
    yield f"The claimed result {word} the re-scored one.\n"
    if artifact.claimed:
        yield _block("\n".join(artifact.claimed))


def _listed(title: str, lines: Sequence[str]) -> Iterator[str]:
    if lines:
        yield f"{title}:\n"
        yield _block("\n".join(lines))


def _named(artifact: Artifact) -> str:
    if artifact.method:
        return f"{code(artifact.method)} by {code(artifact.team)}"
    return code(artifact.place.path) if artifact.folder else "This pull request"


def _title(column: ScoreColumn) -> str:
    unit = {"share": "%", "m": "m", "deg": "°"}[column.unit]
    return f"{code(column.title)} {unit} {'↑' if column.higher_is_better else '↓'}"


def _number(column: ScoreColumn, shown: Shown) -> str:
    value = _as_shown(column, shown.value)
    if shown.low is None and shown.high is None:
        return value
    return f"{value} [{_as_shown(column, shown.low)}, {_as_shown(column, shown.high)}]"


def _change(column: ScoreColumn, shown: Shown) -> str:
    return f"{_as_shown(column, shown.before)} → {_as_shown(column, shown.value)}"


def _estimate(column: ScoreColumn, found: Estimate | None) -> str:
    if found is None:
        return "–"
    error = found.standard_error
    spread = "" if error is None else f" ± {_as_shown(column, error)}"
    return _as_shown(column, found.value) + spread


def _as_shown(column: ScoreColumn, value: float | None) -> str:
    if value is None:
        return "inf"
    return show_number(100 * value if column.unit == "share" else value, 2)


def _markdown(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
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
        c if c.isprintable() or c == "\n" else "\N{REPLACEMENT CHARACTER}"
        for c in cut.replace("`", "'")
    )
    return f"````text\n{shown}\n````\n"
