"""A scheduler and its workers, as processes of their own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

HOME = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Standing:
    """A scheduler that runs by itself."""

    address: str
    process: subprocess.Popen[bytes]


def start(*arguments: object) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", *map(str, arguments)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": str(HOME)},
    )


@contextmanager
def scheduler(folder: Path, *pages: str) -> Iterator[Standing]:
    """Start a scheduler without workers, by default without a dashboard."""
    file = folder / "scheduler.json"
    arguments = ("--host", "127.0.0.1", "--port", 0, "--scheduler-file", file)
    process = start("distributed.cli.dask_scheduler", *arguments, *(pages or ["--no-dashboard"]))
    try:
        while not file.exists():
            assert process.poll() is None
            time.sleep(0.05)
        yield Standing(json.loads(file.read_text())["address"], process)
    finally:
        process.kill()
        process.wait()


@contextmanager
def scheduler_and_worker(folder: Path, *pages: str) -> Iterator[Standing]:
    """Start a scheduler, and a worker of it."""
    with scheduler(folder, *pages) as made:
        arguments = (made.address, "--no-nanny", "--nthreads", 1, "--no-dashboard")
        process = start("distributed.cli.dask_worker", *arguments)
        try:
            yield made
        finally:
            process.kill()
            process.wait()
