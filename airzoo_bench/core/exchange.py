"""Putting a folder where another stands, in one step where the system knows how to."""

from __future__ import annotations

import ctypes
import errno
import os
import sys
from pathlib import Path
from typing import Any

from airzoo_bench.core.temporaries import set_aside

__all__ = ["exchange"]

_AT_FDCWD = -100
_SWAP = 2  # RENAME_EXCHANGE of Linux and RENAME_SWAP of macOS alike
# What a system or a file system says that does not know how to.
_UNKNOWN = {errno.ENOSYS, errno.EINVAL, errno.ENOTSUP, errno.EOPNOTSUPP}


def exchange(new: Path, path: Path) -> None:
    """Put a folder where another stands; what stood there is afterwards at `new`, or removed.

    Both have one parent. Killed in between, `path` is the old or the new folder, whole. Systems
    without such a step take two, and the next run puts the old folder back if it was killed between
    them. After an OSError neither has moved.
    """
    if _swapped(new, path):
        return
    with set_aside(path.parent, (path.name,)):
        new.replace(path)


def _swapped(new: Path, path: Path) -> bool:
    if sys.platform == "win32":
        return False
    libc: Any = ctypes.CDLL(None, use_errno=True)
    names = os.fsencode(new), os.fsencode(path)
    if hasattr(libc, "renameat2"):
        failed = libc.renameat2(_AT_FDCWD, names[0], _AT_FDCWD, names[1], _SWAP)
    elif hasattr(libc, "renamex_np"):
        failed = libc.renamex_np(*names, _SWAP)
    else:
        return False
    code = ctypes.get_errno()
    if failed and code not in _UNKNOWN:
        raise OSError(code, os.strerror(code), str(path))
    return not failed
