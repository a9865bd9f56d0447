"""Whatever is read may be damaged or hostile: one message and exit code 2, never a traceback.

CONTRIBUTING.md says how to run more of it, and how to see a failure again.
"""

from __future__ import annotations

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import pytest

from tests.support import ROOT

GROUPS = ("reconstruction", "", "matching", "retrieval", "surveys", "results", "audit")
"""Parts of the names of kinds, the longest runs first; the empty one is all of them."""


def faults_of(home: Path, only: str) -> str:
    """Run cases in a process of their own, which a case may end."""
    options = {"--seed": 20_262, "--cases": 3200, "--only": only, "--keep": home / f"a{only}"}
    words = [str(word) for option in options.items() for word in option]
    command = [sys.executable, "-m", "tests.hostile.fuzz", *words]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if (running := home / f"a{only}/running").exists():
        return f"--only {only}: seed and case {running.read_text()} ended the process"
    return done.stdout[-8000:] + done.stderr[-3000:] if done.returncode else ""


@pytest.mark.slow
def test_no_input_makes_a_traceback_in_22_000_cases(tmp_path) -> None:
    with ThreadPoolExecutor(2) as pool:
        faults = [*filter(None, pool.map(partial(faults_of, tmp_path), GROUPS))]
    assert not faults, "\n".join(faults)
