"""Clusters of Dask: worker processes of this machine, or those of a scheduler that runs."""

from __future__ import annotations

import logging
import os
import pickle
import pkgutil
import socket
import time
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing import active_children
from typing import Any, TypeVar

import dask
import numpy as np
from distributed import Client, Future, KilledWorker, LocalCluster
from distributed.client import ClosedClientError
from distributed.comm import get_address_host_port
from distributed.security import Security
from distributed.system import MEMORY_LIMIT
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError, UserError
from airzoo_bench.core.version import __version__
from airzoo_bench.engines.engine import (
    UNREAD,
    BlockError,
    Engine,
    Fault,
    attempt,
    without_ctrl_c,
)

__all__ = ["DaskEngine", "connect", "local_cluster"]

S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")

CONNECT_S = 10.0
"""How long a scheduler may take to answer."""
PATIENCE_S = 60.0
"""How long there may be no worker that can work: none has come, all are gone or out of memory."""
_DEATHS = 3
# Short blocks go together: as many as take so long, and at most so many.
_BATCH_S, _BATCH = 0.2, 128
_LEAST_BYTES = 512 << 20
_VERSION = "airzoo_bench.core.version:__version__"
# Results and tasks travel as pickles, and sums are to round alike.
_ALIKE = ("python", "dask", "distributed", "cloudpickle", "numpy")
_QUIET = {
    "distributed.admin.tick.limit": "1h",
    "distributed.admin.large-graph-warning-threshold": "1TB",
}
_LOCAL = {
    **_QUIET,
    "distributed.scheduler.allowed-failures": _DEATHS - 1,
    "distributed.scheduler.worker-saturation": 1.0,
    "distributed.worker.profile.enabled": False,
    # Dask has workers give memory back at once, which they then ask for page by page: that is a
    # third of the time of work on large arrays. A worker's memory is bounded by what tasks take.
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": 1 << 28,
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": 1 << 25,
    "logging": {"distributed": "critical", "tornado": "critical", "bokeh": "critical"},
}


class DaskEngine(Engine):
    """Does blocks on the workers of a cluster, again where a worker dies.

    joblib's own backend for Dask is not used: it takes all items at once, and hangs where workers
    may not die twice.

    Parameters
    ----------
    client : distributed.Client
    place : str
        What the cluster is called in messages.
    more_memory : str
        See `Engine`.
    """

    distributed = True

    def __init__(self, client: Client, place: str, more_memory: str) -> None:
        super().__init__()
        self.client, self.place, self.more_memory = client, place, more_memory
        self.dashboard = client.dashboard_link

    def _results(
        self, work: Callable[[S, T], R], items: Sequence[T], shared: S, stage: str
    ) -> Generator[R | Fault, None, None]:
        try:
            # The result of a task, not scattered: that would be lost with the workers that hold it.
            data = np.frombuffer(pickle.dumps((work, shared)), np.uint8)  # not copied, as bytes are
            held = self.client.submit(_hold, data, pure=False)
            submit = partial(self._submit, held)
            threads = max(1, sum(self.client.nthreads().values()))
            waiting: deque[tuple[Future, Sequence[T]]] = deque()
            suspects: deque[T] = deque()
            begun, size = 0, 1
            while begun < len(items) or waiting or suspects:
                if suspects:
                    yield self._attempt_alone(submit, suspects.popleft())
                    continue
                while begun < len(items) and len(waiting) < UNREAD * threads:
                    batch = items[begun : begun + size]
                    waiting.append((submit(batch), batch))
                    begun += len(batch)
                future, batch = waiting.popleft()
                done = self._wait(future)
                if done is None:  # all that was under way is done alone: the right one is blamed
                    self.client.cancel([other for other, _ in waiting])
                    suspects.extend(
                        item for some in (batch, *(b for _, b in waiting)) for item in some
                    )
                    waiting.clear()
                    continue
                found, seconds = done
                left = (len(items) - begun) // (2 * threads)
                size = max(1, min(int(len(batch) * _BATCH_S / max(seconds, 1e-6)), _BATCH, left))
                yield from found
        except (CancelledError, ClosedClientError, OSError) as error:
            raise UserError(
                "the scheduler of Dask was lost in the middle of the run",
                where=self.place,
                fix="start it again, then run this command again; "
                "`eval` with --resume goes on from the scenes that are scored",
            ) from error

    def _submit(self, held: Future, items: Sequence[T]) -> Future:
        return self.client.submit(_attempt_batch, held.key, held, pickle.dumps(items), pure=False)

    def _attempt_alone(self, submit: Callable[[Sequence[T]], Future], item: T) -> Any:
        done = self._wait(submit([item]))
        if done is None:
            return Fault(BlockError(f"{_DEATHS} workers died of it, perhaps for want of memory"))
        return done[0][0]

    def _wait(self, future: Future) -> tuple[list[Any], float] | None:
        """Wait for a batch, but not for ever if no worker could do it; None if workers died."""
        alive = time.monotonic()
        while True:
            with suppress(TimeoutError):
                try:
                    return pickle.loads(future.result(timeout=1.0))  # type: ignore[no-any-return]  # noqa: S301 - of this run
                except KilledWorker:
                    return None
            if self.client.status != "running":
                raise ConnectionResetError(self.client.status)
            workers = self.client.scheduler_info(n_workers=-1)["workers"].values()
            if any(worker["status"] == "running" for worker in workers):
                alive = time.monotonic()
            elif time.monotonic() - alive > PATIENCE_S:
                raise self._stuck(len(workers))

    def _stuck(self, workers: int) -> UserError:
        others = f"start others with `dask worker {self.client.scheduler.address}`, then run again"
        return UserError(
            f"every worker ({workers}) is paused, out of memory"
            if workers
            else "all workers are gone",
            where=self.place,
            expected=f"one that is ready within {PATIENCE_S:.0f} s",
            fix=self.more_memory if workers else others,
        )


