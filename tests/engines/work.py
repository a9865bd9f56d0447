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


def meet(folder: Path, number: int) -> int:
    """Wait until two processes are at work."""
    (folder / str(os.getpid())).touch()
    end = time.monotonic() + 100
    while len(list(folder.iterdir())) < 2 and time.monotonic() < end:
        time.sleep(0.01)
    return os.getpid()


def total(shared: tuple[bytes, npt.NDArray[np.float64]], weights: npt.NDArray[np.float64]) -> str:
    """Return a sum that rounds otherwise where arrays lie at odd addresses."""
    return float((shared[1][::3] * weights[::3]).sum()).hex()


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


def faulty(folder: Path, number: int) -> int:
    """Fail at item 3, in the way that the folder's name says."""
    if number < 3:
        return number
    if folder.name == "unreadable":
        return len((folder / "shard-3.npy").read_bytes())
    if folder.name == "hungry":
        raise MemoryError
    if folder.name == "buggy":
        raise KeyError(number)
    raise PredictionError("x" * 20_000, where=f"row {number}", expected="less", fix="cut it")


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
