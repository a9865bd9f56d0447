"""One process at a time: a lock that ends with the process that holds it, however that ends."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

__all__ = ["locked"]


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the lock that a file stands for, after waiting for whoever holds it.

    The file is made, and stays: were it removed, two could hold it at once. On disks that know no
    locks (some of clusters) nobody waits.

    Raises
    ------
    OSError
        The file, or its folder, cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("ab") as stream:
        with suppress(OSError):
            _wait(stream)
        yield  # closing the file gives the lock back


if sys.platform == "win32":
    import msvcrt

    def _wait(stream: IO[bytes]) -> None:
        msvcrt.locking(stream.fileno(), msvcrt.LK_LOCK, 1)

else:
    import fcntl

    def _wait(stream: IO[bytes]) -> None:
        fcntl.flock(stream, fcntl.LOCK_EX)
