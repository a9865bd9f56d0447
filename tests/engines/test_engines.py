"""What engines do alike (order, bytes, faults, deaths, Ctrl-C), and clusters that run already."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from distributed import LocalCluster, Status, versions

from airzoo_bench.core.errors import PredictionError, UsageError, UserError
from airzoo_bench.engines import dask as clusters
from airzoo_bench.engines.dask import connect
from airzoo_bench.engines.engine import UNREAD, Engine, open_engine
from tests.engines import work
from tests.engines.work import named
from tests.support import HANGS_S

HOME = Path(__file__).resolve().parents[2]
ENVIRONMENT = os.environ | {"PYTHONPATH": str(HOME)}
posix = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
nightly_dask = pytest.param("dask", marks=pytest.mark.slow)


@pytest.fixture(scope="module", params=["here", "processes", nightly_dask])
def engine(request: pytest.FixtureRequest) -> Iterator[Engine]:
    """Yield an engine whose processes all tests of a kind share."""
    where = "dask" if request.param == "dask" else "local"
    with open_engine(where, jobs=2, processes=2 if request.param == "processes" else 1) as found:
        yield found


def test_results_come_in_the_order_of_the_items(engine: Engine, tmp_path: Path) -> None:
    found = engine.map(work.square, range(60), shared=7, stage="squares", name=named)
    assert list(found) == [n * n + 7 for n in range(60)]
    assert list(engine.map(work.square, [], shared=0, stage="squares", name=named)) == []
    if engine.distributed:
        workers = engine.map(work.meet, range(8), shared=tmp_path, stage="s", name=named)
        assert len({*workers} - {os.getpid()}) == 2


def test_sums_are_the_same_bytes(engine: Engine) -> None:
    random = np.random.default_rng(0)
    shared = b"odd", random.random(100_001)
    items = [random.random(100_001) for _ in range(6)]
    expected = [work.total(shared, item) for item in items]
    assert list(engine.map(work.total, items, shared=shared, stage="sums", name=str)) == expected


def test_large_arrays_are_mapped_and_those_of_files_never_copied(
    engine: Engine, tmp_path: Path
) -> None:
    np.save(tmp_path / "a.npy", np.arange(900_000).reshape(3, -1))
    mapped = np.load(tmp_path / "a.npy", mmap_mode="r")
    shared = mapped[1:], mapped[:, 7:], np.asfortranarray(mapped), np.arange(9)
    found = engine.map(work.places, range(2), shared=shared, stage="s", name=str)
    for (own, *_), (spaced, *_), (new, how, _), small in found:
        assert own == mapped.filename
        if engine.distributed:
            assert (spaced, how, small[:2]) == (None, "r", (None, ""))
            assert new not in (own, None)
    expected = [int(one.sum()) for one in shared]
    again = engine.map(work.places, range(2), shared=shared, stage="s", name=str)
    assert [[total for *_, total in one] for one in again] == [expected] * 2


@pytest.mark.parametrize(
    ("how", "kind", "where"),
    [
        ("nameless", PredictionError, "shard 3"),
        ("placed", PredictionError, "row 3"),
        ("missing", FileNotFoundError, None),
        ("buggy", KeyError, None),
    ],
)
def test_a_fault_comes_whole(
    engine: Engine, how: str, kind: type[Exception], where: str | None
) -> None:
    """A user's fault names its block, unless it has a place; others keep their traceback."""
    with pytest.raises(kind) as caught:
        list(engine.map(work.faulty, range(6), shared=how, stage="shards", name=named))
    if isinstance(caught.value, UserError):
        assert (caught.value.where, caught.value.fix) == (where, "cut it")
        assert caught.value.what == "x" * 5000
    else:
        assert "in faulty" in "".join(traceback.format_exception(caught.value))


def test_a_run_that_is_left_early_leaves_the_engine_usable(engine: Engine) -> None:
    found = engine.map(work.large, range(50), shared=3_000_000, stage="s", name=named)
    next(found)  # the others fill pipes
    found.close()  # type: ignore[attr-defined]
    assert len(list(engine.map(work.square, range(9), shared=0, stage="s", name=named))) == 9


