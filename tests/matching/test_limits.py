"""Bounds of what a protocol may ask for, and an end of it by Ctrl-C."""

from __future__ import annotations

import resource
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
import tomli_w

from tests.matching.world import N_QUERIES, SIZE, World
from tests.support import HANGS_S, run_main

# The command, which says when the solver is first called.
INTERRUPTED = """
from airzoo_bench.matching import solving
solve = solving._solve_rows
def announce_and_solve(*arguments):
    print("solving", flush=True)
    return solve(*arguments)
solving._solve_rows = announce_and_solve
from airzoo_bench.__main__ import main
main()
"""


def with_solver(world: World, path: Path, changes: dict[str, Any]) -> Path:
    """Write the world's protocol with other values of its solver."""
    values = world.protocol.model_dump(mode="json", by_alias=True, exclude_none=True)
    values["solver"] |= changes
    path.write_text(tomli_w.dumps(values))
    return path


@pytest.mark.parametrize(
    ("key", "value"), [("max_trials", 999), ("max_matches", 10**9), ("confidence", 1.0)]
)
def test_bounds_of_protocols(
    world: World, tmp_path: Path, key: str, value: float, capsys: pytest.CaptureFixture[str]
) -> None:
    own = with_solver(world, tmp_path / "own.toml", {key: value})
    path = world.write(tmp_path / "m.npz", world.matches())
    assert run_main("eval", "matching", path, "--data", world.root, "--protocol", own) == 2
    assert key in capsys.readouterr().err


@pytest.mark.parametrize("jobs", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_ctrl_c_ends_the_solving_at_once(world: World, tmp_path: Path, jobs: int) -> None:
    random, count = np.random.default_rng(0), 20_000
    query_xy = [random.random((count, 2)) * SIZE for _ in range(N_QUERIES)]
    map_xy = [c[:2] + random.random((count, 2)) * c[2:] for c in world.truth.crops]
    path = world.write(tmp_path / "m.npz", world.correspondences(query_xy, map_xy=map_xy))
    # Random matches take every trial: half an hour of a processor for each query.
    endless = {"max_trials": 10_000_000, "max_trials_times_matches": 10**12}
    own, out = with_solver(world, tmp_path / "own.toml", endless), tmp_path / "out"
    ask = ["eval", "matching", path, "--data", world.root, "--protocol", own]
    command = [sys.executable, "-c", INTERRUPTED, *map(str, [*ask, "--out", out, "--jobs", jobs])]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline().startswith("solving")
    time.sleep(0.5)
    until = psutil.Process(process.pid).cpu_times().user
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=HANGS_S)
    whole = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
    assert process.returncode == 130
    assert "nothing was left half-written" in said
    assert whole - until < 8.0 * jobs
    assert not out.exists()
