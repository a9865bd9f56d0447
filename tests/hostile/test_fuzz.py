"""Whatever is read may be damaged or hostile: one message and exit code 2, never a traceback.

CONTRIBUTING.md says how to run more of it, and how to see a failure again.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
GROUPS = ("", "retrieval", "matching", "reconstruction", "surveys", "results", "audit")
"""Parts of the names of kinds; the first is all of them."""


def fuzz(seed: int, cases: int, only: str, keep: Path) -> None:
    """Run cases in a process of its own, which they may end."""
    command = [sys.executable, "-m", "tests.hostile.fuzz", "--seed", str(seed), "--keep", str(keep)]
    command += ["--cases", str(cases), "--only", only]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    running = keep / "running"
    found = [json.loads(line) for line in done.stdout.splitlines()]
    report = "\n\n".join(
        f"{one['command']}: {one['why']}\n{one['said'][-1500:]}\n"
        f"again: python -m tests.hostile.fuzz --seed {one['seed']} --case {one['case']} "
        f"--only '{only}'"
        for one in found[:5]
    )
    assert not found, f"{len(found)} of {cases} cases\n{report}"
    assert not running.exists(), f"seed and case {running.read_text()} ended the process"
    assert done.returncode == 0, done.stderr[-3000:]


@pytest.mark.slow
@pytest.mark.parametrize("only", GROUPS)
def test_no_input_makes_a_traceback_in_20_000_cases(only: str, tmp_path: Path) -> None:
    fuzz(20_262, 3000, only, tmp_path)
