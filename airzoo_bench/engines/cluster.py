"""Clusters of Dask: worker processes of this machine, or a scheduler that stands."""

from __future__ import annotations

import logging
import os
import pkgutil
import socket
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import active_children

import dask
from distributed import Client, LocalCluster
from distributed.comm import get_address_host_port
from distributed.security import Security
from distributed.system import MEMORY_LIMIT

from airzoo_bench.core.errors import UsageError, UserError
from airzoo_bench.core.parallel import without_ctrl_c
from airzoo_bench.core.plurals import counted
from airzoo_bench.core.version import __version__
from airzoo_bench.engines.dask_tasks import DEATHS, DaskEngine

__all__ = ["connected", "local_cluster"]

CONNECT_S = 10.0
"""How long a scheduler may take to answer."""
WORKERS_S = 60.0
"""How long its first worker may take to come."""
_SOON_S = 2.0
_LEAST_BYTES = 512 << 20
_OWN_WORKERS = "start workers with more memory (`dask worker --memory-limit`)"
_VERSION = "airzoo_bench.core.version:__version__"
# Results and tasks travel as pickles, and sums are to round alike.
_ALIKE = ("python", "dask", "distributed", "cloudpickle", "numpy")
_QUIET = {
    "distributed.admin.tick.limit": "1h",
    "distributed.admin.large-graph-warning-threshold": "1TB",
}
_LOCAL = {
    **_QUIET,
    "distributed.scheduler.allowed-failures": DEATHS - 1,
    "distributed.scheduler.worker-saturation": 1.0,
    "distributed.worker.profile.enabled": False,
    # Dask has workers give memory back at once, which they then ask for page by page: that is a
    # third of the time of work on large arrays. A worker's memory is bounded by what tasks take.
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": 1 << 28,
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": 1 << 25,
    "logging": {"distributed": "critical", "tornado": "critical", "bokeh": "critical"},
}


@contextmanager
def local_cluster(workers: int, memory_bytes: int | None = None) -> Iterator[DaskEngine]:
    """Start worker processes on this machine, each of one thread; they end with the block."""
    limit = _memory_of_each(workers, memory_bytes)
    with dask.config.set(_LOCAL):
        with without_ctrl_c(), _environment_kept():
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                memory_limit=limit,
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
            )
            client = Client(cluster)
        try:
            yield DaskEngine(client, "--scheduler local", _more_memory(workers, memory_bytes))
        except BaseException:
            _end_workers(cluster)
            raise
        finally:
            client.close()
            cluster.close()


@contextmanager
def _environment_kept() -> Iterator[None]:
    """Take back what Dask sets in this process too: one thread for every library."""
    before = dict(os.environ)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def _memory_of_each(workers: int, asked: int | None) -> int:
    share: int = MEMORY_LIMIT // workers
    limit = share if asked is None else min(asked, share)
    if limit < _LEAST_BYTES:
        raise UsageError(
            f"each of {counted(workers, 'worker')} would have {limit >> 20:,} MB of memory",
            where="--scheduler local",
            expected=f"{_LEAST_BYTES >> 20:,} MB or more: Python and its libraries take half of it",
            fix="lower --jobs" if share < _LEAST_BYTES else "raise --max-memory",
        )
    return limit


def _more_memory(workers: int, asked: int | None) -> str:
    """Say how workers have more memory: more than its share of the machine's none can have."""
    ways = ["raise --max-memory"] if asked is not None and asked < MEMORY_LIMIT // workers else []
    ways += ["lower --jobs"] if workers > 1 else []
    return ", or ".join([*ways, "run it on a machine with more memory"])


def _end_workers(cluster: LocalCluster) -> None:
    """End workers in the middle of their tasks: asked to close, they would finish these."""
    for nanny in cluster.workers.values():
        nanny.auto_restart = False
    for process in active_children():
        process.kill()


@contextmanager
def connected(address: str, note: Callable[[str], None] = lambda _: None) -> Iterator[DaskEngine]:
    """Use the cluster of a scheduler; it stays when the block ends."""
    place = f"--scheduler {address}"
    _silence()
    with dask.config.set(_QUIET):
        client = _client(address, place)
        try:
            _wait_for_workers(client, place, note)
            _check_peers(client, place)
            yield DaskEngine(client, place, _OWN_WORKERS, note)
        finally:
            client.close()


