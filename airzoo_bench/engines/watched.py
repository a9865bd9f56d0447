"""Another engine, whose stages are shown while they run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

from airzoo_bench.core.progress import Progress
from airzoo_bench.engines.engine import Engine

__all__ = ["Watched"]

S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")


class Watched(Engine):
    """Shows stages of several tasks.

    Parameters
    ----------
    inner : Engine
        Does the work.
    progress : Progress
        Shows it.
    """

    def __init__(self, inner: Engine, progress: Progress) -> None:
        self._inner, self._progress = inner, progress
        self.distributed = inner.distributed

    def begin(self, run: str) -> None:
        """See `Engine.begin`."""
        self._inner.begin(run)

    def forget(self) -> None:
        """See `Engine.forget`."""
        self._inner.forget()

    def cut(self, count: int, size: int) -> list[slice]:
        """See `Engine.cut`."""
        return self._inner.cut(count, size)

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
        results = self._inner.map(work, items, shared=shared, stage=stage, name=name)
        if len(items) > 1:
            results = self._progress(results, stage, len(items))
        yield from results
