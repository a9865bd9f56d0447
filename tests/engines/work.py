"""Tasks for tests of engines; workers import them by name."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from airzoo_bench.core.errors import PredictionError

Arrays = dict[str, npt.NDArray[Any]]


def named(item: object) -> str:
    return f"shard {item}"


def square(added: int, number: int) -> Arrays:
    return {"square": np.array([number * number + added]), "who": np.array(os.getpid())}


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


def unreadable(folder: Path, number: int) -> int:
    """Read a shard that is not there."""
    if number == 3:
        return len((folder / "shard-3.npy").read_bytes())
    return number


def buggy(table: dict[int, int], number: int) -> int:
    return table[number]


def faulty(length: int, number: int) -> int:
    if number >= 3:
        raise PredictionError("x" * length, where=f"row {number}", expected="less", fix="cut it")
    return number


def hungry(shared: None, number: int) -> int:
    del shared
    if number == 3:
        raise MemoryError
    return number


def waiting(folder: Path, number: int) -> int:
    """Say that it is at work; the first two end, the rest waits."""
    (folder / f"at-{number}").touch()
    time.sleep(0 if number < 2 else 600)
    return number
