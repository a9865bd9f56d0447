"""What whole sessions print and write is what was recorded, byte for byte."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.frozen.transcripts import HERE, SESSIONS, made_with, replay

SLOW = ("brighton", "mini")


@pytest.mark.parametrize(
    "session",
    [pytest.param(name, marks=pytest.mark.slow if name in SLOW else ()) for name in SESSIONS],
)
def test_a_session_is_as_it_was_recorded(
    session: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    recorded = (HERE / f"{session}.txt").read_text(encoding="utf-8")
    if recorded.splitlines()[0] != made_with():
        pytest.skip(f"recorded with other libraries or another processor; here {made_with()}")
    if session == "brighton":
        request.getfixturevalue("brighton")
    assert replay(session, tmp_path) == recorded


def test_the_page_of_airzoo_mini_shows_what_the_demo_printed() -> None:
    page = (HERE.parents[1] / "docs" / "airzoo-mini.md").read_text(encoding="utf-8")
    [shown] = re.findall(r"^```\n(SIFT and VLAD on .*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert f"$ airzoo-bench demo --out r\n{shown}" in (HERE / "mini.txt").read_text("utf-8")
