"""Spoilt inputs of every kind through the command line, in this process, a case a number.

    python -m tests.hostile.fuzz --seed 0 --cases 2000 [--only matching] [--keep DIR]
    python -m tests.hostile.fuzz --seed 0 --case 1234 --keep DIR      # one again, with its output

A case follows from its seed and its number alone. What fails is printed as a line of JSON, and the
case is kept with its input below DIR. Who runs this in a process of its own learns from the file
``DIR/running`` which case ended the process.
"""

from __future__ import annotations

import argparse
import json
import os
import pkgutil
import re
import resource
import shlex
import shutil
import signal
import sys
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import chdir, contextmanager, redirect_stderr, redirect_stdout, suppress
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import Any
from unittest import mock

import numpy as np
import typer

import airzoo_bench
from airzoo_bench.cli import main as cli
from airzoo_bench.core import sandbox
from tests.hostile.inputs import Input, make_inputs, spoilt
from tests.support import HANGS_S, run_main

CPU_S = 20.0
"""Seconds of a processor that a case may take; by the clock, only one that hangs is stopped."""
_MEMORY = 6 << 30
_FINE = (0, 1, 2)
_LEAKED = re.compile(r"Warning:|Traceback|^ERROR \d|^(?:CPLE|GDAL|TIFF)\w*:", re.MULTILINE)


class _TooLong(BaseException):
    """A case takes longer than it may; no code of the suite catches this."""


def run_case(inputs: list[Input], seed: int, number: int, folder: Path) -> dict[str, Any]:
    """Run a case in an empty folder, and return what went wrong and how to see it again."""
    random = np.random.default_rng((seed, number))
    shares = np.array([one.share for one in inputs])
    one = inputs[int(random.choice(len(inputs), p=shares / shares.sum()))]
    words, code = spoilt(one, random, folder), None
    said, begin = folder.parent / "said", _cpu_s()
    os.environ["AIRZOO_BENCH_DATA"] = "data"
    with chdir(folder), _captured(said), _limited(), suppress(_TooLong):
        code = run_main(*words)
    text, seconds, why = said.read_text(errors="replace"), _cpu_s() - begin, ""
    if code is None or seconds > CPU_S:
        why = f"took {seconds:.0f} s of a processor{'' if code is not None else ', and no end'}"
    elif code not in _FINE:
        why = f"exit code {code}"
    elif found := _LEAKED.search(text):
        why = f"leaked {found[0]!r}"
    command = shlex.join(words)
    again = {"seed": seed, "case": number, "command": command, "why": why, "said": text[-3000:]}
    return again if why else {}


def _cpu_s() -> float:
    """Return the seconds of processors that this process took, and its ended children."""
    return sum(os.times()[:4])


@contextmanager
def _captured(path: Path) -> Iterator[None]:
    """Send all that this process says into a file, that of C libraries too."""
    kept = [os.dup(1), os.dup(2)]
    with path.open("w") as out, redirect_stdout(out), redirect_stderr(out):
        try:
            for number in (1, 2):
                os.dup2(out.fileno(), number)
            yield
        finally:
            out.flush()
            for number, handle in enumerate(kept, 1):
                os.dup2(handle, number)
                os.close(handle)


@contextmanager
def _limited() -> Iterator[None]:
    def stop(_signal: int, _frame: FrameType | None) -> None:
        raise _TooLong

    limits = (
        (signal.ITIMER_PROF, signal.SIGPROF, 1.25 * CPU_S),
        (signal.ITIMER_REAL, signal.SIGALRM, HANGS_S),
    )
    before = [signal.signal(number, stop) for _, number, _ in limits]
    for timer, _, seconds in limits:
        signal.setitimer(timer, seconds)
    try:
        yield
    finally:
        for (timer, number, _), handler in zip(limits, before, strict=True):
            signal.setitimer(timer, 0)
            signal.signal(number, handler)


def run_forked(where: Path, limits: sandbox.Limits, folder: Path, _: object) -> None:
    """Read predictions in a fork of this process: a new one takes a second to begin."""
    if not (child := os.fork()):
        for stream in (1, 2):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
        try:
            sandbox.main(folder, where)
        finally:
            os._exit(int(sys.exc_info()[0] is not None))
    try:
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    except _TooLong:
        os.kill(child, signal.SIGKILL)
        raise
    if code:
        raise sandbox._refusal(where, f"the process that reads it was ended ({code})")


def run_cases(seed: int, numbers: list[int], only: str, keep: Path) -> int:
    """Run cases and print what fails; return how many did."""
    keep.mkdir(parents=True, exist_ok=True)
    failures = 0
    for module in pkgutil.walk_packages(airzoo_bench.__path__, "airzoo_bench."):
        import_module(module.name)  # or each fork would
    # Typer builds its tree of commands anew for every call, which takes longer than most cases.
    build = typer.main.get_command
    tree = build(cli.app)
    built = mock.patch("airzoo_bench.cli.main.app", tree)
    forked = mock.patch("airzoo_bench.core.sandbox._run_child", run_forked)
    once = mock.patch("typer.main.get_command", lambda app: tree if app is tree else build(app))
    with tempfile.TemporaryDirectory() as home, built, once, forked:
        with _captured(keep / "made"):
            inputs = [one for one in make_inputs(Path(home)) if only in one.name]
        for number in numbers:
            folder = Path(home) / "case"
            folder.mkdir()
            (keep / "running").write_text(f"{seed} {number}")
            if failure := run_case(inputs, seed, number, folder):
                failures += 1
                place = keep / f"{seed}-{number}"
                shutil.rmtree(place, ignore_errors=True)
                shutil.copytree(folder, place, ignore_dangling_symlinks=True)
                sys.stdout.write(json.dumps(failure) + "\n")
                sys.stdout.flush()
            shutil.rmtree(folder)
    (keep / "running").unlink(missing_ok=True)
    return failures


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cases", type=int, default=2000)
    parser.add_argument("--case", type=int)
    parser.add_argument("--only", default="", help="kinds whose name holds this text")
    parser.add_argument("--keep", type=Path, default=Path("fuzz-failures"))
    given = parser.parse_args()
    warnings.simplefilter("always")
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, resource.RLIM_INFINITY))
    numbers = list(range(given.cases)) if given.case is None else [given.case]
    sys.exit(1 if run_cases(given.seed, numbers, given.only, given.keep) else 0)


if __name__ == "__main__":
    main()
