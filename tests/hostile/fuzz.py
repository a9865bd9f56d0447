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
import re
import resource
import shlex
import shutil
import signal
import sys
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import chdir, contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from types import FrameType
from unittest import mock

import numpy as np
import typer

from airzoo_bench.cli import main as cli
from tests.hostile.inputs import Input, make_inputs, spoilt
from tests.support import HANGS_S, run_main

CPU_S = 20.0
"""Seconds of a processor that a case may take; by the clock, only one that hangs is stopped."""
_MEMORY = 6 << 30
_FINE = (0, 1, 2)
_LEAKED = re.compile(r"Warning:|Traceback|^ERROR \d|^(?:CPLE|GDAL|TIFF)\w*:", re.MULTILINE)


@dataclass(frozen=True)
class Failure:
    """A case that went wrong, and how to see it again."""

    seed: int
    case: int
    command: str
    why: str
    said: str


class _TooLong(BaseException):
    """A case takes longer than it may; no code of the suite catches this."""


def kind_of_case(inputs: list[Input], seed: int, number: int) -> tuple[Input, np.random.Generator]:
    """Draw the kind of input of a case, and what spoils it."""
    random = np.random.default_rng((seed, number))
    shares = np.array([one.share for one in inputs])
    return inputs[int(random.choice(len(inputs), p=shares / shares.sum()))], random


def run_case(inputs: list[Input], seed: int, number: int, folder: Path) -> Failure | None:
    """Run a case in an empty folder."""
    one, random = kind_of_case(inputs, seed, number)
    words = spoilt(one, random, folder)
    os.environ["AIRZOO_BENCH_DATA"] = "data"
    with chdir(folder):
        code, said, seconds = _run(words, folder.parent / "said")
    why = ""
    if code is None or seconds > CPU_S:
        why = f"took {seconds:.0f} s of a processor{'' if code is not None else ', and no end'}"
    elif code not in _FINE:
        why = f"exit code {code}"
    elif found := _LEAKED.search(said):
        why = f"leaked {found[0]!r}"
    return Failure(seed, number, shlex.join(words), why, said[-3000:]) if why else None


def _run(arguments: list[str], said: Path) -> tuple[int | None, str, float]:
    code, begin = None, _cpu_s()
    with _captured(said), _limited(), suppress(_TooLong):
        code = run_main(*arguments)
    return code, said.read_text(errors="replace"), _cpu_s() - begin


def _cpu_s() -> float:
    """Return the seconds of processors that this process took, and its ended children."""
    return sum(os.times()[:4])


@contextmanager
def _captured(path: Path) -> Iterator[None]:
    """Send all that this process says into a file, that of C libraries too."""
    kept = [os.dup(1), os.dup(2)]
    streams = sys.stdout, sys.stderr
    with path.open("w") as out:
        try:
            os.dup2(out.fileno(), 1)
            os.dup2(out.fileno(), 2)
            sys.stdout = sys.stderr = out
            yield
        finally:
            out.flush()
            sys.stdout, sys.stderr = streams
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


def run_cases(seed: int, numbers: list[int], only: str, keep: Path) -> int:
    """Run cases and print what fails; return how many did."""
    keep.mkdir(parents=True, exist_ok=True)
    failures = 0
    # Typer builds its tree of commands anew for every call, which takes longer than most cases.
    build = typer.main.get_command
    tree = build(cli.app)
    built = mock.patch("airzoo_bench.cli.main.app", tree)
    once = mock.patch("typer.main.get_command", lambda app: tree if app is tree else build(app))
    with tempfile.TemporaryDirectory() as home, built, once:
        with _captured(keep / "made"):
            inputs = [one for one in make_inputs(Path(home)) if only in one.name]
        for number in numbers:
            folder = Path(home) / "case"
            folder.mkdir()
            (keep / "running").write_text(f"{seed} {number}")
            failure = run_case(inputs, seed, number, folder)
            if failure is not None:
                failures += 1
                place = keep / f"{seed}-{number}"
                shutil.rmtree(place, ignore_errors=True)
                shutil.copytree(folder, place, ignore_dangling_symlinks=True)
                sys.stdout.write(json.dumps(asdict(failure)) + "\n")
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
