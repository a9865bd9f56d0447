"""Transcripts of whole sessions: what commands print, what they exit with, which files they leave.

A transcript is its own script: each line that begins with ``$ `` is a command, and what follows it
is what happened. To record all of them anew, after a change that is meant to be seen::

    python -m tests.frozen.transcripts
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import platform
import re
import shlex
import sys
import tempfile
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from unittest import mock

from airzoo_bench.cli.main import main as airzoo_bench
from tests.frozen.made_files import make
from tests.support import BRIGHTON, PAPER

HERE = Path(__file__).parent
SESSIONS = ("mistakes", "brighton", "mini")
# Their last bits or pixels follow from these; the suite's own numbers are held elsewhere.
LIBRARIES = (
    "numpy",
    "scipy",
    "pandas",
    "pycolmap",
    "faiss-cpu",
    "matplotlib",
    "rasterio",
    "pillow",
)
# A command that writes more files is given one checksum for all of them.
MOST_LISTED = 12
# What a slow machine says besides.
TIME_LEFT = re.compile(r"(, about \d+ \w+ left| \.\.\.)$")
# They hold times.
UNLIKE_EACH_TIME = ("timings.csv", "prepared.json")


def made_with() -> str:
    """Return the first line of every transcript: what the bytes of a run may depend on."""
    from numpy._core._multiarray_umath import __cpu_features__ as has

    vectors = max(
        (name for name in ("SSE42", "AVX2", "AVX512_SKX", "NEON") if has.get(name)), key=len
    )
    libraries = " ".join(f"{name} {version(name)}" for name in LIBRARIES)
    return f"# {platform.machine()} {vectors}, Python {platform.python_version()}, {libraries}"


def commands(session: str) -> list[str]:
    """Return the commands of a transcript."""
    text = (HERE / f"{session}.txt").read_text(encoding="utf-8")
    return [line[2:] for line in text.splitlines() if line.startswith("$ ")]


def replay(session: str, home: Path) -> str:
    """Run a session in an empty folder, and return its transcript as of now."""
    for name, data in (("brighton", BRIGHTON), ("paper", PAPER)):
        if data.is_dir():
            (home / name).symlink_to(data.resolve())
    settings = {"AIRZOO_BENCH_DATA": "data", "COLUMNS": "80", "TERM": "dumb"}
    with contextlib.chdir(home), mock.patch.dict(os.environ, settings):
        parts = [made_with() + "\n", *map(_step, commands(session))]
    return "\n".join(parts)


def _step(command: str) -> str:
    """Run one command, and return what happened."""
    before = dict(_files())
    printed, said, code = _run(shlex.split(command))
    changed = {name: seen for name, seen in _files() if before.get(name) != seen}
    gone = sorted(before.keys() - dict(_files()).keys())
    lines = [f"$ {command}", *printed.splitlines()]
    lines += [f"[stderr] {line}" for line in said.splitlines() if not TIME_LEFT.search(line)]
    lines += [f"[exit {code}]"] if code else []
    if not command.startswith("make "):
        lines += _checksums(changed) + [f"[removed {name}]" for name in gone]
    return "".join(f"{line.rstrip()}\n" for line in lines).replace(str(Path.cwd()), "HOME")


def _run(words: list[str]) -> tuple[str, str, int]:
    if words[0] == "make":
        make(*words[1:])
        return "", "", 0
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8") for _ in range(2))
    code: object = 0
    streams = contextlib.redirect_stdout(out), contextlib.redirect_stderr(err)
    # Of a module that was run by `python -m`, the command line would call itself by its package.
    name = mock.patch.object(sys.modules["__main__"], "__package__", None)
    with streams[0], streams[1], name, mock.patch.object(sys, "argv", words):
        try:
            airzoo_bench()
        except SystemExit as done:
            code = done.code or 0
    texts = [stream.buffer.getvalue().decode() for stream in _flushed(out, err)]
    return texts[0], texts[1], int(str(code))


def _flushed(*streams: io.TextIOWrapper) -> Iterator[io.TextIOWrapper]:
    for stream in streams:
        stream.flush()
        yield stream


def _files() -> Iterator[tuple[str, tuple[int, int, int]]]:
    """Yield the files of the session, each with what tells whether it was written again."""
    for folder, _, names in os.walk("."):
        for name in names:
            path = Path(folder, name)
            seen = path.stat()
            yield path.as_posix(), (seen.st_ino, seen.st_mtime_ns, seen.st_size)


def _checksums(changed: dict[str, object]) -> list[str]:
    names = sorted(name for name in changed if not Path(name).is_symlink())
    sums = {name: _checksum(Path(name)) for name in names}
    if len(sums) <= MOST_LISTED:
        return [f"[wrote {name} {found}]" for name, found in sums.items()]
    whole = hashlib.sha256(repr(sums).encode()).hexdigest()[:12]
    return [f"[wrote {len(sums)} files, from {names[0]} to {names[-1]} {whole}]"]


def _checksum(path: Path) -> str:
    if path.name in UNLIKE_EACH_TIME:
        return "-"
    content = path.read_bytes().replace(str(Path.cwd()).encode(), b"HOME")
    return hashlib.sha256(content).hexdigest()[:12]


def main() -> None:
    """Record the sessions named, or all."""
    for session in sys.argv[1:] or SESSIONS:
        with tempfile.TemporaryDirectory() as home:
            text = replay(session, Path(home))
        (HERE / f"{session}.txt").write_text(text, encoding="utf-8")
        print(session)  # noqa: T201 - run by hand


if __name__ == "__main__":
    main()
