"""Killed or failing at any step, a run leaves what was there or what it made, never a mixture."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.hostile import crash_points
from tests.support import HANGS_S

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="forks")
KINDS = pytest.mark.parametrize("kind", list(crash_points.WRITERS))


def cases(tmp_path: Path, kind: str, fault: str) -> list[dict[str, Any]]:
    module = "tests.hostile.crash_points"
    done = subprocess.run(
        [sys.executable, "-m", module, str(tmp_path / "homes"), kind, fault],
        cwd=Path(__file__).parents[2],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        check=True,
        timeout=HANGS_S,
    )
    found: list[dict[str, Any]] = json.loads(done.stdout)
    return found


def whole(letter: str, kind: str) -> dict[str, str]:
    others = "a" if kind == "file" else letter
    files = {"out/result": letter, "out/records": others, f"out/figures/{others}.png": others}
    return files | {"out/benchmark.toml" if kind == "folder" else "out/thesis": ""}


@KINDS
def test_a_step_that_fails_leaves_what_was_there(kind: str, tmp_path: Path) -> None:
    found = cases(tmp_path, kind, "failed")
    assert len(found) > 3
    for case in found:
        # A step may fail without harm: one that makes what is there, or takes the old away.
        either = [whole("a", kind)] * (case["code"] == 1) + [whole("b", kind)]
        assert case["left"] in either
        assert case["end"] == whole("b", kind)
    assert any(case["left"] == whole("a", kind) for case in found)


@KINDS
@pytest.mark.parametrize("fault", ["killed", pytest.param("line", marks=pytest.mark.slow)])
def test_killed_at_any_step(kind: str, fault: str, tmp_path: Path) -> None:
    found = cases(tmp_path, kind, fault)
    assert len(found) > (3 if kind == "file" else 10)
    for case in found:
        left = case["left"]
        incomplete = kind != "file" and "out/result" not in left
        assert left in (whole("a", kind), whole("b", kind)) or incomplete
        assert kind == "folder" or "out/thesis" in left
        assert case["again"] == 0
        assert case["end"] == whole("b", kind)
        assert case["hidden"] == []
