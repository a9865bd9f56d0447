"""Killed or failing at any step, a run leaves what stood there or what it made, never a mixture."""

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


def cases(tmp_path: Path, kind: str, fault: str) -> list[dict[str, Any]]:
    command = [
        sys.executable,
        "-m",
        "tests.hostile.crash_points",
        str(tmp_path / "homes"),
        kind,
        fault,
    ]
    done = subprocess.run(
        command,
        cwd=Path(__file__).parents[2],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        check=True,
        timeout=HANGS_S,
    )
    found: list[dict[str, Any]] = json.loads(done.stdout)
    return found


def whole(letter: str, kind: str) -> dict[str, str]:
    result, records, figure = "out/result", "out/records", f"out/figures/{letter}.png"
    found = {result: letter, records: letter, figure: letter}
    if kind == "file":
        found = {result: letter, records: "a", "out/figures/a.png": "a"}
    extra = {"folder": {"out/benchmark.toml": ""}, "shared": {"out/thesis": "mine"}}
    return found | extra.get(kind, {})


@pytest.mark.parametrize("kind", list(crash_points.WRITERS))
@pytest.mark.parametrize("fault", ["failed", pytest.param("full", marks=pytest.mark.slow)])
def test_a_step_that_fails_leaves_what_stood_there(kind: str, fault: str, tmp_path: Path) -> None:
    found = cases(tmp_path, kind, fault)
    check_failures(found, kind)


def check_failures(found: list[dict[str, Any]], kind: str) -> None:
    assert len(found) > 3
    for case in found:
        # A step may fail without harm: one that makes what is there, or takes the old away.
        assert case["left"] in ([whole("a", kind)] if case["code"] == 1 else []) + [
            whole("b", kind)
        ]
        assert case["end"] == whole("b", kind)
    assert any(case["left"] == whole("a", kind) for case in found)


@pytest.mark.parametrize("kind", list(crash_points.WRITERS))
def test_killed_at_any_step(kind: str, tmp_path: Path) -> None:
    check_kills(cases(tmp_path, kind, "killed"), kind, in_one_step=kind == "file")


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["shared", "folder"])
def test_killed_at_any_line(kind: str, tmp_path: Path) -> None:
    check_kills(cases(tmp_path, kind, "line"), kind, in_one_step=False)


def check_kills(found: list[dict[str, Any]], kind: str, *, in_one_step: bool) -> None:
    assert len(found) > (3 if kind == "file" else 10)
    for case in found:
        left, either = case["left"], (whole("a", kind), whole("b", kind))
        assert left in either or (not in_one_step and "out/result" not in left)
        assert kind != "shared" or left["out/thesis"] == "mine"
        assert case["again"] == 0
        assert case["end"] == whole("b", kind)
        assert case["hidden"] == []
