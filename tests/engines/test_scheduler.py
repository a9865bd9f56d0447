"""A scheduler that runs by itself, and the options that name one."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.core.errors import UsageError, UserError
from airzoo_bench.engines import dask, engine
from airzoo_bench.engines.dask import connect
from airzoo_bench.engines.engine import open_engine
from tests.engines import work
from tests.engines.work import named

HOME = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Standing:
    address: str
    process: subprocess.Popen[bytes]


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
def scheduler(folder: Path) -> Iterator[Standing]:
    """Start a scheduler without workers."""
    file = folder / "scheduler.json"
    place = ("--host", "127.0.0.1", "--port", 0, "--scheduler-file", file, "--no-dashboard")
    with running("distributed.cli.dask_scheduler", *place) as process:
        while not (file.exists() and file.read_text().endswith("}")):
            assert process.poll() is None
            time.sleep(0.05)
        yield Standing(json.loads(file.read_text())["address"], process)


@contextmanager
def scheduler_and_worker(folder: Path) -> Iterator[Standing]:
    with scheduler(folder) as made:
        arguments = (made.address, "--no-nanny", "--nthreads", 1, "--no-dashboard")
        with running("distributed.cli.dask_worker", *arguments):
            yield made


@pytest.fixture(scope="module")
def workers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Standing]:
    with scheduler_and_worker(tmp_path_factory.mktemp("scheduler")) as made:
        yield made


def test_its_workers_outlive_a_run(workers: Standing) -> None:
    for _ in range(2):
        with connect(workers.address) as place:
            found = list(place.map(work.square, range(300), shared=1, stage="s", name=named))
        assert [int(one["square"][0]) for one in found] == [n * n + 1 for n in range(300)]
        assert os.getpid() not in {int(one["who"]) for one in found}


def test_a_fault_of_the_user_comes_whole_and_names_its_block(workers: Standing) -> None:
    for folder, said in (("long", "row 3"), ("unreadable", "shard 3")):
        with pytest.raises(UserError) as caught, connect(workers.address) as place:
            list(place.map(work.faulty, range(6), shared=Path(folder), stage="s", name=named))
        assert caught.value.where == said


def test_a_scheduler_that_dies_in_the_middle_is_one_message(tmp_path: Path) -> None:
    with scheduler_and_worker(tmp_path) as own:

        def kill_when_at_work() -> None:
            while not list(tmp_path.glob("at-*")):
                time.sleep(0.05)
            own.process.kill()

        killer = threading.Thread(target=kill_when_at_work)
        killer.start()
        with (
            pytest.raises(UserError, match="scheduler of Dask was lost") as caught,
            connect(own.address) as place,
        ):
            list(place.map(work.waiting, range(9), shared=tmp_path, stage="s", name=named))
        killer.join()
    assert own.address in str(caught.value.where)
    assert "--resume" in str(caught.value.fix)


def test_a_scheduler_without_workers_is_one_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask, "PATIENCE_S", 0.5)
    notes: list[str] = []
    with (
        scheduler(tmp_path) as own,
        pytest.raises(UserError, match="has no workers") as caught,
        connect(own.address, notes.append),
    ):
        pass
    assert own.address in notes[0]
    assert f"dask worker {own.address}" in str(caught.value.fix)


@pytest.mark.parametrize("name", ["airzoo-bench", "python", "numpy"])
def test_workers_with_other_versions_are_one_message(
    workers: Standing, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    ask = dask.Client.get_versions

    def other(client: Any, packages: list[str]) -> Any:
        found = ask(client, packages=packages)
        assert found["client"]["packages"][name]
        for worker in found["workers"].values():
            worker["packages"][name] = None
        return found

    monkeypatch.setattr(dask.Client, "get_versions", other)
    with (
        pytest.raises(UserError, match=f"tcp://.* has {name} None and not"),
        connect(workers.address),
    ):
        pass


@pytest.mark.parametrize(
    ("workers_there", "what"),
    [
        ({"tcp://a": {"status": "paused"}}, "every worker (1) is paused"),
        ({}, "all workers are gone"),
    ],
)
def test_workers_that_cannot_go_on_are_waited_for_and_then_one_message(
    workers: Standing,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    workers_there: dict[str, Any],
    what: str,
) -> None:
    monkeypatch.setattr(dask, "PATIENCE_S", 1.0)
    found = {"workers": workers_there}
    monkeypatch.setattr(dask.Client, "scheduler_info", lambda client, n_workers: found)
    with pytest.raises(UserError) as caught, connect(workers.address) as place:
        list(place.map(work.waiting, range(9), shared=tmp_path, stage="s", name=named))
    assert what in caught.value.what
    assert "dask worker tcp://" in str(caught.value.fix)


def opened(where: str, *, jobs: int = 1, memory: int | None = None) -> None:
    with open_engine(where, jobs=jobs, memory_bytes=memory):
        raise AssertionError("not refused")


def test_a_dashboard_is_no_scheduler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask, "CONNECT_S", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1]
        with pytest.raises(UserError, match="no scheduler of Dask answers") as caught:
            opened(f"tcp://127.0.0.1:{port}")
    assert "not the dashboard's" in str(caught.value.fix)


def test_tls_without_certificates_is_one_message() -> None:
    with pytest.raises(UserError, match="no scheduler of Dask answers") as caught:
        opened("tls://127.0.0.1:8786")
    assert "certificates" in str(caught.value.fix)


@pytest.mark.parametrize(("jobs", "memory"), [(1, 64 << 20), (1024, 2 << 30)])
def test_workers_with_too_little_memory_are_not_started(
    monkeypatch: pytest.MonkeyPatch, jobs: int, memory: int
) -> None:
    monkeypatch.setattr(dask, "MEMORY_LIMIT", 16 << 30)
    with pytest.raises(UsageError, match="MB of memory"):
        opened("dask", jobs=jobs, memory=memory)


@pytest.mark.parametrize("address", ["tpc://10.0.0.5:8786", "10.0.0.5:8786", "tcp://:8786", ""])
def test_what_is_no_address_is_refused_before_anything_is_asked(address: str) -> None:
    with pytest.raises(UsageError, match="not the address of a scheduler"):
        opened(address)


def test_a_scheduler_needs_dask(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(UsageError, match="not installed") as caught:
        opened("dask")
    assert caught.value.fix == "pip install 'airzoo-bench[dask]'"
