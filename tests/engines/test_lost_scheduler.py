"""A scheduler that is killed in the middle of a run, and another that the run goes on with."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.engines.kept import kept_folder
from airzoo_bench.retrieval import descriptor_search
from tests.engines.standing import HOME, Standing, scheduler_and_worker
from tests.support import HANGS_S, MadeScene, made_protocol, run_main, write_benchmark

TILES, TASKS = 3_000, 1_500
# Two tiles a task: more tasks than come back while the scheduler is being killed.
TASK_WORK = 2 * (4 + descriptor_search._LOOK) * 3
COMMAND = f"""
from airzoo_bench.cli.main import main
from airzoo_bench.retrieval import descriptor_search
descriptor_search._SHARD_WORK = {TASK_WORK}
main()
"""


@pytest.fixture
def ask(tmp_path: Path) -> list[object]:
    """Return a command that scores descriptors, all but where."""
    scene = MadeScene("made", [[1], [2], [3]], TILES)
    data = write_benchmark(tmp_path / "made", made_protocol([scene]), [scene])
    random = np.random.default_rng(0)
    np.savez(
        tmp_path / "p.npz",
        protocol=np.array("made-retrieval"),
        query_ids=np.array(scene.query_ids),
        gallery_ids=np.array(scene.tile_ids),
        query_descriptors=random.standard_normal((3, 4), dtype=np.float32),
        gallery_descriptors=random.standard_normal((TILES, 4), dtype=np.float32),
    )
    return ["eval", "retrieval", tmp_path / "p.npz", "--data", data, "--method", "m"]


# Between two stages, or in the middle of one.
@pytest.mark.parametrize("when", [1, 20])
@pytest.mark.slow
def test_a_run_goes_on_with_another_scheduler(
    when: int,
    ask: list[object],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    out, here = tmp_path / "out", tmp_path / "here"
    assert run_main(*ask, "--out", here) == 0
    with scheduler_and_worker(tmp_path) as first:
        told = lost(when, first, [*ask, "--out", out])
    said = [line for line in told.splitlines() if line.startswith("airzoo-bench: ")]
    assert said == [
        f"airzoo-bench: --scheduler {first.address}: the scheduler of Dask was lost in the middle "
        "of the run"
    ]
    assert "--resume" in told
    assert "ERROR" not in told
    assert not out.exists()
    left = len(list(kept_folder(out).glob("*.task")))
    assert when <= left < TASKS
    monkeypatch.setattr(descriptor_search, "_SHARD_WORK", TASK_WORK)
    (tmp_path / "scheduler.json").unlink()
    capfd.readouterr()
    with scheduler_and_worker(tmp_path) as second:
        where = ("--engine", "dask", "--scheduler", second.address)
        assert run_main(*ask, "--out", out, *where, "--resume", "--progress") == 0
    told = capfd.readouterr().err
    assert f"holds {left:,} finished task" in told
    for name in ("records.csv", "result.json"):
        assert (out / name).read_bytes() == (here / name).read_bytes()
    assert not kept_folder(out).exists()


def lost(when: int, standing: Standing, command: list[object]) -> str:
    """Kill the scheduler of a run once so many tasks are finished; return what the run said."""
    out = Path(str(command[-1]))
    where = ("--engine", "dask", "--scheduler", standing.address)
    process = subprocess.Popen(
        [sys.executable, "-c", COMMAND, *map(str, (*command, *where))],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": str(HOME)},
    )
    while process.poll() is None and len(list(kept_folder(out).glob("*.task"))) < when:
        time.sleep(0.01)
    standing.process.kill()
    _, told = process.communicate(timeout=HANGS_S)
    assert process.returncode == 2, told
    return told
