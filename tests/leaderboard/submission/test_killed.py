"""Killed at any of a hundred moments, `submission new` leaves the old folder or the new one."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.leaderboard.submission.support import write_board
from tests.support import HANGS_S

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="forks")
FILES = ["made/retrieval/salad/" + name for name in ("{}", "result.json", "submission.toml")]


@pytest.mark.parametrize("kind", [pytest.param("made", marks=pytest.mark.slow), "replaced"])
def test_whole_or_not_at_all(kind: str, tmp_path: Path) -> None:
    write_board(tmp_path / "source")
    home = tmp_path / "home"
    home.mkdir()
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            f"{__package__}.killed",
            str(home),
            str(tmp_path / "source"),
            kind,
            "2",
        ],
        cwd=Path(__file__).parents[3],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        check=True,
        text=True,
        timeout=HANGS_S,
    )
    found = json.loads(done.stdout)
    assert len(found) >= 100
    whole = {letter: [file.format(letter) for file in FILES] for letter in "ab"}
    first = [] if kind == "made" else whole["a"]
    seen = set()
    for case in found:
        assert list(case["left"]) in (first, whole["b"])
        seen.add(tuple(case["left"]))
        letters = {path[-1] for path in case["left"] if path.endswith(("/a", "/b"))}
        for letter in letters:
            assert f'summary = "{letter}"' in case["left"][FILES[2]]
            assert case["left"][FILES[1]] == letter
        assert case["end"] == found[0]["end"]
        assert list(case["end"]) == whole["b"]
    assert len(seen) == 2
