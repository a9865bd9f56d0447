"""What a command loads before it knows what is asked for."""

from __future__ import annotations

import subprocess
import sys

from tests.support import HANGS_S

HEAVY = ("numpy", "pandas", "scipy", "matplotlib", "rasterio", "pyproj", "faiss", "pydantic")
CALLS = [
    *("--help", "--version", "table --help", "check -h", "plot -h"),
    *("eval --help", "baseline --help", "prepare --help", "mini render -h"),
]
RUN = f"""
import sys
from airzoo_bench.cli.main import main
for call in {CALLS!r}:
    sys.argv = ["airzoo-bench", *call.split()]
    try:
        main()
    except SystemExit as done:
        assert not done.code, (call, done.code)
    loaded = {{name.partition(".")[0] for name in sys.modules}}
    assert loaded.isdisjoint({HEAVY!r}), (call, loaded.intersection({HEAVY!r}))
"""


def test_help_loads_nothing_heavy() -> None:
    command = [sys.executable, "-c", RUN]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=HANGS_S)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("Usage:") == len(CALLS) - 1
