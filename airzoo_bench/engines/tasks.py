"""One task: its result, or what kept it from one."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from airzoo_bench.core.errors import UserError

__all__ = ["Outcome", "attempt"]

S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")


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
    wall_s: float = 0.0

    @property
    def done(self) -> bool:
        """Whether there is a result."""
        return self.fault is None and self.failed is None

    def value(self, item: str, more_memory: str) -> R:
        """Return the result."""
        if self.fault is not None:
            raise self.fault
        if self.failed is not None:
            raise UserError(self.failed, where=item, fix=self.fix or more_memory)
        return self.result  # type: ignore[return-value]


def attempt(work: Callable[[S, T], R], shared: S, item: T) -> Outcome[R]:
    """Do a task, and return its result or what kept it from one."""
    begun = time.monotonic()
    try:
        return Outcome(work(shared, item), wall_s=time.monotonic() - begun)
    except UserError as fault:
        return Outcome(fault=fault)
    except MemoryError:
        return Outcome(failed="too little memory for it")
    except OSError as error:
        return Outcome(failed=_told(error), fix="mend that, then run again")


def _told(error: OSError) -> str:
    text = error.strerror or str(error) or type(error).__name__
    return text if error.filename is None else f"{text}: {error.filename}"
