"""Whatever is read may be damaged or hostile: one message and exit code 2, never a traceback.

CONTRIBUTING.md says how to run more of it, and how to see a failure again.
"""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.support import ROOT

GROUPS = ("", "retrieval", "matching", "reconstruction", "surveys", "results", "audit")
"""Parts of the names of kinds; the first is all of them."""


@pytest.mark.slow
@pytest.mark.parametrize("only", GROUPS)
def test_no_input_makes_a_traceback_in_22_000_cases(only, tmp_path) -> None:
    """They run in a process of its own, which a case may end."""
    options = {"--seed": 20_262, "--cases": 3200, "--only": only, "--keep": tmp_path}
    words = [str(word) for option in options.items() for word in option]
    command = [sys.executable, "-m", "tests.hostile.fuzz", *words]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    running = tmp_path / "running"
    if running.exists():
        pytest.fail(f"seed and case {running.read_text()} ended the process")
    assert done.returncode == 0, done.stdout[-8000:] + done.stderr[-3000:]
