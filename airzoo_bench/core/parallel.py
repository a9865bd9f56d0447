"""Work spread over processes, for code that keeps the interpreter's lock."""

from __future__ import annotations

import signal
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context
from typing import TypeVar, cast

__all__ = ["parallel_map", "without_ctrl_c"]

T = TypeVar("T")
R = TypeVar("R")

_QUIET = "ignore:resource_tracker"
# In a worker: whether it is at work on an item, and whether it was told to end.
_working = False
_ending = False


def parallel_map(work: Callable[[T], R], items: Sequence[T], jobs: int) -> Iterator[R]:
    """Yield the work done on each item, in order."""
    if jobs == 1:
        yield from map(work, items)
        return
    with ProcessPoolExecutor(jobs, get_context("spawn"), _obey_the_parent) as pool:
        others = active_children()
        # Not `pool.map`, which cancels what is left, and so trips the pool over workers that ended.
        with without_ctrl_c():
            left = deque(pool.submit(_unless_ending, work, item) for item in items)
        own = [process for process in active_children() if process not in others]
        try:
            while left:
                yield cast(R, left.popleft().result())
        except BaseException:
            for process in own:
                process.terminate()
            raise


@contextmanager
def without_ctrl_c() -> Iterator[None]:
    """Start processes that a Ctrl-C does not reach, not even while they import; it waits for here.

    What a stopped run leaves of locks its tracker clears, which need not warn of it.
    """
    if _QUIET not in sys.warnoptions:
        sys.warnoptions.append(_QUIET)
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _obey_the_parent() -> None:
    # Ctrl-C is for the parent, which then ends its workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _end)


def _end(*_: object) -> None:
    global _ending
    if _working and not _ending:
        _ending = True
        # Half-written files are taken away on the way out; told twice, it is at that already.
        raise SystemExit
    # Between items a result may be on its way: the pool waits for ever for the rest of a half one.
    _ending = True


def _unless_ending(work: Callable[[T], R], item: T) -> R | None:
    """Do the work; nothing, once told to end: the pool then runs dry, and ends its processes."""
    global _working
    if _ending:
        return None
    try:
        _working = True
        return work(item)
    except SystemExit:
        return None
    finally:
        _working = False