# Arrays that Dask itself sends may lie at odd addresses, where sums round otherwise: so bytes.


_loaded: dict[str, Any] = {}


def _hold(data: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return data


def _attempt_batch(key: str, held: NDArray[np.uint8], data: bytes) -> bytes:
    """Return the results of a batch of items, and the seconds that they took."""
    begun = time.monotonic()
    if key not in _loaded:
        _loaded.clear()
        _loaded[key] = pickle.loads(held.data)  # noqa: S301 - of this run
    work, shared = _loaded[key]
    found = [attempt(work, shared, item) for item in pickle.loads(data)]  # noqa: S301 - of this run
    return pickle.dumps((found, time.monotonic() - begun))


@contextmanager
def local_cluster(workers: int, memory_bytes: int | None = None) -> Iterator[DaskEngine]:
    """Start worker processes on this machine, each of one thread; they end with the block."""
    limit = min(memory_bytes or MEMORY_LIMIT, MEMORY_LIMIT // workers)
    more = "lower --jobs, raise --max-memory, or run it on a machine with more memory"
    if limit < _LEAST_BYTES:
        raise UsageError(
            f"each of {workers} workers would have {limit >> 20:,} MB of memory",
            where="--scheduler local",
            expected=f"{_LEAST_BYTES >> 20:,} MB or more: Python and its libraries take half of it",
            fix=more,
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
            yield DaskEngine(client, "--scheduler local", more)
        except BaseException:
            _kill_workers(cluster)
            raise
        finally:
            client.close()
            cluster.close()


def _kill_workers(cluster: LocalCluster) -> None:
    """End workers in the middle of their blocks, which they would finish if asked to close."""
    for nanny in cluster.workers.values():
        nanny.auto_restart = False
    for process in active_children():
        process.kill()


@contextmanager
def connect(address: str, note: Callable[[str], None] = lambda _: None) -> Iterator[DaskEngine]:
    """Use the cluster of a scheduler; it stays when the block ends."""
    place = f"--scheduler {address}"
    for name in ("distributed", *logging.root.manager.loggerDict):
        if name.partition(".")[0] == "distributed":  # its loggers have levels of their own
            logging.getLogger(name).setLevel(logging.CRITICAL)
    with dask.config.set(_QUIET):
        client = _open_client(address, place)
        try:
            _wait_for_workers(client, place, note)
            _check_versions(client, place)
            more = "start workers with more memory (`dask worker --memory-limit`)"
            yield DaskEngine(client, place, more)
        finally:
            client.close()


def _open_client(address: str, place: str) -> Client:
    tls = address.startswith("tls:")
    if tls and Security().get_connection_args("client").get("ssl_context") is None:
        raise UsageError(
            "there are no certificates for TLS",
            where=place,
            expected="those of Dask's own settings, distributed.comm.tls",
            fix="set DASK_DISTRIBUTED__COMM__TLS__CA_FILE, and ..._TLS__CLIENT__CERT and "
            "..._TLS__CLIENT__KEY",
        )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of versions: `_check_versions` says it in one message
        try:
            if not tls:  # a dashboard waits to be spoken to, and Dask would wait for it for ever
                with socket.create_connection(get_address_host_port(address), CONNECT_S) as stream:
                    stream.recv(1)
            return Client(address, timeout=CONNECT_S)
        except (OSError, ValueError) as error:
            raise UserError(
                f"no scheduler of Dask answers there ({type(error).__name__})",
                where=place,
                expected=f"an answer within {CONNECT_S:.0f} s",
                fix="check host and port (not the dashboard's), and that `dask scheduler` runs "
                "there; --scheduler local needs none",
            ) from None


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
    """Refuse a scheduler and workers that lack the suite, or have other versions."""
    stated = client.get_versions()
    own = stated["client"]["packages"]
    peers = {"the scheduler": stated["scheduler"], **stated["workers"]}
    others = [
        f"{peer} has {name} {other} and not {own.get(name)}"
        for peer, of in peers.items()
        for name in _ALIKE
        if (other := of["packages"].get(name)) != own.get(name)
    ]
    if not others:  # else workers may not even understand what comes next
        suites = client.run(pkgutil.resolve_name, _VERSION, on_error="return")
        others = [
            f"{peer} has {f'airzoo-bench {suite}' if isinstance(suite, str) else 'no airzoo-bench'}"
            for peer, suite in suites.items()
            if suite != __version__
        ]
    if others:
        raise UserError(
            f"scheduler or workers are not as this machine: {'; '.join(others[:3])}",
            where=place,
            expected="the same versions of the suite, Python, Dask and NumPy everywhere",
            fix="start scheduler and workers from one environment, or image, with "
            f"airzoo-bench[dask] {__version__}",
        )
