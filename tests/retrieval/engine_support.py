"""Engines for tests: what they do to tasks is what a cluster may do to them."""

from __future__ import annotations

import pickle
import random
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from typing import Any

from airzoo_bench.engines.engine import Engine


@dataclass
class Shuffled(Engine):
    """Does tasks out of order, on pickled copies.

    Parameters
    ----------
    sent : list of int
        Bytes of each item, and last of what is shared, of all calls.
    """

    seed: int = 0
    sent: list[int] = field(default_factory=list)
    distributed = True

    def map(
        self,
        work: Callable[[Any, Any], Any],
        items: Sequence[Any],
        *,
        shared: Any,
        stage: str,
        name: Callable[[Any], str],
    ) -> Iterator[Any]:
        tasks = [pickle.dumps((work, item)) for item in items]
        assert all(name(item) for item in items)
        common = pickle.dumps(shared)
        assert stage
        self.sent += [*map(len, tasks), len(common)]
        order = list(range(len(tasks)))
        random.Random(self.seed).shuffle(order)
        done = {index: self._done(tasks[index], common) for index in order}
        return iter([done[index] for index in range(len(tasks))])

    def _done(self, task: bytes, common: bytes) -> Any:
        return do(task, common)


def do(task: bytes, common: bytes) -> Any:
    """Do a task twice, as after a worker was lost, and give what came back the second time."""
    work, item = pickle.loads(task)  # noqa: S301 - our own
    work(pickle.loads(common), item)  # noqa: S301
    return pickle.loads(pickle.dumps(work(pickle.loads(common), item)))  # noqa: S301


@dataclass
class Processes(Shuffled):
    """Does each task in one of two other processes."""

    def __post_init__(self) -> None:
        self._pool = ProcessPoolExecutor(2, get_context("spawn"))

    def _done(self, task: bytes, common: bytes) -> Any:
        return self._pool.submit(do, task, common).result()