@posix
def test_a_worker_killed_every_time_is_one_message(engine: Engine, tmp_path: Path) -> None:
    if not engine.distributed:
        pytest.skip("blocks are done in this process")
    is_dask, begin = isinstance(engine, clusters.DaskEngine), time.monotonic()
    if is_dask:  # which does a block again where a worker is killed once
        found = engine.map(work.dying_once, range(20), shared=tmp_path, stage="s", name=named)
        assert list(found) == list(range(20))
        assert (tmp_path / "died").exists()
    # Dask does not start workers again that die while they start.
    said = r"^shards: 3 workers died|there are no workers" if is_dask else r"^shards: .*killed"
    with pytest.raises(UserError, match=said) as caught:
        list(engine.map(work.deadly, range(30), shared=11, stage="shards", name=named))
    assert time.monotonic() - begin < HANGS_S
    assert "lower --jobs" in str(caught.value.fix)
    if not is_dask:
        assert len(list(engine.map(work.deadly, range(9), shared=-1, stage="s", name=named))) == 9


def test_few_blocks_wait_and_blocks_do_not_depend_on_workers(tmp_path: Path) -> None:
    with open_engine("local", jobs=2, processes=2) as engine:
        found = engine.map(work.marking, range(100), shared=tmp_path, stage="s", name=named)
        next(found)
        time.sleep(0.5)
        assert len(list(tmp_path.iterdir())) <= 2 * UNREAD
        assert list(found) == list(range(1, 100))
    assert Engine(2).cut(10, 4) == Engine(8).cut(10, 4)
    assert Engine(2).cut(10, 4) == [slice(0, 4), slice(4, 8), slice(8, 10)]
    assert Engine().cut(10, 4) == [slice(0, 10)]
    assert Engine().cut(0, 4) == []


HOLDING = """
import sys
from pathlib import Path
from airzoo_bench.engines.engine import open_engine
from tests.engines import work

if __name__ == "__main__":
    where, folder = sys.argv[1], Path(sys.argv[2])
    with open_engine(where, jobs=2, processes=2) as engine:
        for _ in engine.map(work.waiting, range(40), shared=folder, stage="s", name=str):
            pass
"""


@posix
@pytest.mark.parametrize("kind", ["local", nightly_dask])
@pytest.mark.parametrize("by", ["SIGINT", pytest.param("SIGKILL", marks=pytest.mark.slow)])
def test_no_worker_outlives_its_run(tmp_path: Path, kind: str, by: str) -> None:
    script = tmp_path / "script.py"
    script.write_text(HOLDING)
    process = subprocess.Popen(
        [sys.executable, str(script), kind, str(tmp_path)],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env=ENVIRONMENT,
    )
    while len({path.name for path in tmp_path.glob("at-*")} - {"at-0", "at-1"}) < 2:
        assert process.poll() is None, process.communicate()
        time.sleep(0.05)
    workers = psutil.Process(process.pid).children(recursive=True)
    assert len(workers) >= 2
    if by == "SIGINT":
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does it, to all of them
    else:
        process.kill()
    _, errors = process.communicate(timeout=HANGS_S)
    assert process.returncode != 0
    assert psutil.wait_procs(workers, timeout=HANGS_S)[1] == []
    if by == "SIGINT":
        assert errors.splitlines()[-1] == "KeyboardInterrupt"
        assert errors.count("Traceback") == 1


# --- clusters whose scheduler runs already ---


@contextmanager
def running(*arguments: object) -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, "-m", *map(str, arguments)]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen(command, env=ENVIRONMENT, **quiet)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@contextmanager
def scheduler(folder: Path) -> Iterator[tuple[str, Any]]:
    """Start a scheduler in a process of its own; yields its address and its process."""
    file = folder / "scheduler.json"
    place = ("--host", "127.0.0.1", "--port", 0, "--scheduler-file", file, "--no-dashboard")
    with running("distributed.cli.dask_scheduler", *place) as process:
        while not (file.exists() and file.read_text().endswith("}")):
            assert process.poll() is None
            time.sleep(0.05)
        yield json.loads(file.read_text())["address"], process


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """Yield the address of a scheduler and a worker in threads of this process."""
    options = {"dashboard_address": "127.0.0.1:0", "scheduler_kwargs": {"dashboard": False}}
    options |= {"n_workers": 1, "threads_per_worker": 1, "processes": False}
    with LocalCluster(protocol="tcp://", host="127.0.0.1", **options) as cluster:
        yield cluster.scheduler_address


def test_workers_of_a_scheduler_outlive_a_run(address: str) -> None:
    for _ in range(2):
        with connect(address) as place:
            found = list(place.map(work.square, range(20), shared=1, stage="s", name=str))
        assert found == [n * n + 1 for n in range(20)]


