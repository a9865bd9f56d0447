"""One task: done, tried again where a file could not be read, and measured."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

from airzoo_bench.core.errors import UserError
from airzoo_bench.engines.report import Spent

__all__ = ["Outcome", "attempt", "count_read"]

S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")

PAUSES_S = (0.5, 2.0)
"""Waited before a task is tried again that could not read or write."""


@dataclass(frozen=True)
class Outcome(Generic[R]):
    """What became of a task: its result, the fault of the user that it met, or what kept failing.

    Without a `fix`, it failed for want of memory, of which the engine knows how to have more.
    Exceptions travel as values: between machines, long messages of raised ones are cut.
    """

    result: R | None = None
    fault: UserError | None = None
    failed: str | None = None
    fix: str | None = None
    spent: Spent = field(default_factory=Spent)

    @property
    def done(self) -> bool:
        """Whether there is a result."""
        return self.fault is None and self.failed is None

    def value(self, item: str, more_memory: str) -> R:
        """Return the result.

        Parameters
        ----------
        item : str
            What the task was about, for a message.
        more_memory : str
            See `airzoo_bench.engines.engine.Engine`.

        Raises
        ------
        UserError
            There is none.
        """
        if self.fault is not None:
            raise self.fault
        if self.failed is not None:
            raise UserError(self.failed, where=item, fix=self.fix or more_memory)
        return self.result  # type: ignore[return-value]


class _Read:
    """Bytes that tasks of this process have read and no outcome states yet."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._count = 0

    def add(self, count: int) -> None:
        with self._lock:
            self._count += count

    def take(self) -> int:
        with self._lock:
            taken, self._count = self._count, 0
        return taken


_read = _Read()


def count_read(count: int) -> None:
    """Say, within a task, that it read so many bytes; the report of the run adds them up.

    Parameters
    ----------
    count : int
        From a disk or the net; any thread of the task may say it.
    """
    _read.add(count)


def attempt(
    work: Callable[[S, T], R],
    shared: S,
    item: T,
    clock: Callable[[], float] = time.process_time,
) -> Outcome[R]:
    """Do a task; where it cannot read or write, again after a pause, three times in all.

    Parameters
    ----------
    work, shared, item
        See `airzoo_bench.engines.engine.Engine.map`.
    clock : callable
        Processor seconds: of this thread where others work beside it.

    Raises
    ------
    Exception
        A bug of the task, as it was raised.
    """
    begun, wall = clock(), time.monotonic()
    found = _persistent(work, shared, item)
    spent = Spent(clock() - begun, time.monotonic() - wall, _read.take())
    return replace(found, spent=spent)


def _persistent(work: Callable[[S, T], R], shared: S, item: T) -> Outcome[R]:
    for pause in (*PAUSES_S, None):
        try:
            return Outcome(work(shared, item))
        except UserError as fault:
            return Outcome(fault=fault)
        except MemoryError:
            return Outcome(failed="too little memory for it")
        except OSError as error:
            if pause is None:
                what = f"failed {len(PAUSES_S) + 1} times: {_told(error)}"
                return Outcome(failed=what, fix="mend that, then run again")
            time.sleep(pause)
    raise AssertionError


def _told(error: OSError) -> str:
    text = error.strerror or str(error) or type(error).__name__
    return text if error.filename is None else f"{text}: {error.filename}"
