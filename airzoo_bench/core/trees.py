"""What lies in a folder and below it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

__all__ = ["entries_below"]


def entries_below(folder: Path) -> Iterator[Path]:
    """Yield all that is in a folder and in those below it, each folder once."""
    waiting, seen = [folder], set[str]()
    while waiting:
        here = waiting.pop(0)
        real = os.path.realpath(here)
        if real in seen:
            continue
        seen.add(real)
        with suppress(OSError):
            for entry in sorted(here.iterdir()):
                yield entry
                if entry.is_dir():
                    waiting.append(entry)
