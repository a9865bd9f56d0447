"""An engine that treats tasks as a cluster may: other memory, another order, done twice."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

import numpy as np

from airzoo_bench.engines.engine import Engine

__all__ = ["Scattered"]

S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")


class Scattered(Engine):
    """Pickles all that a task is given and gives, and does tasks in another order, each twice.

    Parameters
    ----------
    size : int or None
        Elements of a cut, whatever a track asks for; as it asks where None.
    seed : int
        Of the order.
    """

    def __init__(self, size: int | None = None, seed: int = 0) -> None:
        self._size, self._seed = size, seed
        self.stages: dict[str, int] = {}

    def cut(self, count: int, size: int) -> list[slice]:
        size = self._size or size
        return [slice(begin, min(begin + size, count)) for begin in range(0, count, size)]

    def map(
        self,
        work: Callable[[S, T], R],
        items: Sequence[T],
        *,
        shared: S,
        stage: str,
        name: Callable[[T], str],
    ) -> Iterator[R]:
        assert all(name(item) for item in items)
        self.stages[stage] = self.stages.get(stage, 0) + len(items)
        tasks = [pickle.dumps((work, shared, item)) for item in items]
        results: dict[int, bytes] = {}
        for number in np.random.default_rng(self._seed).permutation(len(tasks)).tolist():
            results[number] = _done(tasks[number])
            assert _done(tasks[number]) == results[number], f"{name(items[number])} done twice"
        for number in range(len(tasks)):
            yield pickle.loads(results[number])  # noqa: S301 - its own


def _done(task: bytes) -> bytes:
    work, shared, item = pickle.loads(task)  # noqa: S301 - its own
    return pickle.dumps(work(shared, item))
