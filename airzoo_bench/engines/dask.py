"""Clusters of Dask: worker processes of this machine, or of a running scheduler."""

from __future__ import annotations

import logging
import os
import pickle
import socket
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing import active_children
from typing import Any

import dask
import numpy as np
from distributed import Client, Future, KilledWorker, LocalCluster
from distributed.client import ClosedClientError
from distributed.comm import get_address_host_port
from numpy.typing import NDArray

from airzoo_bench.core.errors import UserError
from airzoo_bench.engines.engine import MORE_MEMORY, Engine, attempt, read_ahead, without_ctrl_c

CONNECT_S = 10.0
"""How long a scheduler may take to answer."""
PATIENCE_S = 60.0
"""How long there may be no worker that can work: none has come, all are gone or out of memory."""
_DEATHS = 3
_SAME = ("airzoo-bench", "python", "dask", "distributed", "cloudpickle", "numpy")
_SETTINGS = {
    "distributed.admin.large-graph-warning-threshold": "1TB",
    "distributed.scheduler.allowed-failures": _DEATHS - 1,
    "distributed.worker.profile.enabled": False,
    # Dask has workers give memory back at once, which they then ask for page by page: that is a
    # third of the time of work on large arrays. A worker's memory is bounded by what tasks take.
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": 1 << 28,
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": 1 << 25,
    "logging": {"distributed": "critical", "tornado": "critical"},
}
_loaded: dict[str, Any] = {}


class DaskEngine(Engine):
    """Does blocks on the workers of a cluster, again where a worker dies."""

    # joblib's backend for Dask takes all items at once, and hangs where no worker may die twice.

    distributed = True

    def __init__(self, client: Client, place: str) -> None:
        super().__init__()
        self.client, self.place = client, place

    def _results(
        self, work: Callable[..., Any], items: Sequence[Any], shared: Any, stage: str
    ) -> Generator[Any, None, None]:
        workers = max(1, sum(self.client.nthreads().values()))
        # The result of a task, not scattered: that would be lost with the workers that hold it.
        # Bytes, since arrays that Dask sends may lie at odd addresses, where sums round otherwise.
        data = np.frombuffer(pickle.dumps((work, shared)), np.uint8)
        try:
            held = self.client.submit(_hold, data, pure=False)
            yield from read_ahead(partial(self._submit, held), items, workers)
        except KilledWorker as error:
            what = f"{_DEATHS} workers died of a block, perhaps for want of memory"
            raise UserError(what, where=stage, fix=MORE_MEMORY) from error
        except (CancelledError, ClosedClientError, OSError) as error:
            raise UserError(
                "the scheduler of Dask was lost in the middle of the run",
                where=self.place,
                fix="start it again, then the command; `eval --resume` keeps what is scored",
            ) from error

    def _submit(self, held: Future, item: Any) -> Callable[[], Any]:
        task = held.key, held, pickle.dumps(item)
        return partial(self._wait, self.client.submit(_attempt_pickled, *task, pure=False))

    def _wait(self, future: Future) -> Any:
        """Wait for a block, but not for ever if no worker could do it."""
        alive = time.monotonic()
        while time.monotonic() - alive < PATIENCE_S:
            with suppress(TimeoutError):
                return pickle.loads(future.result(timeout=1.0))  # noqa: S301 - of this run
            if self.client.status != "running":
                raise ConnectionResetError(self.client.status)
            workers = self.client.scheduler_info(n_workers=-1)["workers"].values()
            if any(worker["status"] == "running" for worker in workers):
                alive = time.monotonic()
        raise _no_workers(self.client, self.place)


def _no_workers(client: Client, place: str) -> UserError:
    return UserError(
        "there are no workers, or all are paused for want of memory",
        where=place,
        expected=f"one that is ready within {PATIENCE_S:.0f} s",
        fix=f"start others with `dask worker {client.scheduler.address}`, or {MORE_MEMORY}",
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
def local_cluster(workers: int) -> Iterator[DaskEngine]:
    """Start worker processes on this machine, each of one thread; they end with the block."""
    with dask.config.set(_SETTINGS):
        before = dict(os.environ)
        with without_ctrl_c():
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                dashboard_address="127.0.0.1:0",  # else at a port that another cluster may have
                scheduler_kwargs={"dashboard": False},
                silence_logs=logging.CRITICAL,
            )
            client = Client(cluster)
        os.environ.clear()  # Dask sets one thread for every library, in this process too
        os.environ.update(before)
        try:
            yield DaskEngine(client, "--engine dask")
        finally:
            # Workers asked to close would finish their blocks first, and nannies wait for them.
            for nanny in cluster.workers.values():
                nanny.auto_restart = False
            for process in active_children():
                process.kill()
            with suppress(TimeoutError):
                client.close(timeout=0.5)
                cluster.close(timeout=0.5)


@contextmanager
def connect(address: str) -> Iterator[DaskEngine]:
    """Use the cluster of a scheduler; it stays when the block ends."""
    place = f"--engine {address}"
    for name in ("distributed", *logging.root.manager.loggerDict):
        if name.partition(".")[0] == "distributed":  # its loggers have levels of their own
            logging.getLogger(name).setLevel(logging.CRITICAL)
    with dask.config.set(_SETTINGS):
        try:
            if not address.startswith("tls"):  # Dask would wait for a dashboard's port for ever
                with socket.create_connection(get_address_host_port(address), CONNECT_S) as stream:
                    stream.recv(1)
            client = Client(address, timeout=CONNECT_S)
        except (OSError, RuntimeError, TypeError, ValueError) as error:
            raise UserError(
                f"no scheduler of Dask answers there ({type(error).__name__})",
                where=place,
                expected="local, dask, tcp://HOST:PORT or tls://HOST:PORT (not the dashboard's)",
            ) from None
        with client:
            _check_workers(client, place)
            yield DaskEngine(client, place)


def _check_workers(client: Client, place: str) -> None:
    """Wait for the first worker; refuse workers of other versions: sums are to round alike."""
    try:
        client.wait_for_workers(1, timeout=PATIENCE_S)
    except TimeoutError:
        raise _no_workers(client, place) from None
    found = client.get_versions(packages=["airzoo-bench"])
    own = found["client"]["packages"]
    for worker, stated in found["workers"].items():
        others = [name for name in _SAME if stated["packages"].get(name) != own[name]]
        if others:
            versions = ", ".join(f"{one} {stated['packages'].get(one)}" for one in others)
            raise UserError(
                f"the worker {worker} has other versions: {versions}",
                where=place,
                fix="start scheduler and workers from one environment with airzoo-bench[dask]",
            )
