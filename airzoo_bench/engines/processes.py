"""Tasks in processes of this machine, for work that keeps the interpreter's lock."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from typing import TypeVar

from airzoo_bench.core.errors import UserError
from airzoo_bench.core.parallel import parallel_map
from airzoo_bench.engines.engine import Engine, runs
from airzoo_bench.engines.tasks import attempt

__all__ = ["Processes"]

S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")


class Processes(Engine):
    """Processes that are started for a stage and end with it.

    Parameters
    ----------
    jobs : int
        How many; with one, all is done right here.
    """

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs
        self.distributed = jobs > 1

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
        jobs = max(1, min(self._jobs, len(items)))
        found = parallel_map(partial(attempt, work, shared), items, jobs)
        try:
            for item, outcome in zip(items, found, strict=True):
                yield outcome.value(name(item), self.more_memory)
        except BrokenProcessPool as error:
            raise UserError(
                "a process was killed, perhaps for want of memory",
                where=stage,
                fix="lower --jobs, or add --engine dask, where others do its work again",
            ) from error
