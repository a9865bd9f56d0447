"""An engine that treats tasks as a cluster may."""

from __future__ import annotations

import pickle
import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from airzoo_bench.engines.engine import Engine


@dataclass
class Shuffled(Engine):
    """Does tasks out of order and twice, on pickled copies; `sent` are the bytes of each."""

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
        assert stage
        assert all(map(name, items))
        tasks = [pickle.dumps((shared, item)) for item in items]
        self.sent += map(len, tasks)
        order = list(range(len(tasks)))
        random.Random(self.seed).shuffle(order)
        done = {}
        for index in order * 2:
            done[index] = pickle.dumps(work(*pickle.loads(tasks[index])))  # noqa: S301 - our own
        return iter([pickle.loads(done[index]) for index in range(len(tasks))])  # noqa: S301
