"""Events as GitHub sends them, and what is none."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.leaderboard.ci.event import PullRequest, read_event
from tests.leaderboard.ci.repositories import event, write_event

HEAD = "c" * 40


def test_event_of_github(tmp_path: Path) -> None:
    path = write_event(tmp_path / "event.json", event(12, HEAD, 99, merged=True))
    expected = PullRequest(12, HEAD, "refs/pull/12/head", "main", 99, merged=True)
    assert read_event(path) == expected


def changed(**parts: Any) -> dict[str, Any]:
    content = event(12, HEAD)
    content["pull_request"] |= parts
    return content


@pytest.mark.parametrize(
    "content",
    [
        {},
        [],
        None,
        {"pull_request": None},
        changed(number="12; rm -rf /"),
        changed(number=0),
        changed(head={"sha": "refs/heads/main"}),
        changed(head={"sha": "--upload-pack=x"}),
        changed(user={"id": "7"}),
        changed(user={"login": "x"}),
    ],
)
def test_what_is_no_event_is_a_fault_with_a_message(tmp_path: Path, content: Any) -> None:
    path = tmp_path / "event.json"
    path.write_text(json.dumps(content))
    with pytest.raises(SubmissionError, match="not the event of a pull request"):
        read_event(path)


def test_no_json(tmp_path: Path) -> None:
    (tmp_path / "event.json").write_text("[" * 100_000)
    with pytest.raises(SubmissionError, match="not the event of a pull request"):
        read_event(tmp_path / "event.json")
