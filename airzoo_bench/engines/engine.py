"""Engines do blocks of work: in this process, in processes of this machine, or on a cluster.

A track cuts its work with `Engine.cut` and gives `Engine.map` a pure function of what all blocks
share and of one item. Results come in the order of the items, the same bytes from any engine.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from functools import partial
from threading import Thread
from typing import Any, TypeVar

from airzoo_bench.core.errors import UsageError, UserError
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.core.registry import resolve

S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")

UNREAD = 4
"""Blocks a worker that may wait to be read, so that memory does not grow with their number."""
MORE_MEMORY = "lower --jobs, or use workers or a machine with more memory"
LOCAL, DASK, _QUIET = "local", "dask", "ignore:resource_tracker"


class Engine:
    """Does blocks in `jobs` processes of this machine; with one job, here one after the other.

    The processes are joblib's loky, started at the first `map`. A block itself may use threads.
    """

    def __init__(self, jobs: int = 1) -> None:
        self.progress: Progress = silent
        self.distributed = jobs > 1  # whether other processes work, so that work is cut
        self._jobs = jobs
        self._pool: Any = None

    def cut(self, count: int, size: int) -> list[slice]:
        """Cut `count` elements into blocks of `size`, or into one where all is done here."""
        return split(count, size if self.distributed else max(count, 1))

    def map(
        self,
        work: Callable[[S, T], R],
        items: Sequence[T],
        *,
        shared: S,
        stage: str,
        name: Callable[[T], str],
    ) -> Iterator[R]:
        """Yield what ``work(shared, item)`` returns, in the order of the items.

        `work` is a function of a module, which other processes import. The arrays of `shared` may
        be mapped, and must not be written to. `stage` says what the items are, for progress, and
        `name` returns the name of an item in messages.
        """
        with closing(self._results(work, items, shared, stage)) as results:
            shown = self.progress(results, stage, len(items)) if len(items) > 1 else results
            for item in items:
                try:
                    result = next(shown)
                except UserError as error:
                    raise error if error.where is not None else error.inside(name(item)) from None
                yield result
            next(shown, None)  # so that progress ends

    def _results(
        self, work: Callable[..., Any], items: Sequence[Any], shared: Any, stage: str
    ) -> Generator[Any, None, None]:
        """Yield the result of each item, in their order."""
        if self._jobs == 1 or len(items) < 2:
            yield from (work(shared, item) for item in items)
            return
        # NumPy and loky take time to import, which commands that start no process do without.
        with resolve("airzoo_bench.core.shared:write_shared")((work, shared)) as file:
            try:
                yield from read_ahead(partial(self._submit, file), items, self._jobs)
            except BaseException as error:
                self.close()
                if not isinstance(error, BrokenProcessPool):
                    raise
                what = "a process was killed, perhaps for want of memory"
                fix = "lower --jobs, or add --engine dask, which does its work again"
                raise UserError(what, where=stage, fix=fix) from error

    def _submit(self, file: str, item: Any) -> Callable[[], Any]:
        # joblib.Parallel would compute all items at once, however few are read.
        with without_ctrl_c():
            if self._pool is None:
                pool = resolve("joblib.externals.loky:ProcessPoolExecutor")
                self._pool = pool(self._jobs, initializer=_start_worker)
            return self._pool.submit(_work_on, file, item).result  # type: ignore[no-any-return]

    def close(self) -> None:
        """End the processes of this engine in the middle of their blocks."""
        if self._pool is not None:
            pool, self._pool = self._pool, None
            # Not `shutdown(kill_workers=True)`, which fails where blocks are still queued.
            for process in list(pool._processes.values()):
                process.terminate()
            pool._result_queue._writer.close()  # or half a result would be waited for
            pool.shutdown(wait=True)


HERE = Engine()
"""Does one block after the other, in this process."""


def split(count: int, size: int) -> list[slice]:
    """Split `count` elements into blocks of `size`; the last may be shorter."""
    return [slice(begin, min(begin + size, count)) for begin in range(0, count, size)]


def read_ahead(
    submit: Callable[[T], Callable[[], R]], items: Sequence[T], workers: int
) -> Iterator[R]:
    """Yield the results of items; only a few are submitted before they are read."""
    waiting: deque[Callable[[], R]] = deque()
    for item in items:
        waiting.append(submit(item))
        if len(waiting) >= UNREAD * workers:
            yield waiting.popleft()()
    while waiting:
        yield waiting.popleft()()


def _start_worker() -> None:
    """Let this process end with its parent, also where that is killed in the middle of a block."""
    from joblib.externals.loky import process_executor

    process_executor._USE_PSUTIL = False  # it takes what a process keeps for a leak, and ends it
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    Thread(target=watch, daemon=True).start()


def _work_on(file: str, item: Any) -> Any:
    work, shared = resolve("airzoo_bench.core.shared:load_shared")(file)
    return work(shared, item)


@contextmanager
def without_ctrl_c() -> Iterator[None]:
    """Start processes that a Ctrl-C does not reach: this process ends them."""
    if _QUIET not in sys.warnoptions:  # the tracker of a stopped run need not warn of its locks
        sys.warnoptions.append(_QUIET)
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def open_engine(where: str, *, jobs: int, processes: int = 1) -> Iterator[Engine]:
    """Open the engine that --engine names, for as long as a block of code runs.

    A local one has `processes`; `jobs` are the workers of Dask on this machine.
    """
    if where == LOCAL:
        with closing(Engine(processes)) as engine:
            yield engine
        return
    try:
        name = "local_cluster" if where == DASK else "connect"
        opener = resolve(f"airzoo_bench.engines.dask:{name}")
    except ModuleNotFoundError as error:  # Dask is an extra
        what = f"--engine {where} needs {error.name}, which is not installed"
        raise UsageError(what, fix="pip install 'airzoo-bench[dask]'") from error
    with opener(jobs if where == DASK else where) as engine:
        yield engine
