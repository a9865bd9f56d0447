from __future__ import annotations

import os
import socket
import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from airzoo_bench.core.errors import UsageError, UserError
from airzoo_bench.engines import choose, cluster, dask_tasks
from airzoo_bench.engines.choose import EngineKind, chosen_engine
from airzoo_bench.engines.cluster import connected
from tests.engines import work
from tests.engines.standing import Standing, scheduler, scheduler_and_worker
from tests.engines.work import named


@pytest.fixture(scope="module")
def workers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Standing]:
    with scheduler_and_worker(tmp_path_factory.mktemp("scheduler")) as made:
        yield made


def test_work_is_done_by_workers_that_stand(workers: Standing) -> None:
    with connected(workers.address) as engine:
        found = list(engine.map(work.square, range(300), shared=1, stage="s", name=named))
    assert [int(one["square"][0]) for one in found] == [n * n + 1 for n in range(300)]
    assert os.getpid() not in {int(one["who"]) for one in found}
    with connected(workers.address) as engine:  # they outlive a run
        assert len(list(engine.map(work.square, range(9), shared=1, stage="s", name=named))) == 9


def test_a_scheduler_that_dies_in_the_middle_is_one_message(tmp_path: Path) -> None:
    with scheduler_and_worker(tmp_path) as own:

        def kill_when_at_work() -> None:
            while not list(tmp_path.glob("at-*")):
                time.sleep(0.05)
            own.process.kill()

        killer = threading.Thread(target=kill_when_at_work)
        killer.start()
        with pytest.raises(UserError) as caught, connected(own.address) as engine:
            list(engine.map(work.waiting, range(9), shared=tmp_path, stage="s", name=named))
        killer.join()
    assert "scheduler of Dask was lost" in caught.value.what
    assert own.address in str(caught.value.where)
    assert "--resume" in str(caught.value.fix)


def test_a_scheduler_without_workers_is_one_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "WORKERS_S", 0.5)
    monkeypatch.setattr(cluster, "_SOON_S", 0.5)
    told: list[str] = []
    with (
        scheduler(tmp_path) as own,
        pytest.raises(UserError) as caught,
        connected(own.address, told.append),
    ):
        pass
    assert told == [f"waiting for a worker of {own.address}, 0 s at most"]
    assert "has no workers" in caught.value.what
    assert f"dask worker {own.address}" in str(caught.value.fix)


def test_workers_without_the_suite_are_one_message(
    workers: Standing, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "_VERSION", "airzoo_bench.core.no_such:__version__")
    with pytest.raises(UserError) as caught, connected(workers.address):
        pass
    assert "the scheduler has no airzoo-bench" in caught.value.what
    assert "tcp://" in caught.value.what
    assert "airzoo-bench[dask]" in str(caught.value.fix)


def test_workers_with_another_version_of_the_suite_are_one_message(
    workers: Standing, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "__version__", "99.0")
    with pytest.raises(UserError) as caught, connected(workers.address):
        pass
    assert "has airzoo-bench 0." in caught.value.what
    assert "99.0" in str(caught.value.fix)


@pytest.mark.parametrize("package", ["python", "dask", "distributed", "numpy"])
def test_workers_with_other_versions_are_one_message(
    workers: Standing, monkeypatch: pytest.MonkeyPatch, package: str
) -> None:
    ask: Callable[..., Any] = cluster.Client.get_versions

    def answer(client: Any) -> Any:
        found = ask(client)
        for stated in found["workers"].values():
            stated["packages"] = stated["packages"] | {package: "1.2.3"}
        return found

    monkeypatch.setattr(cluster.Client, "get_versions", answer)
    with (
        pytest.raises(UserError, match=f"has {package} 1.2.3 and not "),
        connected(workers.address),
    ):
        pass


