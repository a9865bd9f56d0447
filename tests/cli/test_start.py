"""What a command loads before it knows what is asked for."""

from __future__ import annotations

import subprocess
import sys
from typing import get_args

import pytest

from airzoo_bench.cli import check_geometry
from airzoo_bench.datasets.geometry_checks.depth_frames import PairRule
from airzoo_bench.datasets.geometry_checks.depth_maps import DepthKind

HEAVY = ("numpy", "pandas", "scipy", "matplotlib", "rasterio", "pyproj", "faiss")
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


@pytest.mark.parametrize("call", [["--help"], ["--version"], ["table", "--help"], ["plot", "-h"]])
def test_help_loads_nothing_heavy(call: list[str]) -> None:
    command = [sys.executable, "-c", RUN, *call]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    loaded = {name.partition(".")[0] for name in done.stderr.split()}
    assert "airzoo_bench" in loaded
    # Of one command's help typer itself loads pydantic.
    heavy = {*HEAVY, *["pydantic"] * (len(call) == 1)}
    assert loaded.isdisjoint(heavy), loaded.intersection(heavy)


def test_choices_are_those_of_the_checks() -> None:
    assert get_args(check_geometry.DepthKinds) == tuple(DepthKind)
    assert get_args(check_geometry.PairRules) == tuple(PairRule)
