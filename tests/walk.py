"""Prints how many files and functions of the package a command runs: ``python -m tests.walk``.

Bodies of modules and classes are not counted.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from types import CodeType, FrameType

PACKAGE = Path(__file__).parents[1] / "airzoo_bench"


def walk(arguments: list[str]) -> dict[str, int]:
    """Run a command in this process and count what of the package it runs."""
    from airzoo_bench.cli.main import main

    ran: set[CodeType] = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        if event == "call":
            ran.add(frame.f_code)

    sys.argv = ["airzoo-bench", *arguments]
    sys.setprofile(note)
    try:
        main()
    except SystemExit as end:
        if end.code:
            raise
    finally:
        sys.setprofile(None)
    # Functions are optimised code, the bodies of modules and classes are not.
    home = f"{PACKAGE}{os.sep}"
    functions = [one for one in ran if one.co_flags & 1 and one.co_filename.startswith(home)]
    files = {Path(code.co_filename).relative_to(PACKAGE) for code in functions}
    return {"files": len(files), "functions": len(functions)}


def walk_template(track: str) -> dict[str, int]:
    """Return the counts of `eval` for a track's template on the shipped demo, in a new process."""
    with tempfile.TemporaryDirectory() as home:
        folder = Path(home)
        made = folder / ("preds" if track == "reconstruction" else "preds.npz")
        tool = [sys.executable, "-m", "airzoo_bench"]
        command = [*tool, "template", f"airzoo-demo-{track}", "--out", str(made)]
        subprocess.run(command, check=True, capture_output=True)
        here = [sys.executable, "-m", "tests.walk", "eval", track, str(made)]
        said = subprocess.run(here, check=True, capture_output=True, text=True).stderr
    counts = (line.rpartition(": ") for line in said.splitlines() if line.startswith("walk, "))
    return {name.removeprefix("walk, "): int(count) for name, _, count in counts}


def main() -> None:
    """Print the counts of a command, or of the three tracks' templates."""
    if arguments := sys.argv[1:]:
        for name, count in walk(arguments).items():
            sys.stderr.write(f"walk, {name}: {count}\n")
        return
    for track in ("retrieval", "matching", "reconstruction"):
        counts = ", ".join(f"{count} {name}" for name, count in walk_template(track).items())
        sys.stdout.write(f"{track}: {counts}\n")


if __name__ == "__main__":
    main()