def test_paused_workers_are_one_message(
    workers: Standing, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(dask_tasks, "PATIENCE_S", 1.0)
    paused = {"workers": {"tcp://a": {"status": "paused"}}}
    monkeypatch.setattr(cluster.Client, "scheduler_info", lambda client: paused)
    with pytest.raises(UserError) as caught, connected(workers.address) as engine:
        list(engine.map(work.waiting, range(9), shared=tmp_path, stage="s", name=named))
    assert caught.value.what == "no worker can go on: every worker (1) is paused, out of memory"
    assert caught.value.fix == "start workers with more memory (`dask worker --memory-limit`)"


def test_workers_that_are_all_gone_are_waited_for_and_then_one_message(
    workers: Standing, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(dask_tasks, "PATIENCE_S", 2.0)
    monkeypatch.setattr(cluster.Client, "scheduler_info", lambda client: {"workers": {}})
    told: list[str] = []
    with pytest.raises(UserError) as caught, connected(workers.address, told.append) as engine:
        list(engine.map(work.waiting, range(9), shared=tmp_path, stage="s", name=named))
    assert caught.value.what == "no worker can go on: all workers are gone"
    assert f"`dask worker {workers.address}`" in str(caught.value.fix)
    assert told == ["all workers are gone: waiting for one, 2 s at most"]


def test_who_waits_to_be_spoken_to_is_no_scheduler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "CONNECT_S", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1]
        with pytest.raises(UserError, match="no scheduler of Dask answers") as caught:
            opened(f"tcp://127.0.0.1:{port}")
    assert "not the dashboard's" in str(caught.value.fix)


def test_tls_without_certificates_is_one_message() -> None:
    with pytest.raises(UsageError, match="no certificates for TLS") as caught:
        opened("tls://127.0.0.1:8786")
    assert "DASK_DISTRIBUTED__COMM__TLS__CA_FILE" in str(caught.value.fix)


def test_nobody_there_is_one_message(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "CONNECT_S", 1.0)
    with pytest.raises(UserError) as caught:
        opened("tcp://127.0.0.1:1")
    assert caught.value.where == "--scheduler tcp://127.0.0.1:1"
    assert "no scheduler of Dask answers" in caught.value.what


@pytest.mark.parametrize(
    ("jobs", "memory", "fix"),
    [(1, 64 << 20, "raise --max-memory"), (1024, 2 << 30, "lower --jobs")],
)
def test_workers_with_too_little_memory_are_not_started(
    monkeypatch: pytest.MonkeyPatch, jobs: int, memory: int, fix: str
) -> None:
    monkeypatch.setattr(cluster, "MEMORY_LIMIT", 16 << 30)
    with pytest.raises(UsageError) as caught:
        opened("local", jobs=jobs, memory=memory)
    assert "MB of memory" in caught.value.what
    assert caught.value.fix == fix


@pytest.mark.parametrize(
    ("jobs", "asked", "fix"),
    [
        (
            2,
            2 << 30,
            "raise --max-memory, or lower --jobs, or run it on a machine with more memory",
        ),
        (2, 8 << 30, "lower --jobs, or run it on a machine with more memory"),
        (2, None, "lower --jobs, or run it on a machine with more memory"),
        (1, None, "run it on a machine with more memory"),
    ],
)
def test_what_gives_workers_here_more_memory(
    monkeypatch: pytest.MonkeyPatch, jobs: int, asked: int | None, fix: str
) -> None:
    """No worker can have more than its share, which is what it has where nothing was asked for."""
    monkeypatch.setattr(cluster, "MEMORY_LIMIT", 16 << 30)
    monkeypatch.setattr(cluster, "LocalCluster", mock.MagicMock())
    monkeypatch.setattr(cluster, "Client", mock.MagicMock())
    with cluster.local_cluster(jobs, asked) as engine:
        assert engine.more_memory == fix


def opened(
    scheduler: str | None,
    kind: EngineKind = EngineKind.DASK,
    *,
    jobs: int = 1,
    memory: int | None = None,
) -> None:
    with chosen_engine(kind, scheduler, jobs=jobs, memory_bytes=memory):
        raise AssertionError("not refused")


@pytest.mark.parametrize(
    "address",
    [
        "tpc://10.0.0.5:8786",
        "10.0.0.5:8786",
        "tcp://10.0.0.5",
        "tcp://:8786",
        "tcp://10.0.0.5:0",
        "tcp://10.0.0.5:99999",
        "tcp://10.0.0.5:8786/status",
        "Local",
        "",
        "http://10.0.0.5:8787",
    ],
)
def test_what_is_no_address_is_refused_before_anything_is_asked(address: str) -> None:
    with pytest.raises(UsageError, match="not the address of a scheduler") as caught:
        opened(address)
    assert "tcp://HOST:PORT" in str(caught.value.expected)


def test_a_scheduler_needs_dask() -> None:
    with pytest.raises(UsageError, match="--scheduler is of Dask") as caught:
        opened("local", EngineKind.LOCAL)
    assert caught.value.fix == "add --engine dask"


def test_dask_that_is_not_installed_is_named_with_its_command(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(choose.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(UsageError, match="not installed") as caught:
        opened(None)
    assert caught.value.fix == "pip install 'airzoo-bench[dask]'"


def test_a_scheduler_without_a_dashboard_has_no_address_of_one(workers: Standing) -> None:
    """Dask states one all the same, at which there is nothing."""
    with connected(workers.address) as engine:
        assert engine.client.dashboard_link
        assert engine.dashboard is None


@pytest.mark.slow
def test_the_address_of_a_dashboard_leads_to_it(tmp_path: Path) -> None:
    pytest.importorskip("bokeh")
    pages = ("--dashboard", "--dashboard-address", "127.0.0.1:0")
    with (
        scheduler_and_worker(tmp_path, *pages) as made,
        connected(made.address) as engine,
        urllib.request.urlopen(str(engine.dashboard), timeout=60) as answer,
    ):
        assert answer.status == 200


@pytest.mark.slow
def test_workers_here_have_no_dashboard_without_bokeh(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed.dashboard.scheduler", None)
    with cluster.local_cluster(1) as engine:
        assert engine.dashboard is None
