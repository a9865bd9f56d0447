"""The comment: bounded, and nothing that strangers wrote is rendered."""

from __future__ import annotations

from typing import Any

import pytest

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.leaderboard.comment import (
    MARK,
    MOST_BYTES,
    Artifact,
    SceneScores,
    Standing,
    code,
    comment_on,
)
from airzoo_bench.results.result import ScoreColumn
from tests.leaderboard.rendered import outside_code

HOSTILE = [
    "@everyone #1 GH-1 a@b.example 0123456789abcdef0123456789abcdef01234567",
    "[click](https://evil.example) ![x](https://evil.example/x.png)",
    "<img src=x onerror=alert(1)>",
    "`@admin` ``@admin`` ```\n@admin\n```",
    "````\n@admin\n````",
    "| a | b |\n| --- | --- |",
    "<!-- airzoo-bench leaderboard -->",
    "\x1b[31mred\x1b[0m\u202egnp.exe",
    "a\r\n\r\n# Heading\n\n- [ ] task",
    "x" * 10_000,
    "`" * 500,
    "",
]
BAD = ("@", "#1", "evil", "<img", "admin", "Heading", "gnp", "GH-1", "0123456789")
COLUMN = ScoreColumn(
    key="recall@1", title="R@1", unit="share", higher_is_better=True, average="mean", headline=True
)


def artifact(kind: Any = "scored", **more: Any) -> Artifact:
    stated = {"pull_request": 5, "account": 7, "head": "a" * 40, "benchmark": "made"}
    return Artifact(kind=kind, **(stated | {"track": "retrieval", "folder": "mine"} | more))


@pytest.mark.parametrize("text", HOSTILE, ids=lambda text: ascii(text)[:30])
def test_names_are_not_rendered(text: str) -> None:
    row = SceneScores(title=text, queries=3, scores={"recall@1": (0.5, None, None, 0.4)})
    standing = Standing(score=text, first=1, last=3, methods=4, alike=(text, text))
    said = {"warnings": (text,), "notes": (text,), "claimed": (text,)}
    facts = {"method": text or "x", "team": text, "columns": (COLUMN,), "rows": (row,)}
    found = comment_on(artifact(**facts, **said, standing=standing, update=True))
    seen = outside_code(found)
    assert not [part for part in BAD if part in seen]
    assert seen.count("<!--") == 1
    assert all(c.isprintable() or c == "\n" for c in found)
    tables = [line for line in found.split("\n") if line.startswith("| ")]
    assert len({line.count("|") for line in tables[:3]}) == 1


@pytest.mark.parametrize("text", HOSTILE, ids=lambda text: ascii(text)[:30])
def test_messages_are_not_rendered(text: str) -> None:
    problem = str(SubmissionError(text, where=text, expected=text, fix=text))
    found = comment_on(artifact("refused", problems=(problem,) * 3, warnings=(text,)))
    assert not [part for part in BAD if part in outside_code(found)]
    assert found.startswith(f"{MARK}\n")


def test_comments_are_bounded_and_their_blocks_are_closed() -> None:
    problem = "\U0001f4a3" * 60_000
    found = comment_on(artifact("refused", problems=(problem,) * 500))
    assert len(found.encode()) <= MOST_BYTES
    assert "did not fit" in found
    assert "This is about commit aaaaaaaaaaaa" in outside_code(found)
    columns = tuple(COLUMN.model_copy(update={"key": f"k{n}"}) for n in range(60))
    scores = {c.key: (0.5, 0.4, 0.6, 0.3) for c in columns}
    rows = tuple(SceneScores(title="s" * 120, queries=1, scores=scores) for _ in range(1000))
    found = comment_on(artifact(columns=columns, rows=rows, update=True))
    assert len(found.encode()) <= MOST_BYTES
    assert code("a`b|c\nd") == "`a'b/c d`"


def test_scores_have_intervals_ranks_and_changes() -> None:
    shown = (0.5, 0.25, 0.75, 0.4)
    rows = (SceneScores(title="East", queries=1234, scores={"recall@1": shown}),)
    standing = Standing(score="R@1", first=2, last=5, methods=9, alike=("A", "B"))
    facts = {"method": "Salad", "team": "Lab", "columns": (COLUMN,), "rows": rows}
    found = comment_on(artifact(**facts, standing=standing, update=True))
    assert "Rank **2 to 5** of 9 by `R@1`." in found
    assert "Not told apart from `A`, `B`" in found
    assert "| `East` | 1,234 | 50.00 [25.00, 75.00] |" in found
    assert "| `East` | 1,234 | 40.00 → 50.00 |" in found
    assert "gh pr merge 5 --squash --match-head-commit " + "a" * 40 in found
    infinite = (SceneScores(title="East", queries=1, scores={"recall@1": (None,) * 4}),)
    assert "| `East` | 1 | inf |" in comment_on(artifact(columns=(COLUMN,), rows=infinite))
