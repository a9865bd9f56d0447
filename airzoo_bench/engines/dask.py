"""Clusters of Dask: worker processes of this machine, or of a running scheduler."""

from __future__ import annotations

import logging
import pickle
import socket
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from multiprocessing import active_children
from typing import Any

import dask
import numpy as np
from distributed import Client, Future, KilledWorker, LocalCluster, wait
from distributed.client import ClosedClientError
from distributed.comm import CommClosedError, get_address_host_port
from distributed.exceptions import WorkerStartTimeoutError
from numpy.typing import NDArray

from airzoo_bench.core.errors import UserError
from airzoo_bench.core.shared import load_shared, write_shared
from airzoo_bench.engines.engine import MORE_MEMORY, Engine, read_ahead, without_ctrl_c

CONNECT_S = 10.0  # for a scheduler to answer
PATIENCE_S = 60.0  # without a worker that can work: none has come, all are gone or out of memory
_DEATHS = 3
_SETTINGS = {
    "distributed.admin.large-graph-warning-threshold": "1TB",
    "distributed.scheduler.allowed-failures": _DEATHS - 1,
    # Dask has small ones, and workers would return and clear the same pages over and over.
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": 1 << 28,
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": 1 << 25,
    "logging": {"distributed": "critical", "tornado": "critical"},
}
_loaded: dict[str, Any] = {}


class DaskEngine(Engine):
    """Does blocks on the workers of a cluster, again where a worker dies."""

    # joblib's backend for Dask takes all items at once, and hangs where no worker may die twice.

    def __init__(self, client: Client, place: str, *, maps: bool = False) -> None:
        super().__init__()
        self.client, self.place, self._maps = client, place, maps  # whether workers read our files
        self.distributed = True

    def _results(
        self, work: Callable[..., Any], items: Sequence[Any], shared: Any, stage: str
    ) -> Generator[Any, None, None]:
        try:
            with ExitStack() as stack:
                if self._maps:
                    key, held = stack.enter_context(write_shared((work, shared))), None
                else:
                    # A task's result, not scattered: that would be lost with those that hold it. As
                    # bytes: Dask may put arrays at odd addresses, where sums round otherwise.
                    data = np.frombuffer(pickle.dumps((work, shared)), np.uint8)
                    held = self.client.submit(np.asarray, data, pure=False)
                    key = held.key
                workers = max(1, sum(self.client.nthreads().values()))
                yield from read_ahead(partial(self._begin, key, held), items, workers)
        except KilledWorker as error:
            what = f"{_DEATHS} workers died of a block, perhaps for want of memory"
            raise UserError(what, where=stage, fix=MORE_MEMORY) from error
        except WorkerStartTimeoutError as error:
            what, fix = "no worker has come or has memory left", f"start more; or {MORE_MEMORY}"
            raise UserError(what, where=self.place, fix=fix) from error
        except (CancelledError, ClosedClientError, CommClosedError, ConnectionError) as error:
            what = "the scheduler of Dask was lost in the middle of the run"
            fix = "start it again, then the command; `eval --resume` keeps what is scored"
            raise UserError(what, where=self.place, fix=fix) from error

    def _begin(self, key: str, held: Future | None, item: Any) -> Callable[[], Any]:
        task = self.client.submit(_work_on, key, held, pickle.dumps(item), pure=False)
        return partial(self._wait, task)

    def _wait(self, future: Future) -> Any:
        """Wait for a block, but not for ever if no worker could do it."""
        while not future.done():
            with suppress(TimeoutError):
                wait(future, timeout=1.0)
            if not future.done():
                self.client.wait_for_workers(1, timeout=PATIENCE_S)
        return pickle.loads(future.result())  # noqa: S301 - of this run


def _work_on(key: str, held: NDArray[np.uint8] | None, data: bytes) -> bytes:
    if key not in _loaded:
        _loaded.clear()
        _loaded[key] = load_shared(key) if held is None else pickle.loads(held.data)  # noqa: S301
    work, shared = _loaded[key]
    return pickle.dumps(work(shared, pickle.loads(data)))  # noqa: S301 - of this run


@contextmanager
def local_cluster(workers: int) -> Iterator[DaskEngine]:
    """Start worker processes on this machine, each of one thread; they end with the block."""
    with dask.config.set(_SETTINGS):
        with without_ctrl_c():
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                dashboard_address="127.0.0.1:0",  # else at a port that another cluster may have
                scheduler_kwargs={"dashboard": False},
                silence_logs=logging.CRITICAL,
            )
            client = Client(cluster)
        try:
            yield DaskEngine(client, "--engine dask", maps=True)
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
    with dask.config.set(_SETTINGS), ExitStack() as stack:
        try:
            if not address.startswith("tls"):  # Dask would wait for a dashboard's port for ever
                with socket.create_connection(get_address_host_port(address), CONNECT_S) as stream:
                    stream.recv(1)
            with warnings.catch_warnings(action="ignore"):  # versions are compared below
                client = stack.enter_context(Client(address, timeout=CONNECT_S))
            client.wait_for_workers(1, timeout=PATIENCE_S)
            with warnings.catch_warnings(action="error"):  # those of other versions round otherwise
                client.get_versions(check=True, packages=["airzoo-bench"])
        except UserWarning as error:
            fix = "start scheduler and workers from one environment with airzoo-bench[dask]"
            raise UserError(str(error), where=place, fix=fix) from None
        except (OSError, RuntimeError, TypeError, ValueError) as error:
            what = f"no scheduler of Dask, or no worker, answers there ({type(error).__name__})"
            expected = "local, dask, tcp://HOST:PORT or tls://HOST:PORT (not the dashboard's)"
            raise UserError(what, where=place, expected=expected) from None
        yield DaskEngine(client, place)
