"""Time this package beside what a user would pick instead, and print ratios.

A file of cases ends in ``main(CASES)``. Each side of a case runs in a process of its own on the
same inputs, which `Case.make` writes to a folder. The first side is the one that ratios refer to.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
SUITE = [sys.executable, "-m", "airzoo_bench"]

Work = Callable[[], Mapping[str, Any] | None] | Sequence[str]
"""What is timed: a function, whose arrays are kept for `Case.compare`, or a command."""


@dataclass(frozen=True)
class Figures:
    """Seconds and megabytes of a side, and the arrays that it returned."""

    seconds: float
    processor: float
    peak_mb: float
    arrays: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Case:
    """Sides that do the same work, with full and small sizes.

    ``make(folder, **size)`` writes what all sides read; ``side(folder, **size)`` loads it and
    returns the `Work` that is timed, the fastest of `repeats`. `title` may name sizes, and
    `compare` says in a line how the answers and figures of the sides compare.
    """

    title: str
    make: Callable[..., object]
    sides: Mapping[str, Callable[..., Work]]
    full: Mapping[str, Any] = field(default_factory=dict)
    small: Mapping[str, Any] = field(default_factory=dict)
    compare: Callable[[dict[str, Figures]], str] = lambda _: ""
    repeats: int = 1


def no_input(folder: Path, **_: Any) -> None:
    """Make nothing: the sides make their own."""


def same(figures: dict[str, Figures]) -> str:
    """Say whether all sides returned the same arrays, as far as they have the same names."""
    first, *others = (one.arrays for one in figures.values())
    equal = [
        np.array_equal(first[name], other[name])
        for other in others
        for name in first
        if name in other
    ]
    return f"same answers: {'yes' if equal and all(equal) else 'NO'}"


def processor_s() -> float:
    """Return the processor seconds of this process and of its children that have ended."""
    return sum(os.times()[:4])


def clock(work: Work) -> tuple[float, float, Mapping[str, Any]]:
    """Return the seconds and processor seconds of some work, and the arrays it returns."""
    start, used = time.perf_counter(), processor_s()
    if callable(work):
        arrays = work() or {}
    else:
        env = os.environ | {"PYTHONPATH": str(ROOT), "COLUMNS": "80"}
        subprocess.run(work, check=True, env=env, capture_output=True)
        arrays = {}
    return time.perf_counter() - start, processor_s() - used, arrays


def run_side(case: Case, side: str, folder: Path, size: Mapping[str, Any]) -> None:
    """Time a side in this process and leave its figures in the folder."""
    work = case.sides[side](folder, **size)
    runs = [clock(work) for _ in range(case.repeats)]
    place = folder / f"side-{list(case.sides).index(side)}"
    np.savez(f"{place}.npz", **runs[-1][2])
    who = resource.RUSAGE_SELF if callable(work) else resource.RUSAGE_CHILDREN
    peak = resource.getrusage(who).ru_maxrss / 1024
    best = [min(run[part] for run in runs) for part in (0, 1)]
    Path(f"{place}.json").write_text(json.dumps([*best, peak]))


def measure(name: str, case: Case, size: Mapping[str, Any], folder: Path, small: bool) -> None:
    """Run every side in a process of its own, and print a table."""
    command = [sys.executable, sys.argv[0], name, *["--small"] * small, "--in", str(folder)]
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    figures: dict[str, Figures] = {}
    print(f"\n{case.title.format(**size)}")
    print(f"{'':36}{'seconds':>10}{'processor':>11}{'peak MB':>9}{'ratio':>8}")
    for number, side in enumerate(("", *case.sides)):
        subprocess.run([*command, "--side", side], check=True, env=env)
        if not number:
            continue
        place = folder / f"side-{number - 1}"
        with np.load(f"{place}.npz") as arrays:
            figures[side] = Figures(*json.loads(Path(f"{place}.json").read_text()), dict(arrays))
        one, first = figures[side], next(iter(figures.values()))
        ratio = one.seconds / first.seconds
        print(
            f"{side:36}{one.seconds:10.3f}{one.processor:11.3f}{one.peak_mb:9.0f}{ratio:8.2f}",
            flush=True,
        )
    if line := case.compare(figures):
        print(line)


def main(cases: Mapping[str, Case]) -> None:
    """Run the cases that the command line names, all by default."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", choices=[[], *cases], help="all where none is named")
    parser.add_argument("--small", action="store_true", help="sizes that take seconds")
    parser.add_argument("--folder", type=Path, help="where inputs are made, and removed")
    parser.add_argument("--side", help=argparse.SUPPRESS)
    parser.add_argument("--in", dest="place", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    for name in options.cases or cases:
        case = cases[name]
        size = case.small if options.small else case.full
        if options.side:
            run_side(case, options.side, options.place, size)
        elif options.side == "":
            case.make(options.place, **size)
            os.sync()  # or the first sides pay for what is still being written
        else:
            with tempfile.TemporaryDirectory(dir=options.folder) as folder:
                measure(name, case, size, Path(folder), options.small)
