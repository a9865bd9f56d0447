"""Tasks on the workers of a cluster of Dask."""

from __future__ import annotations

import queue
import socket
import time
import uuid
from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from functools import partial
from typing import Any, Generic, TypeVar

from distributed import Client, Future, KilledWorker
from distributed.client import ClosedClientError

from airzoo_bench.core.errors import UserError
from airzoo_bench.core.version import versions
from airzoo_bench.engines.engine import Engine, runs
from airzoo_bench.engines.tasks import Outcome, attempt

__all__ = ["DEATHS", "DaskEngine"]

S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")

DEATHS = 3
"""Workers that may die of a task before it is done alone, and again before it is given up."""
PATIENCE_S = 60.0
"""How long there may be no worker that can work: all gone, or out of memory."""
_LOOK_S = 1.0
_GONE = "all workers are gone"
_OTHERS = (
    "start others with `dask worker {}`, then run this command again; `eval` with --resume goes "
    "on from the tasks that are finished"
)
# Short tasks go together: as many as take so long, and at most so many.
_BATCH_S = 0.2
_MOST_A_BATCH = 128


class DaskEngine(Engine):
    """Tasks on the workers of a cluster.

    Parameters
    ----------
    client : distributed.Client
    place : str
        What the cluster is called in messages.
    more_memory : str
        See `Engine`.
    note : callable
        Told that workers are waited for.
    """

    distributed = True

    def __init__(
        self,
        client: Client,
        place: str,
        more_memory: str,
        note: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.client, self.place, self.note = client, place, note
        self.more_memory = more_memory
        # Dask has an address of pages also where the scheduler makes none.
        shows: bool = client.run_on_scheduler(_shows_pages)
        self.dashboard: str | None = client.dashboard_link if shows else None

    def cut(self, count: int, size: int) -> list[slice]:
        """See `Engine.cut`."""
        return runs(count, size)

    def map(
        self,
        work: Callable[[S, T], R],
        items: Sequence[T],
        *,
        shared: S,
        stage: str,
        name: Callable[[T], str],
    ) -> Iterator[R]:
        """See `Engine.map`."""
        if not items:
            return
        with self._scheduler_there():
            tasks = _Tasks(self, work, items, shared, stage)
            try:
                for item, outcome in zip(items, tasks.outcomes(), strict=True):
                    yield outcome.value(name(item), self.more_memory)
            finally:
                tasks.end()

    @contextmanager
    def _scheduler_there(self) -> Iterator[None]:
        """Make one message of all that the client raises when its scheduler is gone."""
        try:
            yield
        except (CancelledError, ClosedClientError, OSError) as error:
            raise UserError(
                "the scheduler of Dask was lost in the middle of the run",
                where=self.place,
                fix="start it again, then run this command again; "
                "`eval` with --resume goes on from the tasks that are finished",
            ) from error


def _shows_pages(dask_scheduler: object) -> bool:
    pages = getattr(dask_scheduler, "http_application", None)
    return bool(getattr(pages, "applications", ()))


def _given(shared: S) -> S:
    return shared


def _batch(
    work: Callable[[S, T], R], shared: S, items: list[T], asked: dict[str, str]
) -> list[Outcome[R]]:
    """Do tasks, if this worker has the versions of the client, which the result will state."""
    own = versions()
    others = [
        f"{name} {own[name]} and not {asked[name]}" for name in own if own[name] != asked[name]
    ]
    if others:
        return [Outcome(fault=_other_worker(others))] * len(items)
    return [attempt(work, shared, item) for item in items]


def _other_worker(others: list[str]) -> UserError:
    return UserError(
        f"a worker has {'; '.join(others[:3])}",
        where=socket.gethostname(),
        expected="one version everywhere of what numbers depend on",
        fix="start all workers from one environment, or image",
    )


class _Tasks(Generic[S, T, R]):
    """Tasks of one stage: submitted in batches, collected as they end, given in their order."""

    def __init__(
        self,
        engine: DaskEngine,
        work: Callable[[S, T], R],
        items: Sequence[T],
        shared: S,
        stage: str,
    ) -> None:
        self._engine, self._client = engine, engine.client
        self._work, self._items = work, items
        self._stage = f"{stage}-{uuid.uuid4().hex[:8]}"
        # The result of a task, not scattered: that would be lost with the workers that hold it.
        self._shared = self._client.submit(_given, shared, key=f"shared {self._stage}")
        self._threads: int = max(1, sum(self._client.nthreads().values()))
        self._begun = 0
        self._flying: dict[str, tuple[Future, range]] = {}
        self._ended: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._outcomes: dict[int, Outcome[R] | BaseException] = {}
        # What was on workers that died is done again, alone, so that the right one is blamed.
        self._suspects: deque[int] = deque()
        self._mean_s: float | None = None
        self._failed = False
        self._alive = time.monotonic()
        self._waiting = False

    def outcomes(self) -> Iterator[Outcome[R]]:
        """Yield an outcome an item, in their order."""
        for index in range(len(self._items)):
            while index not in self._outcomes:
                self._submit()
                self._collect()
            outcome = self._outcomes.pop(index)
            if isinstance(outcome, BaseException):
                raise outcome
            yield outcome

    def end(self) -> None:
        """Give up what is under way."""
        if self._client.status == "running":
            self._client.cancel([self._shared, *(future for future, _ in self._flying.values())])
        self._flying.clear()

    def _submit(self) -> None:
        """Keep every thread busy, and as much again waiting; what is suspected goes alone."""
        if self._suspects:
            if not self._flying:
                index = self._suspects.popleft()
                self._fly(range(index, index + 1))
            return
        while len(self._flying) < 2 * self._threads + 1 and not self._failed:
            batch = range(self._begun, min(self._begun + self._batch_size(), len(self._items)))
            if not batch:
                return
            self._fly(batch)
            self._begun = batch.stop

    def _batch_size(self) -> int:
        if self._mean_s is None:
            return 1
        fair = (len(self._items) - self._begun) // (2 * self._threads)
        return max(1, min(int(_BATCH_S / max(self._mean_s, _BATCH_S / _MOST_A_BATCH)), fair))

    def _fly(self, batch: range) -> None:
        key = f"{self._stage} {batch.start} {uuid.uuid4().hex[:8]}"
        items = [self._items[index] for index in batch]
        future = self._client.submit(_batch, self._work, self._shared, items, versions(), key=key)
        self._flying[key] = future, batch
        future.add_done_callback(partial(_report, self._ended, key))

    def _collect(self) -> None:
        """Wait for a batch, and look now and then whether any can still come."""
        try:
            key = self._ended.get(timeout=_LOOK_S)
        except queue.Empty:
            self._check_life()
            return
        self._alive = time.monotonic()
        future, batch = self._flying.pop(key)
        self._keep(future, batch, alone=not self._flying)

    def _keep(self, future: Future, batch: range, *, alone: bool) -> None:
        if future.status == "error":
            self._keep_error(future, batch, alone=alone)
            return
        found = future.result()
        self._outcomes.update(zip(batch, found, strict=True))
        self._failed |= any(not outcome.done for outcome in found)
        mean = sum(outcome.wall_s for outcome in found) / len(found)
        self._mean_s = mean if self._mean_s is None else (self._mean_s + mean) / 2

    def _keep_error(self, future: Future, batch: range, *, alone: bool) -> None:
        error = future.exception()
        if not isinstance(error, KilledWorker):  # a bug: raised at its place in the order
            self._outcomes[batch.start] = error.with_traceback(future.traceback())
        elif alone and len(batch) == 1:
            what = f"{DEATHS} workers died of it, perhaps for want of memory"
            self._outcomes[batch.start] = Outcome(failed=what)
        else:
            self._suspects.extend(batch)
            return
        self._failed = True

    def _check_life(self) -> None:
        """Refuse to wait for ever for workers that are gone or have no memory left."""
        if self._client.status != "running":
            raise ConnectionResetError(self._client.status)
        workers = self._client.scheduler_info()["workers"].values()
        if any(worker["status"] == "running" for worker in workers):
            self._alive, self._waiting = time.monotonic(), False
            return
        if not self._waiting:
            self._engine.note(f"{_standing(workers)}: waiting for one, {PATIENCE_S:.0f} s at most")
            self._waiting = True
        if time.monotonic() - self._alive > PATIENCE_S:
            raise UserError(
                f"no worker can go on: {_standing(workers)}",
                where=self._engine.place,
                expected=f"one that is ready within {PATIENCE_S:.0f} s",
                fix=self._engine.more_memory
                if workers
                else _OTHERS.format(self._client.scheduler.address),
            )


def _standing(workers: Collection[Any]) -> str:
    return f"every worker ({len(workers)}) is paused, out of memory" if workers else _GONE


def _report(ended: queue.SimpleQueue[str], key: str, future: Future) -> None:
    del future
    ended.put(key)
