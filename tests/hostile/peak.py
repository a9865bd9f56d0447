"""The most memory that a command takes, measured in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from tests.support import HANGS_S

_DRIVER = """
import re, sys
from airzoo_bench.cli.main import main
try:
    main()
except SystemExit as done:
    code = int(done.code or 0)
else:
    code = 0
status = open("/proc/self/status").read()
sys.stderr.write("\\npeak " + re.search(r"VmHWM:\\s+(\\d+)", status)[1])
sys.exit(code)
"""
"""Of a child, `ru_maxrss` counts what its parent held when it was forked; VmHWM does not."""


@dataclass(frozen=True)
class Ended:
    """How a command ended: exit code, peak of its memory in bytes, what it said."""

    code: int
    peak: int
    said: str


def run(*arguments: object, data: Path, seconds: float = HANGS_S) -> Ended:
    """Run the command line in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", _DRIVER, *map(str, arguments)],
        env=os.environ | {"AIRZOO_BENCH_DATA": str(data), "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=seconds,
        check=False,
    )
    said, _, peak = done.stderr.rpartition("\npeak ")
    assert peak, f"ended with {done.returncode}: {done.stderr[-2000:]}"
    return Ended(done.returncode, int(peak) * 1024, said)
