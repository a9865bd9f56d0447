"""Kills `write_submission` at every line of the modules that write; prints JSON of what is left.

Run by test_killed in a process without threads, since each case is a fork.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
from pathlib import Path
from types import FrameType
from typing import Any

from airzoo_bench.leaderboard.known import Place
from airzoo_bench.leaderboard.making import Files, write_submission
from tests.leaderboard.submission.support import values

PLACE = Place("made", "retrieval", "salad")
_LINES_OF = ("making.py", "files.py", "shutil.py")


class Killer:
    """Ends this process at the n-th line."""

    def __init__(self, step: int) -> None:
        self.left = step

    def __call__(self, frame: FrameType, event: str, _: Any) -> Any:
        if Path(frame.f_code.co_filename).name not in _LINES_OF:
            return None
        if event == "line":
            self.left -= 1
            if self.left == 0:
                os.kill(os.getpid(), signal.SIGKILL)
        return self


def new(root: Path, letter: str) -> None:
    """Write the submission of a letter, as `submission new --force` does."""
    preds = root.parent / letter
    stated = {k: v for k, v in values(summary=letter).items() if k not in ("schema", "predictions")}
    write_submission(root, PLACE, stated, Files(preds, claimed=preds), replace=True)


def tree(root: Path) -> dict[str, str]:
    """Return all files below submissions/, with their content."""
    home = root / "submissions"
    files = sorted(path for path in home.rglob("*") if path.is_file())
    return {path.relative_to(home).as_posix(): path.read_text()[:400] for path in files}


def killed(root: Path, step: int) -> bool:
    """Write b in a process that dies at a step; returns whether it did."""
    child = os.fork()
    if child == 0:
        sys.settrace(Killer(step))
        new(root, "b")
        os._exit(0)
    return bool(os.WIFSIGNALED(os.waitpid(child, 0)[1]))


def case(home: Path, board: Path, step: int, *, before: bool) -> dict[str, Any] | None:
    root = home / "board"
    shutil.rmtree(root, ignore_errors=True)
    shutil.copytree(board, root)
    if before:
        new(root, "a")
    if not killed(root, step):
        return None
    left = {name: text for name, text in tree(root).items() if "/." not in name}
    new(root, "b")
    return {"left": left, "end": tree(root)}


def main() -> None:
    """Kill at some hundred moments, evenly."""
    home, board, before, stride = (
        Path(sys.argv[1]),
        Path(sys.argv[2]),
        sys.argv[3],
        int(sys.argv[4]),
    )
    for letter in "ab":
        (home / letter).write_text(letter)
    found = []
    step = 1
    while (one := case(home, board, step, before=before == "replaced")) is not None:
        found.append(one)
        step += stride
    sys.stdout.write(json.dumps(found))


if __name__ == "__main__":
    main()
