"""The comment: bounded, and nothing that strangers wrote is rendered."""

from __future__ import annotations

from typing import Any

import pytest

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.leaderboard.comment import MARK, MOST_BYTES, Found, code, comment_on
from airzoo_bench.leaderboard.measured import Row, Scene, Score, Version
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


def found(kind: Any = "scored", **more: Any) -> Found:
    stated = {"pull_request": 5, "account": 7, "head": "a" * 40, "benchmark": "made"}
    return Found(kind=kind, **(stated | {"track": "retrieval", "folder": "mine"} | more))


def row(**more: Any) -> Row:
    """Return a row with one score in one scene, and an earlier version."""
    score = Score(value=0.5, low=0.25, high=0.75, rank=(2, 5))
    versions = [Version(number=n, date="", files="", scores={"recall@1": 0.4}) for n in (2, 1)]
    facts = {"scores": {"recall@1": score}, "scenes": {"east": {"recall@1": (0.5, 0.25, 0.75)}}}
    return Row(kind="re-scored", method="Salad", history=versions, **(facts | more))


@pytest.mark.parametrize("text", HOSTILE, ids=lambda text: ascii(text)[:30])
def test_names_are_not_rendered(text: str) -> None:
    scenes = (Scene(id="east", title=text, queries=3),)
    facts = {"method": text or "x", "team": text, "columns": (COLUMN,), "scenes": scenes}
    said = {"warnings": (text,), "row": row(notes=(text,)), "alike": (text, text), "ranked": 4}
    found_text = comment_on(found(**facts, **said))
    seen = outside_code(found_text)
    assert not [part for part in BAD if part in seen]
    assert seen.count("<!--") == 1
    assert all(c.isprintable() or c == "\n" for c in found_text)
    tables = [line for line in found_text.split("\n") if line.startswith("| ")]
    assert len({line.count("|") for line in tables[:3]}) == 1


@pytest.mark.parametrize("text", HOSTILE, ids=lambda text: ascii(text)[:30])
def test_messages_are_not_rendered(text: str) -> None:
    problem = str(SubmissionError(text, where=text, expected=text, fix=text))
    made = comment_on(found("refused", problems=(problem,) * 3, warnings=(text,)))
    assert not [part for part in BAD if part in outside_code(made)]
    assert made.startswith(f"{MARK}\n")


def test_comments_are_bounded_and_their_blocks_are_closed() -> None:
    problem = "\U0001f4a3" * 60_000
    made = comment_on(found("refused", problems=(problem,) * 500))
    assert len(made.encode()) <= MOST_BYTES
    assert "did not fit" in made
    assert "This is about commit aaaaaaaaaaaa" in outside_code(made)
    columns = tuple(COLUMN.model_copy(update={"key": f"k{n}"}) for n in range(60))
    scenes = tuple(Scene(id=f"s{n}", title="s" * 120, queries=1) for n in range(1000))
    parts = {scene.id: {c.key: (0.5, 0.4, 0.6) for c in columns} for scene in scenes}
    made = comment_on(found(columns=columns, scenes=scenes, row=row(scenes=parts)))
    assert len(made.encode()) <= MOST_BYTES
    assert code("a`b|c\nd") == "`a'b/c d`"


def test_scores_have_intervals_ranks_and_changes() -> None:
    scenes = (Scene(id="east", title="East", queries=1234),)
    facts = {"method": "Salad", "columns": (COLUMN,), "scenes": scenes, "row": row()}
    made = comment_on(found(**facts, ranked=9, alike=("A", "B")))
    assert "Rank **2 to 5** of 9 by `R@1`." in made
    assert "Not told apart from `A`, `B`" in made
    assert "| `East` | 1,234 | 50.00 [25.00, 75.00] |" in made
    assert "| `average` | 1,234 | 40.00 → 50.00 |" in made
    assert "gh pr merge 5 --squash --match-head-commit " + "a" * 40 in made
    far = row(scenes={"east": {"recall@1": (float("inf"), None, None)}})
    assert "| `East` | 1,234 | inf |" in comment_on(found(**facts | {"row": far}))
    assert Found.model_validate_json(found(row=far).model_dump_json(by_alias=True)).row == far
