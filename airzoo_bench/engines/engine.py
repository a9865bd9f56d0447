"""What an engine is, and the plain one: all work in this process, one task after the other.

A track cuts its work by `Engine.cut` and hands it to `Engine.map` as a pure function of what all
tasks share and of one item; it reduces the results in the order of the items. It never asks which
engine it has, so that a record is the same bytes on any.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

from airzoo_bench.engines.tasks import attempt

__all__ = ["HERE", "Engine", "Here", "runs"]

S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")


class Engine(ABC):
    """Where tasks are done.

    Attributes
    ----------
    dashboard : str or None
        Where a browser shows what is going on.
    distributed : bool
        Whether other processes work, so that work is cut and a run can be lost.
    more_memory : str
        What a user may do where a task has too little.
    """

    dashboard: str | None = None
    distributed: bool = False
    more_memory: str = "lower --jobs, or run it on a machine with more memory"

    def begin(self, run: str) -> None:  # noqa: B027 - most engines keep nothing
        """Say which run the tasks are of that come next."""

    def forget(self) -> None:  # noqa: B027 - most engines keep nothing
        """Drop what is kept of the run: it cannot be trusted."""

    @abstractmethod
    def cut(self, count: int, size: int) -> list[slice]:
        """Cut so many elements into runs, each of which is a task."""

    @abstractmethod
    def map(
        self,
        work: Callable[[S, T], R],
        items: Sequence[T],
        *,
        shared: S,
        stage: str,
        name: Callable[[T], str],
    ) -> Iterator[R]:
        """Yield what ``work(shared, item)`` returns, in the order of the items."""


def runs(count: int, size: int) -> list[slice]:
    """Cut so many elements into runs of a size; the last may be shorter."""
    return [slice(begin, min(begin + size, count)) for begin in range(0, count, size)]


class Here(Engine):
    """All work in this process; what a task does, it may do in threads."""

    def cut(self, count: int, size: int) -> list[slice]:
        """See `Engine.cut`."""
        del size
        return [slice(0, count)] if count else []

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
        for item in items:
            yield attempt(work, shared, item).value(name(item), self.more_memory)


HERE: Engine = Here()
"""Does one task after the other, in this process."""
