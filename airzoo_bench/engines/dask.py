"""Clusters of Dask: worker processes of this machine, or those of a scheduler that runs."""

from __future__ import annotations

import logging
import os
import pickle
import socket
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from multiprocessing import active_children
from typing import Any, TypeVar

import dask
import numpy as np
from distributed import Client, Future, KilledWorker, LocalCluster
from distributed.client import ClosedClientError
from distributed.comm import get_address_host_port
from distributed.system import MEMORY_LIMIT
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError, UserError
from airzoo_bench.engines.engine import (
    MORE_MEMORY,
    UNREAD,
    Engine,
    Fault,
    attempt,
    wait_in_order,
    without_ctrl_c,
)

S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")

CONNECT_S = 10.0
"""How long a scheduler may take to answer."""
PATIENCE_S = 60.0
"""How long there may be no worker that can work: none has come, all are gone or out of memory."""
_DEATHS = 3
_LEAST_BYTES = 512 << 20
_SAME = ("airzoo-bench", "python", "dask", "distributed", "cloudpickle", "numpy")
_QUIET = {
    "distributed.admin.tick.limit": "1h",
    "distributed.admin.large-graph-warning-threshold": "1TB",
    "logging": {"distributed": "critical", "tornado": "critical", "bokeh": "critical"},
}
_LOCAL = {
    **_QUIET,
    "distributed.scheduler.allowed-failures": _DEATHS - 1,
    "distributed.worker.profile.enabled": False,
    # Dask has workers give memory back at once, which they then ask for page by page: that is a
    # third of the time of work on large arrays. A worker's memory is bounded by what tasks take.
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": 1 << 28,
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": 1 << 25,
}
_loaded: dict[str, Any] = {}


class DaskEngine(Engine):
    """Does blocks on the workers of a cluster, again where a worker dies."""

    # joblib's backend for Dask takes all items at once, and hangs where no worker may die twice.

    distributed = True

    def __init__(self, client: Client, place: str) -> None:
        super().__init__()
        self.client, self.place = client, place
        self.dashboard = client.dashboard_link

    def _results(
        self, work: Callable[[S, T], R], items: Sequence[T], shared: S, stage: str
    ) -> Generator[R | Fault, None, None]:
        # The result of a task, not scattered: that would be lost with the workers that hold it.
        # Bytes, since arrays that Dask sends may lie at odd addresses, where sums round otherwise.
        try:
            data = np.frombuffer(pickle.dumps((work, shared)), np.uint8)
            held = self.client.submit(_hold, data, pure=False)
            most = UNREAD * max(1, sum(self.client.nthreads().values()))

            def submit(item: T) -> Future:
                task = held.key, held, pickle.dumps(item)
                return self.client.submit(_attempt_pickled, *task, pure=False)

            yield from wait_in_order(submit, self._wait, items, most)
        except KilledWorker as error:
            raise UserError(
                f"{_DEATHS} workers died of a block, perhaps for want of memory",
                where=stage,
                fix=MORE_MEMORY,
            ) from error
        except (CancelledError, ClosedClientError, OSError) as error:
            raise UserError(
                "the scheduler of Dask was lost in the middle of the run",
                where=self.place,
                fix="start it again, then run this command again; "
                "`eval` with --resume goes on from the scenes that are scored",
            ) from error

    def _wait(self, future: Future) -> Any:
        """Wait for a block, but not for ever if no worker could do it."""
        alive = time.monotonic()
        while True:
            with suppress(TimeoutError):
                return pickle.loads(future.result(timeout=1.0))  # noqa: S301 - of this run
            if self.client.status != "running":
                raise ConnectionResetError(self.client.status)
            workers = self.client.scheduler_info(n_workers=-1)["workers"].values()
            if any(worker["status"] == "running" for worker in workers):
                alive = time.monotonic()
            elif time.monotonic() - alive > PATIENCE_S:
                raise UserError(
                    f"every worker ({len(workers)}) is paused, out of memory"
                    if workers
                    else "all workers are gone",
                    where=self.place,
                    expected=f"one that is ready within {PATIENCE_S:.0f} s",
                    fix=f"start others with `dask worker {self.client.scheduler.address}`, or "
                    + MORE_MEMORY,
                )


