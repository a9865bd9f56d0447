"""How much of the package one score runs through, which may only fall."""

from __future__ import annotations

import pytest

from tests.walk import walk_template

# Files and functions; lower them with each room that is written anew (`python -m tests.walk`).
MOST = {"retrieval": (41, 404), "matching": (46, 436), "reconstruction": (50, 575)}


@pytest.mark.slow
@pytest.mark.parametrize("track", MOST)
def test_a_score_runs_through_no_more_files_than_before(track: str) -> None:
    counts = walk_template(track)
    files, functions = MOST[track]
    assert 0 < counts["files"] <= files
    assert 0 < counts["functions"] <= functions
