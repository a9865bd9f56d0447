"""Tasks for tests of engines, which workers import by name, and an engine made to find faults."""

from __future__ import annotations

import os
import pickle
import signal
import time
from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.engines.engine import Engine, split


def named(item: object) -> str:
    return f"shard {item}"


def square(added: int, number: int) -> int:
    return number * number + added


def meet(folder: Path, number: int) -> int:
    """Wait until two processes are at work."""
    (folder / str(os.getpid())).touch()
    end = time.monotonic() + 100
    while len(list(folder.iterdir())) < 2 and time.monotonic() < end:
        time.sleep(0.01)
    return os.getpid()


def total(shared: tuple[bytes, NDArray[np.float64]], weights: NDArray[np.float64]) -> str:
    """Return a sum that rounds otherwise where arrays lie at odd addresses."""
    return float((shared[1][::3] * weights[::3]).sum()).hex()


def places(shared: Sequence[NDArray[Any]], _: int) -> list[tuple[Any, ...]]:
    """Return of each array its file, whether it is mapped for reading, and its sum."""
    return [(getattr(a, "filename", None), getattr(a, "mode", ""), a.sum()) for a in shared]


def dying_once(flags: Path, number: int) -> int:
    """Kill the worker the first time that it is task 3."""
    if number == 3 and not (flags / "died").exists():
        (flags / "died").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.05)
    return number


def deadly(worst: int, number: int) -> int:
    if number == worst:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def faulty(how: str, number: int) -> int:
    """Fail at item 3."""
    if number == 3 and how == "missing":
        Path("shard-3.npy").read_bytes()
    if number == 3 and how == "buggy":
        raise KeyError(number)
    if number == 3:
        where = "row 3" if how == "placed" else None
        raise PredictionError("x" * 5000, where=where, expected="less", fix="cut it")
    return number


def marking(folder: Path, number: int) -> int:
    (folder / f"at-{number}").touch()
    return number


def waiting(folder: Path, number: int) -> int:
    """Say that it is at work; the first two end, the rest waits."""
    marking(folder, number)
    time.sleep(0 if number < 2 else 600)
    return number


def large(size: int, _: int) -> bytes:
    return bytes(size)


class Scattered(Engine):
    """Treats tasks as a cluster may: pickles them, does them in another order, and each twice.

    It cuts into blocks of `size`, whatever a track asks for.
    """

    def __init__(self, size: int | None = None) -> None:
        super().__init__()
        self._size = size
        self.stages: dict[str, int] = {}

    def cut(self, count: int, size: int) -> list[slice]:
        return split(count, self._size or size)

    def _results(
        self, work: Callable[..., Any], items: Sequence[Any], shared: Any, stage: str
    ) -> Generator[Any, None, None]:
        self.stages[stage] = self.stages.get(stage, 0) + len(items)
        tasks = [pickle.dumps((work, shared, item)) for item in items]
        results: dict[int, bytes] = {}
        for number in np.random.default_rng(0).permutation(len(tasks)).tolist():
            results[number] = _run(tasks[number])
            assert _run(tasks[number]) == results[number], f"{stage} {number} done twice"
        yield from (pickle.loads(results[number]) for number in range(len(tasks)))  # noqa: S301


def _run(task: bytes) -> bytes:
    work, shared, item = pickle.loads(task)  # noqa: S301 - its own
    result: Any = work(shared, item)
    return pickle.dumps(result)
