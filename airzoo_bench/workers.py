"""Work spread over processes, for code that keeps the interpreter's lock."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import TypeVar

__all__ = ["spread"]

T = TypeVar("T")
R = TypeVar("R")


def spread(work: Callable[[T], R], items: Sequence[T], workers: int) -> Iterator[R]:
    """Yield the work done on each item, in order.

    Processes are spawned, since a fork would copy the thread pools of faiss and BLAS in whatever
    state they are. Work and items must be picklable; with one worker it is done right here.

    Parameters
    ----------
    work : callable
    items : sequence
    workers : int
        Processes, at least 1.
    """
    if workers == 1:
        yield from map(work, items)
        return
    with ProcessPoolExecutor(workers, get_context("spawn"), _leave_interrupts) as pool:
        yield from pool.map(work, items)


def _leave_interrupts() -> None:
    # Ctrl-C is for the parent, which then ends its workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
