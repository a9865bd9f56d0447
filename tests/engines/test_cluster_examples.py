"""The examples of clusters, played on this machine: Slurm's commands, and the manifests'."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.engines.dask import connect
from tests.engines import work
from tests.support import MadeScene, made_protocol, write_benchmark

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


def predictions(folder: Path) -> Path:
    """Write a benchmark and descriptors for it."""
    scenes = [MadeScene("park", [[q, q + 1] for q in range(6)], 40)]
    protocol = made_protocol(scenes)
    write_benchmark(folder / "data" / "made", protocol, scenes)
    random = np.random.default_rng(0)
    np.savez(
        folder / "mine.npz",
        protocol=protocol.name,
        query_ids=scenes[0].query_ids,
        query_descriptors=random.random((6, 8)),
        gallery_ids=scenes[0].tile_ids,
        gallery_descriptors=random.random((40, 8)),
    )
    return folder / "mine.npz"


@pytest.mark.slow
def test_a_command_runs_on_workers_that_slurm_starts(tmp_path: Path) -> None:
    pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed")
    commands = tmp_path / "bin"
    commands.mkdir()
    for name, script in (("sbatch", SBATCH), ("scancel", SCANCEL)):
        (commands / name).write_text(script)
        (commands / name).chmod(0o755)
    file, data = predictions(tmp_path), tmp_path / "data"
    path = f"{commands}{os.pathsep}{os.environ['PATH']}"
    env = os.environ | {"PATH": path, "PYTHONPATH": str(HOME)}
    suite = [sys.executable, "-m", "airzoo_bench", "eval", "retrieval", file, "--data", data]
    slurm = [sys.executable, CLUSTER / "slurm.py", "--workers", "2", "--partition", "cpu", "--"]
    for out, command in (("here", suite), ("there", [*slurm, *suite])):
        done = subprocess.run(
            [*command, "--out", tmp_path / out, "--method", "mine"],
            env=env,
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
    assert len(list(commands.glob("*.job"))) == 2
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


def arguments(of: dict[str, Any], **values: str) -> list[str]:
    """Return the command of a container, as Kubernetes fills it in."""
    return [re.sub(r"\$\((\w+)\)", lambda found: values[found[1]], arg) for arg in of["args"]]


@contextmanager
def running(command: list[str], **env: str) -> Iterator[None]:
    assert command[0] == "dask"
    process = subprocess.Popen(
        [sys.executable, "-m", "dask", *command[1:]],
        env=os.environ | {"PYTHONPATH": str(HOME)} | env,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield
    finally:
        process.terminate()
        process.wait()


@pytest.mark.slow
def test_the_commands_of_the_manifests_make_a_cluster(tmp_path: Path) -> None:
    scheduler = container("kubernetes.yaml", "scheduler")
    worker = container("kubernetes.yaml", "worker")
    file = tmp_path / "scheduler.json"
    here = ["--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
    command = ["127.0.0.1" if arg == "0.0.0.0" else arg for arg in arguments(scheduler)]
    stated = {one["name"]: one["value"] for one in worker["env"]}
    env = {name: value for name, value in stated.items() if "/shared" not in value}
    with ExitStack() as stack:
        stack.enter_context(running([*command, *here]))
        while not file.exists():
            time.sleep(0.05)
        address = re.findall(r"tcp://[\d.:]+", file.read_text())[0]
        # The operator gives workers their names, and tells them where the scheduler is.
        given = arguments(worker, DASK_WORKER_NAME="airzoo-default-worker-1")
        stack.enter_context(running(given, DASK_SCHEDULER_ADDRESS=address, **env))
        with connect(address) as engine:
            found = engine.map(work.square, range(4), shared=1, stage="tasks", name=str)
            assert [int(one["square"][0]) for one in found] == [1, 2, 5, 10]


def test_the_run_of_the_manifests_calls_their_scheduler() -> None:
    run = arguments(container("kubernetes-run.yaml", "template"))
    yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")
    cluster = yaml.safe_load((CLUSTER / "kubernetes.yaml").read_text())
    port = cluster["spec"]["scheduler"]["service"]["ports"][0]["port"]
    assert f"--scheduler=tcp://{cluster['metadata']['name']}-scheduler:{port}" in run
    help_ = subprocess.run(
        [sys.executable, "-m", "airzoo_bench", *run[1:3], "--help"],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"COLUMNS": "200"},
        cwd=HOME,
    ).stdout
    assert all(arg.partition("=")[0] in help_ for arg in run[4:])
