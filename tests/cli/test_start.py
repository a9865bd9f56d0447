"""What a command loads before it knows what is asked for."""

from __future__ import annotations

import subprocess
import sys

import pytest

from airzoo_bench.core.registry import TRACKS
from tests.support import HANGS_S

HEAVY = ("numpy", "pandas", "scipy", "matplotlib", "rasterio", "pyproj", "faiss", "pydantic")
RUN = """
import sys
from airzoo_bench.cli.main import main
sys.argv = ["airzoo-bench", *sys.argv[1:]]
try:
    main()
except SystemExit as done:
    assert not done.code, done.code
print(*sorted(sys.modules), file=sys.stderr)
"""


@pytest.mark.parametrize(
    "call",
    [
        *("--help", "--version", "table --help", "check -h", "plot -h", "plot recall -h"),
        *("eval --help", *(f"eval {track} -h" for track in TRACKS.names())),
        *("baseline --help", *(f"baseline {track} -h" for track in TRACKS.names())),
        *("prepare --help", "mini render -h"),
    ],
)
def test_help_loads_nothing_heavy(call: str) -> None:
    command = [sys.executable, "-c", RUN, *call.split()]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=HANGS_S)
    loaded = {name.partition(".")[0] for name in done.stderr.split()}
    assert "airzoo_bench" in loaded
    assert loaded.isdisjoint(HEAVY), loaded.intersection(HEAVY)
