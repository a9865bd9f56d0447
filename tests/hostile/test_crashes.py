"""Killed or failing at any step, a run leaves what was there or what it made, never a mixture.

A step is what Python's audit hooks announce: opening to write, making, renaming, removing; "line"
kills at every line of Python between them too. Each case runs in a forked process of its own, on
a folder of its own; as a program this file runs the cases of a fault and prints JSON.
"""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from airzoo_bench.core.files import atomic_entries, atomic_folder, atomic_write

NAMES = ("result", "records", "figures")
STEPS = ("open", "os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.chmod", "shutil.rmtree")
_NO_FAULT = 3  # there are fewer steps


def fill(folder: Path, text: str) -> None:
    for name in NAMES[:2]:
        (folder / name).write_text(text)
    (folder / NAMES[2]).mkdir()
    (folder / NAMES[2] / f"{text[0]}.png").write_text(text)


def entries(home: Path, text: str) -> None:
    with atomic_entries(home / "out", NAMES) as staged:
        fill(staged, text)


def folder(home: Path, text: str) -> None:
    with atomic_folder(home / "out", replace=True) as staged:
        (staged / "benchmark.toml").touch()
        fill(staged, text)


def file(home: Path, text: str) -> None:
    with atomic_write(home / "out" / "result", "w") as stream:
        stream.write(text)


Writer = Callable[[Path, str], None]
WRITERS: dict[str, Writer] = {"entries": entries, "folder": folder, "file": file}


class Fault:
    """What befalls a writer at the n-th step."""

    def __init__(self, kind: str, step: int) -> None:
        self.kind, self.step, self.count = kind, step, 0

    def arm(self) -> None:
        if self.kind == "line":
            sys.settrace(self._trace)
        else:
            sys.addaudithook(self._hook)

    def _hook(self, event: str, arguments: tuple[Any, ...]) -> None:
        writes = event != "open" or arguments[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        if event in STEPS and writes:
            self._count()

    def _trace(self, frame: FrameType, event: str, _: object) -> Any:
        if event == "line":
            self._count()
        return self._trace if Path(frame.f_code.co_filename).name == "files.py" else None

    def _count(self) -> None:
        self.count += 1
        if self.count == self.step and self.kind == "failed":
            raise OSError(errno.ENOSPC, "No space left on device")
        if self.count == self.step:
            os.kill(os.getpid(), signal.SIGKILL)


def run(write: Writer, home: Path, text: str, fault: Fault) -> int:
    """Run a writer in a process of its own, and return its exit code, negative for a signal."""
    child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    fault.arm()
    try:
        write(home, text)
    except Exception:  # noqa: BLE001 - whatever it is, what counts is what is left on the disk
        os._exit(1)
    os._exit(0 if fault.count >= fault.step else _NO_FAULT)


def state(home: Path) -> dict[str, str]:
    """Return the content of each file below a folder that is not hidden."""
    found = {path.relative_to(home).as_posix(): path for path in sorted(home.rglob("*"))}
    shown = {name: path for name, path in found.items() if not f"/{name}".count("/.")}
    return {name: path.read_text() for name, path in shown.items() if path.is_file()}


def cases_of(root: Path, kind: str, fault: str) -> list[dict[str, Any]]:
    cases: list[dict[str, Any]] = []
    while not cases or cases[-1]["code"] != _NO_FAULT:
        step = len(cases) + 1
        home = root / kind / str(step)
        (home / "out").mkdir(parents=True)
        fill(home / "out", "a")
        (home / "out" / ("benchmark.toml" if kind == "folder" else "thesis")).touch()
        code = run(WRITERS[kind], home, "b", Fault(fault, step))
        case = {"code": code, "left": state(home)}
        case["again"] = run(WRITERS[kind], home, "b", Fault("none", -1))
        cases.append(
            case | {"end": state(home), "hidden": [str(path) for path in home.rglob(".*")]}
        )
    return cases


pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="forks")
KINDS = pytest.mark.parametrize("kind", list(WRITERS))


@cache
def cases(fault: str) -> dict[str, list[dict[str, Any]]]:
    """Run the cases of a fault in one process, and return them by the kind of writer."""
    with tempfile.TemporaryDirectory() as home:
        command = [sys.executable, "-m", __name__, home, fault]
        root = Path(__file__).parents[2]  # tests.support would load too much for forks
        return json.loads(subprocess.check_output(command, cwd=root, timeout=600))


def whole(letter: str, kind: str) -> dict[str, str]:
    """Return the files that are there when a writer has written all, or nothing."""
    others = "a" if kind == "file" else letter
    files = {"out/result": letter, "out/records": others, f"out/figures/{others}.png": others}
    return files | {"out/benchmark.toml" if kind == "folder" else "out/thesis": ""}


@KINDS
def test_a_step_that_fails_leaves_what_was_there(kind: Any) -> None:
    found = cases("failed")[kind]
    assert len(found) > 3
    for case in found:
        # A step may fail without harm: one that makes what is there, or takes the old away.
        either = [whole("a", kind)] * (case["code"] == 1) + [whole("b", kind)]
        assert case["left"] in either
        assert case["end"] == whole("b", kind)
    assert any(case["left"] == whole("a", kind) for case in found)


@KINDS
@pytest.mark.parametrize("fault", ["killed", pytest.param("line", marks=pytest.mark.slow)])
def test_killed_at_any_step(kind: Any, fault: str) -> None:
    found = cases(fault)[kind]
    assert len(found) > (3 if kind == "file" else 10)
    for case in found:
        left = case["left"]
        incomplete = kind != "file" and "out/result" not in left
        assert left in (whole("a", kind), whole("b", kind)) or incomplete
        assert kind == "folder" or "out/thesis" in left
        assert case["again"] == 0
        assert case["end"] == whole("b", kind)
        assert case["hidden"] == []


if __name__ == "__main__":
    json.dump(
        {kind: cases_of(Path(sys.argv[1]), kind, sys.argv[2]) for kind in WRITERS}, sys.stdout
    )
