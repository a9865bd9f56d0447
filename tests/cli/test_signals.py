"""Ctrl-C and SIGTERM end any command in time, also one that is deep in a library."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.support import HANGS_S, environment, files_below, make_place

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")

# Waits for ever where Python cannot look at signals: in the main thread, but not in its bytecode.
_STUCK = """
import sys
from pathlib import Path
from airzoo_bench.__main__ import main
from airzoo_bench.cli import main as commands
from airzoo_bench.core.files import temporary_folder

def stuck(home: Path) -> None:
    with temporary_folder(home, "out"):
        print("ready", flush=True)
        {wait}

sys.modules["airzoo_bench.cli.stuck"] = sys.modules["__main__"]
commands._PLACES["stuck"] = "stuck:stuck", ""
sys.argv = ["airzoo-bench", "stuck", sys.argv[1]]
main()
"""
# LAPACK takes minutes for this, and does not return to the interpreter at a signal.
_DEEP = "import numpy as np; np.linalg.eigvals(np.random.default_rng(0).random((6000, 6000)))"
_SLEEP = "import time; time.sleep(600)"
# Unwinds for ever: a library that waits for its threads.
_NEVER_STOPS = """
        import time
        try:
            time.sleep(600)
        finally:
            time.sleep(600)
"""

_SOLVED = """
import signal, sys
signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
from airzoo_bench.evaluation.track import Run
from airzoo_bench.matching.solving import solve_queries
from tests.matching.world import SOLVER, joined, make_scene
assert "pycolmap" not in sys.modules
solve_queries(*joined([make_scene(0).problem]), SOLVER, Run(jobs=2), "one")
signal.raise_signal(signal.SIGTERM)
"""


def test_solving_leaves_sigterm_to_the_command() -> None:
    # The solvers run in threads, where a signal cannot be given back.
    command = [sys.executable, "-c", _SOLVED]
    done = subprocess.run(command, env=environment(), capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (143, b"")


# The signal comes as that module is imported.
_EARLY = """
import signal, sys
from airzoo_bench import __main__
class Finder:
    def find_spec(self, name, *given):
        if name == "airzoo_bench.cli.main":
            signal.raise_signal(signal.SIGINT)
sys.meta_path.insert(0, Finder())
__main__.main()
"""
_MESSAGE = b"airzoo-bench: stopped; nothing was left half-written\n"


def test_a_stop_before_the_command_line_looks_for_one() -> None:
    command = [sys.executable, "-c", _EARLY]
    done = subprocess.run(command, capture_output=True, env=environment(), check=False)
    assert (done.returncode, done.stderr) == (130, _MESSAGE)


# Each of a thousand tiles takes so long that the signal comes in time on a machine of any speed.
_SLOWED = """
import time
from airzoo_bench.__main__ import main
from airzoo_bench.datasets import folder
read = folder.read_tile
folder.read_tile = lambda *given: (time.sleep(0.05), read(*given))[1]
main()
"""


def test_an_interrupted_prepare_leaves_nothing(tmp_path: Path) -> None:
    place = make_place(tmp_path / "sources")
    arguments = place.arguments(out=tmp_path / "out" / "park", tile_size=16, tiles="files")
    process = subprocess.Popen(
        [sys.executable, "-c", _SLOWED, *arguments], stderr=subprocess.PIPE, env=environment()
    )
    deadline = time.monotonic() + HANGS_S
    while not list(tmp_path.glob("out/.park.prepare/.park.*/scenes/park/retrieval/tiles/*.png")):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, message = process.communicate(timeout=HANGS_S)
    assert process.returncode == 130
    assert message.endswith(_MESSAGE)
    assert b"Traceback" not in message
    assert files_below(tmp_path / "out") == set()


@pytest.mark.parametrize(
    ("wait", "number"),
    [
        (_SLEEP, signal.SIGTERM),
        (_NEVER_STOPS, signal.SIGINT),
        pytest.param(_DEEP, signal.SIGINT, marks=pytest.mark.slow),
    ],
)
def test_a_command_ends_in_time(wait: str, number: int, tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", _STUCK.replace("{wait}", wait), str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=environment() | {"OPENBLAS_NUM_THREADS": "1"},
    )
    assert process.stdout is not None
    assert process.stdout.readline() == b"ready\n"
    time.sleep(0.5)
    process.send_signal(number)
    from resource import RUSAGE_CHILDREN, getrusage

    before = getrusage(RUSAGE_CHILDREN)
    _, message = process.communicate(timeout=HANGS_S)
    # LAPACK would have taken minutes of a processor.
    assert getrusage(RUSAGE_CHILDREN).ru_utime - before.ru_utime < 60.0
    assert process.returncode == 128 + number
    assert message == _MESSAGE
    assert list(tmp_path.iterdir()) == []