def _silence() -> None:
    """Leave messages to this package; Dask's loggers have levels of their own."""
    for name in ("distributed", *logging.root.manager.loggerDict):
        if name.partition(".")[0] == "distributed":
            logging.getLogger(name).setLevel(logging.CRITICAL)


def _client(address: str, place: str) -> Client:
    _check_certificates(address, place)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of versions: `_check_peers` says it in one message
        try:
            _check_speaks(address)
            return Client(address, timeout=CONNECT_S)
        except (OSError, ValueError) as error:
            raise UserError(
                f"no scheduler of Dask answers there ({type(error).__name__})",
                where=place,
                expected=f"an answer within {CONNECT_S:.0f} s",
                fix="check host and port (not the dashboard's), and that `dask scheduler` runs "
                "there; --scheduler local needs none",
            ) from None


def _check_certificates(address: str, place: str) -> None:
    if not address.startswith("tls:"):
        return
    if Security().get_connection_args("client").get("ssl_context") is None:
        raise UsageError(
            "there are no certificates for TLS",
            where=place,
            expected="those of Dask's own settings, distributed.comm.tls",
            fix="set DASK_DISTRIBUTED__COMM__TLS__CA_FILE, and ..._TLS__CLIENT__CERT and "
            "..._TLS__CLIENT__KEY",
        )


def _check_speaks(address: str) -> None:
    """Refuse who waits to be spoken to, as a dashboard does: Dask would wait for it for ever."""
    if address.startswith("tcp:"):
        with socket.create_connection(get_address_host_port(address), CONNECT_S) as stream:
            stream.recv(1)


def _wait_for_workers(client: Client, place: str, note: Callable[[str], None]) -> None:
    with suppress(TimeoutError):
        client.wait_for_workers(1, timeout=_SOON_S)
        return
    note(f"waiting for a worker of {client.scheduler.address}, {WORKERS_S:.0f} s at most")
    try:
        client.wait_for_workers(1, timeout=WORKERS_S)
    except TimeoutError:
        raise UserError(
            "the scheduler has no workers",
            where=place,
            expected=f"one within {WORKERS_S:.0f} s",
            fix=f"start some with `dask worker {client.scheduler.address}`",
        ) from None


def _check_peers(client: Client, place: str) -> None:
    """Refuse schedulers and workers that lack the suite, or have other versions."""
    found = _other_versions(client)
    if found:
        raise UserError(
            f"scheduler or workers are not as this machine: {'; '.join(found[:3])}",
            where=place,
            expected="the same versions of the suite, Python, Dask and NumPy everywhere",
            fix="start scheduler and workers from one environment, or image, with "
            f"airzoo-bench[dask] {__version__}",
        )


def _other_versions(client: Client) -> list[str]:
    stated = client.get_versions()
    own = _versions_of(stated["client"])
    peers = {"the scheduler": stated["scheduler"], **stated["workers"]}
    others = [
        f"{peer} has {name} {version} and not {own[name]}"
        for peer, of in peers.items()
        for name, version in _versions_of(of).items()
        if version != own[name]
    ]
    if others:  # what comes next may not even be understood there
        return others
    suites = {
        "the scheduler": _suite_of_scheduler(client),
        **client.run(pkgutil.resolve_name, _VERSION, on_error="return"),
    }
    return [
        f"{peer} has {_suite(version)}"
        for peer, version in suites.items()
        if version != __version__
    ]


def _suite_of_scheduler(client: Client) -> object:
    try:
        return client.run_on_scheduler(pkgutil.resolve_name, _VERSION)
    except (ImportError, AttributeError) as error:
        return error


def _versions_of(stated: dict[str, dict[str, str]]) -> dict[str, str]:
    return {name: stated["packages"].get(name, "none") for name in _ALIKE}


def _suite(version: object) -> str:
    return f"airzoo-bench {version}" if isinstance(version, str) else "no airzoo-bench"
