"""What whole sessions print and write is what was recorded, byte for byte."""

from __future__ import annotations

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
