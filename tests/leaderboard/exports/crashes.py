"""Kills an export at many of its steps, each in a process of its own; prints JSON.

What stood there is an export of one image's name, what is being written one of another.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from airzoo_bench.leaderboard.exports.bundle import open_competition
from airzoo_bench.leaderboard.exports.codabench import export_codabench
from airzoo_bench.leaderboard.exports.evalai import export_evalai
from airzoo_bench.leaderboard.exports.phases import read_phases
from tests.hostile.crash_points import Fault, hidden, run
from tests.leaderboard.exports.platform import Made, make

# Steps on which nothing is killed cost as much time; every few are enough.
EVERY = 8


def codabench(made: Made, out: Path, kind: str) -> None:
    phases = read_phases([f"{kind},2027-01-01"], endless=True)
    competition = open_competition(
        made.protocol, made.data, phases, sealed=False, per_day=1, in_all=2
    )
    export_codabench(competition, out, docker_image="image", seconds=60)


def evalai(made: Made, out: Path, kind: str) -> None:
    phases = read_phases([f"{kind},2027-01-01,2027-02-01"], endless=False)
    competition = open_competition(
        made.protocol, made.data, phases, sealed=kind == "new", per_day=1, in_all=2
    )
    export_evalai(competition, out)


WRITERS: dict[str, Callable[[Made, Path, str], None]] = {"codabench": codabench, "evalai": evalai}


def state(home: Path) -> dict[str, str]:
    """Return the hash of each file, leftovers of the killed aside."""
    files = (path for path in sorted(home.rglob("*")) if path.is_file())
    named = ((path.relative_to(home), path) for path in files)
    return {
        name.as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for name, path in named
        if not any(part.startswith(".") for part in name.parts)
    }


def main() -> None:
    root, kind = Path(sys.argv[1]), sys.argv[2]
    made = make("retrieval", root / "made")

    def write(home: Path, text: str) -> None:
        WRITERS[kind](made, home / "out", text)

    wholes = {}
    for text in ("old", "new"):
        assert run(write, root / text, text, Fault("none", -1)) == 0
        wholes[text] = state(root / text / "out")
    cases: list[dict[str, Any]] = []
    for step in range(1, 10_000, EVERY):
        home = root / str(step)
        run(write, home, "old", Fault("none", -1))
        code = run(write, home, "new", Fault("killed", step))
        left = state(home / "out")
        again = run(write, home, "new", Fault("none", -1))
        end, rest = state(home / "out"), hidden(home)
        cases.append({"code": code, "left": left, "again": again, "end": end, "hidden": rest})
        if code >= 0:
            break
    json.dump({"wholes": wholes, "cases": cases}, sys.stdout)


if __name__ == "__main__":
    main()
