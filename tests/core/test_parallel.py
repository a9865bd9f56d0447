from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from airzoo_bench.core.parallel import parallel_map
from tests.support import HANGS_S

SCRIPT = """
import sys, time
from functools import partial
from pathlib import Path
from airzoo_bench.core.files import atomic_write
from airzoo_bench.core.parallel import parallel_map

def slow(folder, number):
    with atomic_write(folder / f"{number}.bin") as stream:
        stream.write(b"half")
        stream.flush()
        time.sleep(0 if number < 2 else 600)
    return number

if __name__ == "__main__":
    for number in parallel_map(partial(slow, Path(sys.argv[1])), list(range(40)), 2):
        print(number, flush=True)
"""


def square(number: int) -> int:
    return number * number


def slow_square(number: int) -> int:
    time.sleep(0.02)
    return number * number


def fail(number: int) -> int:
    if number == 3:
        raise ValueError("three")
    return number


def test_results_come_in_order_for_any_number_of_workers() -> None:
    assert list(parallel_map(square, range(10), 1)) == [n * n for n in range(10)]
    assert list(parallel_map(square, range(10), 2)) == [n * n for n in range(10)]


def test_an_error_of_a_worker_is_the_parents() -> None:
    with pytest.raises(ValueError, match="three"):
        list(parallel_map(fail, range(10), 2))


LARGE = """
import sys
from airzoo_bench.core.parallel import parallel_map

def large(number):
    return bytes(1 << 20)

if __name__ == "__main__":
    for number, _ in enumerate(parallel_map(large, list(range(2_000)), 2)):
        print(number, flush=True)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_ending_early_leaves_the_workers_of_others_alone() -> None:
    ended, other = (parallel_map(slow_square, range(60), 2) for _ in range(2))
    assert next(other) == 0
    assert next(ended) == 0
    ended.close()
    assert list(other) == [number**2 for number in range(1, 60)]


def test_workers_that_hand_over_large_results_end_too(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(LARGE)
    for lines in (1, 10, 100):
        process = subprocess.Popen(
            [sys.executable, str(script)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        assert process.stdout is not None
        for _ in range(lines):
            process.stdout.readline()
        os.killpg(process.pid, signal.SIGINT)
        process.communicate(timeout=HANGS_S)
        assert process.returncode != 0


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_an_interrupt_ends_all_at_once_and_leaves_nothing(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    out = tmp_path / "out"
    out.mkdir()
    process = subprocess.Popen(
        [sys.executable, str(script), str(out)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stdout is not None
    assert [process.stdout.readline() for _ in range(2)] == ["0\n", "1\n"]
    while len(list(out.glob(".*"))) < 2:  # both workers are in the middle of a file
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does it, to all of them
    _, errors = process.communicate(timeout=HANGS_S)
    assert process.returncode != 0
    assert "KeyboardInterrupt" in errors
    assert "InvalidStateError" not in errors
    assert sorted(path.name for path in out.iterdir()) == ["0.bin", "1.bin"]
