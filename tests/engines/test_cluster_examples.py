"""The example of a cluster, played on this machine: Slurm's commands."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

HOME = Path(__file__).resolve().parents[2]
CLUSTER = HOME / "examples" / "cluster"
# The script of a job is the last argument; its number is that of the process that runs it.
SBATCH = """#!/bin/sh
for last; do :; done
cp "$last" "$0.$$.job"
sh "$0.$$.job" > "$0.$$.out" 2>&1 &
echo "Submitted batch job $!"
"""
SCANCEL = """#!/bin/sh
for job; do kill "$job"; done
"""
MATCHES = HOME / "submissions" / "airzoo-demo" / "matching" / "sift" / "sift-matches.npz"


@pytest.mark.slow
def test_a_command_runs_on_workers_that_slurm_starts(tmp_path: Path) -> None:
    pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed")
    for name, script in (("sbatch", SBATCH), ("scancel", SCANCEL)):
        (tmp_path / name).write_text(script)
        (tmp_path / name).chmod(0o755)
    path = f"{tmp_path}{os.pathsep}{os.environ['PATH']}"
    env = os.environ | {"PATH": path, "PYTHONPATH": str(HOME)}
    suite = [sys.executable, "-m", "airzoo_bench", "eval", "matching", MATCHES]
    slurm = [sys.executable, CLUSTER / "slurm.py", "--workers", "2", "--partition", "cpu", "--"]
    for out, command in (("here", suite), ("there", [*slurm, *suite])):
        run = [*command, "--out", tmp_path / out, "--method", "mine"]
        subprocess.run(run, env=env, cwd=tmp_path, check=True)
    assert len(list(tmp_path.glob("*.job"))) == 2
    for name in ("records.csv", "result.json"):
        assert (tmp_path / "here" / name).read_bytes() == (tmp_path / "there" / name).read_bytes()
