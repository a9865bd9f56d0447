"""The examples of clusters, played on this machine: Slurm's commands, and the manifests'."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.engines.dask import connect
from tests.engines import work

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


def container(file: str, *keys: str) -> dict[str, Any]:
    """Return a container of a manifest, by the keys that lead to its pod."""
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
    pod = yaml.safe_load((CLUSTER / file).read_text())["spec"]
    for key in keys:
        pod = pod[key]
    found: dict[str, Any] = pod["spec"]["containers"][0]
    return found


@pytest.mark.slow
def test_the_commands_of_the_manifests_make_a_cluster(tmp_path: Path) -> None:
    file = tmp_path / "scheduler.json"
    here = ["--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
    args = container("kubernetes.yaml", "scheduler")["args"]
    worker = container("kubernetes.yaml", "worker")
    stated = {one["name"]: one["value"] for one in worker["env"]}
    env = {name: value for name, value in stated.items() if "/shared" not in value}
    # The operator gives workers their names, and tells them where the scheduler is.
    given = [arg.replace("$(DASK_WORKER_NAME)", "worker-1") for arg in worker["args"]]

    def start(arguments: list[str], **more: str) -> None:
        assert arguments[0] == "dask"
        command = [sys.executable, "-m", *arguments]
        own = os.environ | {"PYTHONPATH": str(HOME)} | more
        process = stack.enter_context(subprocess.Popen(command, env=own))
        stack.callback(process.terminate)

    with ExitStack() as stack:
        start(["127.0.0.1" if arg == "0.0.0.0" else arg for arg in [*args, *here]])
        while not file.exists():
            time.sleep(0.05)
        address = re.findall(r"tcp://[\d.:]+", file.read_text())[0]
        start(given, DASK_SCHEDULER_ADDRESS=address, **env)
        with connect(address) as engine:
            found = engine.map(work.square, range(4), shared=1, stage="tasks", name=str)
            assert [int(one["square"][0]) for one in found] == [1, 2, 5, 10]


def test_the_run_of_the_manifests_calls_their_scheduler() -> None:
    run = container("kubernetes-run.yaml", "template")["args"]
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
    cluster = yaml.safe_load((CLUSTER / "kubernetes.yaml").read_text())
    port = cluster["spec"]["scheduler"]["service"]["ports"][0]["port"]
    assert f"--engine=tcp://{cluster['metadata']['name']}-scheduler:{port}" in run
