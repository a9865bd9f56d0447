"""Kills a writer at every step, or lets each fail; run by test_crashes, prints JSON.

A step is what Python's audit hooks announce: opening to write, making, renaming, removing. "line"
kills at every line of Python between them too, as when a file is made and not yet written, and
"full" lets no file grow beyond so many bytes. Each case runs in a forked process of its own, on a
folder of its own.
"""

from __future__ import annotations

import errno
import json
import os
import resource
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

from airzoo_bench.core.files import atomic_entries, atomic_folder, atomic_write

NAMES = ("result", "records", "figures")
STEPS = ("open", "os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.chmod", "shutil.rmtree")
_SIZE = 20_000
_GROWTH_BYTES = 4096  # times the step
_LINES_OF = ("files.py",)
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


def prepare(home: Path, kind: str, text: str) -> None:
    (home / "out").mkdir(parents=True)
    fill(home / "out", text)
    if kind == "folder":
        (home / "out" / "benchmark.toml").touch()
    if kind == "shared":
        (home / "out" / "thesis").write_text("mine")


Writer = Callable[[Path, str], None]
WRITERS: dict[str, Writer] = {
    "entries": entries,
    "shared": entries,
    "folder": folder,
    "file": file,
}


class Fault:
    """What befalls a writer at the n-th step."""

    def __init__(self, kind: str, step: int) -> None:
        self.kind, self.step, self.count = kind, step, 0

    def arm(self) -> None:
        if self.kind == "full":
            most = self.step * _GROWTH_BYTES
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (most, resource.RLIM_INFINITY))
        elif self.kind == "line":
            sys.settrace(self._trace)
        else:
            sys.addaudithook(self._hook)

    def _hook(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event in STEPS and (event != "open" or _writes(arguments)):
            self._count()

    def _trace(self, frame: FrameType, event: str, _: object) -> Any:
        if event == "line":
            self._count()
        return self._trace if Path(frame.f_code.co_filename).name in _LINES_OF else None

    def _count(self) -> None:
        self.count += 1
        if self.count == self.step and self.kind == "failed":
            raise OSError(errno.ENOSPC, "No space left on device")
        if self.count == self.step and self.kind != "none":
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
    os._exit(0 if fault.count >= fault.step or fault.kind == "full" else _NO_FAULT)


def _writes(arguments: tuple[Any, ...]) -> bool:
    return bool(arguments[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))


def state(home: Path) -> dict[str, str]:
    """Return the first letter of each file below a folder that is not hidden."""
    found = {}
    for path in sorted(home.rglob("*")):
        name = path.relative_to(home).as_posix()
        if path.is_file() and not any(part.startswith(".") for part in name.split("/")):
            content = path.read_text()
            found[name] = content[:1] if len(set(content)) <= 1 and content else content
    return found


def hidden(home: Path) -> list[str]:
    return [path.name for path in home.rglob("*") if path.name.startswith(".")]


def main() -> None:
    root, kind, fault = Path(sys.argv[1]), sys.argv[2], sys.argv[3]
    size = 1 if fault == "line" else _SIZE
    old, new = "a" * size, "b" * size
    cases = []
    for step in range(1, 2000):
        home = root / str(step)
        prepare(home, kind, old)
        code = run(WRITERS[kind], home, new, Fault(fault, step))
        left = state(home)
        again = run(WRITERS[kind], home, new, Fault("none", -1))
        cases.append({"code": code, "left": left, "again": again, "end": state(home)})
        cases[-1]["hidden"] = hidden(home)
        if code == (0 if fault == "full" else _NO_FAULT):
            break
    json.dump(cases, sys.stdout)


if __name__ == "__main__":
    main()
