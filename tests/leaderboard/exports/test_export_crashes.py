"""An export killed at any step leaves the earlier one or its own, whole; the next completes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="forks")


@pytest.mark.parametrize("kind", ["codabench", "evalai"])
def test_killed_at_any_step(kind: str, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.leaderboard.exports.crashes", str(tmp_path), kind],
        cwd=Path(__file__).parents[3],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        check=True,
        timeout=600,
    )
    found = json.loads(done.stdout)
    old, new = found["wholes"]["old"], found["wholes"]["new"]
    assert old != new
    killed = [case for case in found["cases"] if case["code"] < 0]
    assert len(killed) > 5
    for case in found["cases"]:
        assert case["left"] in (old, new)
        assert case["again"] == 0
        assert case["end"] == new
        assert case["hidden"] == []
    assert any(case["left"] == old for case in killed)
