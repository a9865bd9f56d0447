"""Engines do blocks of work: in this process, in processes of this machine, or on a cluster.

A track cuts its work with `Engine.cut` and gives `Engine.map` a pure function of what all blocks
share and of one item. Results come in the order of the items, the same bytes from any engine.
"""

from __future__ import annotations

import importlib.util
import re
import signal
import sys
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, TypeVar

from airzoo_bench.core.errors import UsageError, UserError
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.core.registry import resolve

S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")

UNREAD = 4
"""Blocks a worker that may wait to be read, so that memory does not grow with their number."""
MORE_MEMORY = "lower --jobs, raise --max-memory, or use workers or a machine with more memory"
LOCAL, DASK = "local", "dask"
_ADDRESS = re.compile(r"(tcp|tls)://(\[[0-9a-fA-F:.]+\]|[^\s/:@]+):\d{1,5}")
_IDLE_S = 60
_QUIET = "ignore:resource_tracker"


class Fault(NamedTuple):
    """The error of a block, returned because Dask shortens messages of raised errors."""

    error: UserError


class Engine:
    """Does one block after the other in this process; a block itself may use threads."""

    distributed: bool = False  # whether other processes work, so that work is cut
    dashboard: str | None = None  # where a browser shows what is going on

    def __init__(self, progress: Progress = silent) -> None:
        self.progress = progress

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
        be mapped, and must not be written to. `stage` is what the items are, for progress, and
        `name` returns what an item is called in messages.
        """
        if not len(items):
            return
        with closing(self._results(work, items, shared, stage)) as results:
            shown = self.progress(results, stage, len(items)) if len(items) > 1 else results
            for item, found in zip(items, shown, strict=True):
                if isinstance(found, Fault):
                    error = found.error
                    raise error if error.where is not None else error.inside(name(item))
                yield found

    def _results(
        self, work: Callable[[S, T], R], items: Sequence[T], shared: S, stage: str
    ) -> Generator[R | Fault, None, None]:
        """Yield the result of each item in order, or its fault."""
        del stage
        for item in items:
            yield attempt(work, shared, item)


HERE = Engine()
"""Does one block after the other, in this process."""


def split(count: int, size: int) -> list[slice]:
    """Split `count` elements into blocks of `size`; the last may be shorter."""
    return [slice(begin, min(begin + size, count)) for begin in range(0, count, size)]


def attempt(work: Callable[[S, T], R], shared: S, item: T) -> R | Fault:
    """Return the result of a block, or the fault that a user can mend."""
    try:
        return work(shared, item)
    except UserError as error:
        return Fault(error)
    except MemoryError:
        return Fault(UserError("too little memory for it", fix=MORE_MEMORY))
    except OSError as error:
        what = error.strerror or str(error) or type(error).__name__
        what = what if error.filename is None else f"{what}: {error.filename}"
        return Fault(UserError(what, fix="mend that, then run again"))


def wait_in_order(
    submit: Callable[[T], Any], wait: Callable[[Any], R], items: Sequence[T], most: int
) -> Generator[R, None, None]:
    """Submit items, at most `most` ahead of the reader, and yield their results in order."""
    waiting: deque[Any] = deque()
    for item in items:
        waiting.append(submit(item))
        if len(waiting) == most:
            yield wait(waiting.popleft())
    while waiting:
        yield wait(waiting.popleft())


class Processes(Engine):
    """Does blocks in `jobs` processes of this machine: joblib's loky, started at the first `map`.

    With one job all is done in this process.
    """

    def __init__(self, jobs: int, progress: Progress = silent) -> None:
        super().__init__(progress)
        self.distributed = jobs > 1
        self._jobs = jobs
        self._pool: Any = None

    def _results(
        self, work: Callable[[S, T], R], items: Sequence[T], shared: S, stage: str
    ) -> Generator[R | Fault, None, None]:
        if self._jobs == 1 or len(items) == 1:
            yield from super()._results(work, items, shared, stage)
            return
        import joblib  # takes 50 ms, which commands that start no process do without

        with TemporaryDirectory(ignore_cleanup_errors=True) as folder:
            file = str(Path(folder, "shared"))
            joblib.dump((work, shared), file)
            try:
                yield from wait_in_order(
                    lambda item: self._submit(file, item),
                    lambda future: future.result(),
                    items,
                    UNREAD * self._jobs,
                )
            except BrokenProcessPool as error:
                self.kill()
                raise UserError(
                    "a process was killed, perhaps for want of memory",
                    where=stage,
                    fix="lower --jobs, or add --engine dask, which does its work again",
                ) from error
            except BaseException:
                self.kill()
                raise

    def _submit(self, file: str, item: T) -> Any:
        # joblib.Parallel would compute all items at once, however few are read.
        from joblib.externals.loky import ProcessPoolExecutor

        with without_ctrl_c():
            if self._pool is None:
                self._pool = ProcessPoolExecutor(self._jobs, timeout=_IDLE_S)
            return self._pool.submit(_attempt_dumped, file, item)

    def kill(self) -> None:
        """End the processes in the middle of their blocks."""
        if self._pool is not None:
            pool, self._pool = self._pool, None
            # Not `shutdown(kill_workers=True)`, which fails where blocks are still queued.
            for process in list(pool._processes.values()):
                process.terminate()
            pool.shutdown(wait=True)


@lru_cache(maxsize=1)
def _load_shared(file: str) -> Any:
    import joblib

    return joblib.load(file, mmap_mode="r")  # written by this run, for its own processes


def _attempt_dumped(file: str, item: T) -> Any:
    work, shared = _load_shared(file)
    return attempt(work, shared, item)


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
def open_engine(
    where: str,
    *,
    jobs: int,
    memory_bytes: int | None = None,
    here: Engine | None = None,
    note: Callable[[str], None] = lambda _: None,
) -> Iterator[Engine]:
    """Open the engine that --engine names: local, dask, or a scheduler's address; it ends after."""
    if where == LOCAL:
        engine = here or Engine()
        try:
            yield engine
        finally:
            if isinstance(engine, Processes):
                engine.kill()
        return
    if where != DASK and not _ADDRESS.fullmatch(where):
        raise UsageError(
            "that is no engine, and not the address of a scheduler",
            where=f"--engine {where}",
            expected="local, dask, tcp://HOST:PORT or tls://HOST:PORT",
        )
    if importlib.util.find_spec("distributed") is None:
        raise UsageError(
            f"--engine {where} needs Dask, which is not installed",
            fix="pip install 'airzoo-bench[dask]'",
        )
    dask = "airzoo_bench.engines.dask"  # Dask is an extra
    if where == DASK:
        cluster = resolve(f"{dask}:local_cluster")(jobs, memory_bytes)
    else:
        cluster = resolve(f"{dask}:connect")(where, note)
    with cluster as engine:
        if engine.dashboard is not None:
            note(f"dashboard: {engine.dashboard}")
        yield engine
