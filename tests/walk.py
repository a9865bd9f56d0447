"""Prints how much of the package one command runs: ``python -m tests.walk``.

Files and functions of `airzoo_bench` whose code runs between a command's start and its end
(bodies of modules and classes are not counted), and modules of the package that are loaded.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from types import CodeType, FrameType

PACKAGE = Path(__file__).parents[1] / "airzoo_bench"
ROOMS = ("benchmark", "engines", "evaluation", "formats", "protocol", "retrieval", "storage")
"""The rooms of the scoring core, of whose files few should run for one score."""


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
    rooms = Counter(file.parts[0] for file in files)
    return {
        "files": len(files),
        "files of the core's rooms": sum(rooms[room] for room in ROOMS),
        "functions": len(functions),
        "modules": sum(name.split(".")[0] == PACKAGE.name for name in sys.modules),
    }


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
