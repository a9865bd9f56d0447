"""Clusters whose scheduler runs already: their workers, and what can go wrong with them."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.core.errors import UsageError, UserError
from airzoo_bench.engines import dask
from airzoo_bench.engines.dask import connect
from airzoo_bench.engines.engine import open_engine
from tests.engines import work

HOME = Path(__file__).resolve().parents[2]


@contextmanager
def running(*arguments: object) -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, "-m", *map(str, arguments)]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen(command, env=os.environ | {"PYTHONPATH": str(HOME)}, **quiet)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@contextmanager
def scheduler(folder: Path, *, workers: bool = True) -> Iterator[tuple[str, Any]]:
    """Start a scheduler, with one worker or none; yields its address and its process."""
    file = folder / "scheduler.json"
    place = ("--host", "127.0.0.1", "--port", 0, "--scheduler-file", file, "--no-dashboard")
    with running("distributed.cli.dask_scheduler", *place) as process:
        while not (file.exists() and file.read_text().endswith("}")):
            assert process.poll() is None
            time.sleep(0.05)
        address = json.loads(file.read_text())["address"]
        arguments = (address, "--no-nanny", "--nthreads", 1, "--no-dashboard")
        if workers:
            with running("distributed.cli.dask_worker", *arguments):
                yield address, process
        else:
            yield address, process


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with scheduler(tmp_path_factory.mktemp("scheduler")) as (address, _):
        yield address


def test_its_workers_outlive_a_run(address: str) -> None:
    for _ in range(2):
        with connect(address) as place:
            found = list(place.map(work.square, range(300), shared=1, stage="s", name=str))
        assert [int(one["square"][0]) for one in found] == [n * n + 1 for n in range(300)]
        assert os.getpid() not in {int(one["who"]) for one in found}
    with pytest.raises(UserError) as caught, connect(address) as place:
        list(place.map(work.faulty, range(6), shared=Path("long"), stage="s", name=str))
    assert caught.value.where == "row 3"


@pytest.mark.slow
def test_a_scheduler_that_dies_in_the_middle_is_one_message(tmp_path: Path) -> None:
    with scheduler(tmp_path) as (address, process):

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


NIGHTLY = [pytest.param(one, marks=pytest.mark.slow) for one in ("no workers", "paused workers")]


@pytest.mark.parametrize("fault", [*NIGHTLY, "other versions"])
def test_a_cluster_that_cannot_work_is_one_message(
    address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: str
) -> None:
    ask = dask.Client.get_versions

    def other(client: Any, packages: list[str]) -> Any:
        found = ask(client, packages=packages)
        for worker in found["workers"].values():
            worker["packages"]["airzoo-bench"] = None
        return found

    monkeypatch.setattr(dask, "PATIENCE_S", 1.0)
    if fault == "paused workers":
        paused = {"workers": {"tcp://a": {"status": "paused"}}}
        monkeypatch.setattr(dask.Client, "scheduler_info", lambda client, n_workers: paused)
    if fault == "other versions":
        monkeypatch.setattr(dask.Client, "get_versions", other)
    with ExitStack() as stack:
        if fault == "no workers":
            address, _ = stack.enter_context(scheduler(tmp_path, workers=False))
        with pytest.raises(UserError, match="worker") as caught, connect(address) as place:
            list(place.map(work.waiting, range(9), shared=tmp_path, stage="s", name=str))
    assert ("airzoo-bench None" in str(caught.value)) == (fault == "other versions")
    assert address in str(caught.value)


@pytest.mark.parametrize("place", ["silent", "tls://127.0.0.1:8786", "tpc://10.0.0.5:8786", "dsak"])
def test_no_scheduler_is_one_message(monkeypatch: pytest.MonkeyPatch, place: str) -> None:
    monkeypatch.setattr(dask, "CONNECT_S", 1.0)
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