def _hold(data: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return data


def _attempt_pickled(key: str, held: NDArray[np.uint8], data: bytes) -> bytes:
    if key not in _loaded:
        _loaded.clear()
        _loaded[key] = pickle.loads(held.data)  # noqa: S301 - of this run
    work, shared = _loaded[key]
    return pickle.dumps(attempt(work, shared, pickle.loads(data)))  # noqa: S301 - of this run


@contextmanager
def local_cluster(workers: int, memory_bytes: int | None = None) -> Iterator[DaskEngine]:
    """Start worker processes on this machine, each of one thread; they end with the block."""
    limit = min(memory_bytes or MEMORY_LIMIT, MEMORY_LIMIT // workers)
    if limit < _LEAST_BYTES:
        raise UsageError(
            f"each of {workers} workers would have {limit >> 20:,} MB of memory",
            where="--scheduler local",
            expected=f"{_LEAST_BYTES >> 20:,} MB or more: Python and its libraries take half of it",
            fix=MORE_MEMORY,
        )
    with dask.config.set(_LOCAL):
        before = dict(os.environ)
        with without_ctrl_c():
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                memory_limit=limit,
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
            )
            client = Client(cluster)
        os.environ.clear()  # Dask sets one thread for every library, in this process too
        os.environ.update(before)
        try:
            yield DaskEngine(client, "--scheduler local")
        except BaseException:
            # Workers asked to close would finish their blocks first, and nannies wait for them.
            for nanny in cluster.workers.values():
                nanny.auto_restart = False
            for process in active_children():
                process.kill()
            with suppress(TimeoutError):
                client.close(timeout=0.5)
                cluster.close(timeout=0.5)
            raise
        client.close()
        cluster.close()


@contextmanager
def connect(address: str, note: Callable[[str], None] = lambda _: None) -> Iterator[DaskEngine]:
    """Use the cluster of a scheduler; it stays when the block ends."""
    place = f"--scheduler {address}"
    for name in ("distributed", *logging.root.manager.loggerDict):
        if name.partition(".")[0] == "distributed":  # its loggers have levels of their own
            logging.getLogger(name).setLevel(logging.CRITICAL)
    with dask.config.set(_QUIET):
        try:
            if address.startswith("tcp"):  # Dask would wait for a dashboard's port for ever
                with socket.create_connection(get_address_host_port(address), CONNECT_S) as stream:
                    stream.recv(1)
            client = Client(address, timeout=CONNECT_S)
        except (OSError, RuntimeError, TypeError, ValueError) as error:
            raise UserError(
                f"no scheduler of Dask answers there ({type(error).__name__})",
                where=place,
                expected=f"an answer within {CONNECT_S:.0f} s",
                fix="check host and port (not the dashboard's), that `dask scheduler` runs there, "
                "and for tls:// the certificates of Dask's settings, distributed.comm.tls",
            ) from None
        try:
            _wait_for_workers(client, place, note)
            _check_versions(client, place)
            yield DaskEngine(client, place)
        finally:
            client.close()


def _wait_for_workers(client: Client, place: str, note: Callable[[str], None]) -> None:
    own = client.scheduler.address
    if not client.nthreads():
        note(f"waiting for a worker of {own}, {PATIENCE_S:.0f} s at most")
    try:
        client.wait_for_workers(1, timeout=PATIENCE_S)
    except TimeoutError:
        raise UserError(
            "the scheduler has no workers",
            where=place,
            expected=f"one within {PATIENCE_S:.0f} s",
            fix=f"start some with `dask worker {own}`",
        ) from None


def _check_versions(client: Client, place: str) -> None:
    """Refuse workers that lack the suite, or have other versions: sums are to round alike."""
    found = client.get_versions(packages=["airzoo-bench"])
    own = found["client"]["packages"]
    others = [
        f"{worker} has {name} {stated['packages'].get(name)} and not {own[name]}"
        for worker, stated in {"the scheduler": found["scheduler"], **found["workers"]}.items()
        for name in _SAME
        if stated["packages"].get(name) != own[name]
    ]
    if others:
        raise UserError(
            f"workers are not as this machine: {'; '.join(others[:3])[:500]}",
            where=place,
            expected="the same versions of the suite, Python, Dask and NumPy everywhere",
            fix="start scheduler and workers from one environment with airzoo-bench[dask]",
        )