@pytest.mark.slow
def test_a_scheduler_that_dies_in_the_middle_is_one_message(tmp_path: Path) -> None:
    with ExitStack() as stack:
        address, process = stack.enter_context(scheduler(tmp_path))
        arguments = (address, "--no-nanny", "--nthreads", 1, "--no-dashboard")
        stack.enter_context(running("distributed.cli.dask_worker", *arguments))

        def kill_when_at_work() -> None:
            while not list(tmp_path.glob("at-*")):
                time.sleep(0.05)
            process.kill()

        killer = threading.Thread(target=kill_when_at_work)
        killer.start()
        with pytest.raises(UserError) as caught, connect(address) as place:
            list(place.map(work.waiting, range(9), shared=tmp_path, stage="s", name=str))
        killer.join()
    assert address in str(caught.value.where)
    assert "--resume" in str(caught.value.fix)


def test_workers_of_another_version_are_one_message(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    ask = versions.get_versions

    def other(packages: Any = None) -> Any:
        stated = ask(packages=packages)
        return stated | {"packages": stated["packages"] | {"airzoo-bench": "0.0.1"}}

    monkeypatch.setattr(versions, "get_versions", other)
    with pytest.raises(UserError, match=rf"(?s){address}.*0\.0\.1"), connect(address):
        pass


def pause_above(share: float, dask_worker: Any = None) -> None:
    """Pause a worker, which goes on where it has less than a share of the memory."""
    dask_worker.memory_manager.memory_pause_fraction = share
    dask_worker.status = Status.paused


@pytest.mark.slow
def test_no_worker_and_none_with_memory_left_are_one_message(
    address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(clusters, "PATIENCE_S", 1.0)
    with scheduler(tmp_path) as (empty, _), pytest.raises(UserError, match=empty), connect(empty):
        pass
    with connect(address) as place:
        place.client.run(pause_above, 1e-9)
        with pytest.raises(UserError, match=f"{address}: no worker"):
            list(place.map(work.square, range(9), shared=0, stage="s", name=str))
        place.client.run(pause_above, 0.8)


@pytest.mark.parametrize("place", ["silent", "tls://127.0.0.1:8786", "tpc://10.0.0.5:8786", "dsak"])
def test_no_scheduler_is_one_message(monkeypatch: pytest.MonkeyPatch, place: str) -> None:
    monkeypatch.setattr(clusters, "CONNECT_S", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as silent:  # as a dashboard is
        place = place.replace("silent", f"tcp://127.0.0.1:{silent.getsockname()[1]}")
        with pytest.raises(UserError, match="tcp://HOST:PORT"), open_engine(place, jobs=1):
            pass


def test_a_scheduler_needs_dask(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "airzoo_bench.engines.dask")
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UsageError) as caught, open_engine("dask", jobs=1):
        pass
    assert caught.value.fix == "pip install 'airzoo-bench[dask]'"


# Slurm's commands, played on this machine: the script of a job is the last argument, its number
# that of the process that runs it.
SLURM = {
    "sbatch": """#!/bin/sh
for last; do :; done
cp "$last" "$0.$$.job"
sh "$0.$$.job" > "$0.$$.out" 2>&1 &
echo "Submitted batch job $!"
""",
    "scancel": '#!/bin/sh\nfor job; do kill "$job"; done\n',
}


@pytest.mark.slow
def test_the_example_of_slurm_gives_the_same_bytes(tmp_path: Path) -> None:
    pytest.importorskip("dask_jobqueue", reason="dask-jobqueue is not installed")
    for name, script in SLURM.items():
        (tmp_path / name).write_text(script)
        (tmp_path / name).chmod(0o755)
    env = ENVIRONMENT | {"PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    matches = HOME / "submissions/airzoo-demo/matching/sift/sift-matches.npz"
    suite = [sys.executable, "-m", "airzoo_bench", "eval", "matching", matches]
    script = HOME / "examples" / "cluster" / "slurm.py"
    slurm = [sys.executable, script, "--workers", "2", "--partition", "cpu", "--"]
    for out, command in (("here", suite), ("there", [*slurm, *suite])):
        run = [*command, "--out", tmp_path / out, "--method", "mine"]
        subprocess.run(run, env=env, cwd=tmp_path, check=True)
    assert len(list(tmp_path.glob("*.job"))) == 2
    for name in ("records.csv", "result.json"):
        assert (tmp_path / "here" / name).read_bytes() == (tmp_path / "there" / name).read_bytes()
