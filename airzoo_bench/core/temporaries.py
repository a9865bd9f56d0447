"""Temporary files and folders beside what they become, cleared by the next writer of that target.

Each is locked by the process that fills it, and a lock ends with its process. Only what carries a
name that is made here for that very target, and that nobody holds, is ever cleared; no file says
what goes. On disks and systems without locks nothing is cleared.
"""

from __future__ import annotations

import ctypes
import errno
import hashlib
import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

if sys.platform != "win32":
    import fcntl

__all__ = [
    "PART",
    "clear_abandoned",
    "exchange",
    "exchange_entries",
    "only_writer",
    "remove_own",
    "temporary_file",
    "temporary_folder",
]

PART = ".airzoo-part"
"""How names of temporary files and folders end."""
_OLD = ".airzoo-old"
_LONGEST = 40  # letters of a target in another name: systems allow 255 bytes
_TRIES, _PAUSE_S = 5, 0.02
_AT_FDCWD = -100
_SWAP = 2  # RENAME_EXCHANGE of Linux and RENAME_SWAP of macOS alike
# What a system or a file system says that does not know how to.
_UNKNOWN = {errno.ENOSYS, errno.EINVAL, errno.ENOTSUP, errno.EOPNOTSUPP}
_NO_LINK = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)

_own: set[Path] = set()


@contextmanager
def temporary_file(target: Path) -> Iterator[tuple[int, Path]]:
    """Make an empty file next to `target`; it is removed at the end if it is still there."""
    _clear(target.parent, target.name, _parts_at_first(target.parent))
    prefix = f"{_stem(target.name)}."
    # A copy of the handle keeps the lock, and outlives the caller's.
    handle, path = _locked(lambda: tempfile.mkstemp(PART, prefix, target.parent))
    lock = os.dup(handle)
    with _removed_at_the_end(path, lock):
        yield handle, path


@contextmanager
def temporary_folder(parent: Path, name: str) -> Iterator[Path]:
    """Make an empty folder in `parent`; whatever stands there is removed at the end."""
    name = Path(name).name
    _clear(parent, name, _parts(parent))

    def make() -> tuple[int, str]:
        folder = tempfile.mkdtemp(PART, f"{_stem(name)}.", parent)
        return os.open(folder, os.O_RDONLY), folder

    lock, path = _locked(make)
    with _removed_at_the_end(path, lock):
        yield path


@contextmanager
def only_writer(target: Path) -> Iterator[None]:
    """Hold a file or folder that is to be written, so that nobody else begins to."""
    target = Path(os.path.realpath(target))
    path = target.parent / f"{_stem(target.name)}{PART}"
    lock = _lock_at(path)
    with _removed_at_the_end(path, lock):
        yield


def clear_abandoned(target: Path) -> None:
    """Remove what dead writers of a target left beside it, or put their old folder back."""
    _clear(target.parent, target.name, _parts(target.parent))
    old = _old(target)
    if target.exists():
        _remove(old)
    elif old.is_dir() and not old.is_symlink():
        old.replace(target)


def exchange(new: Path, path: Path) -> None:
    """Put a folder where another stands; what stood there is afterwards at `new`, or removed."""
    if _swapped(new, path):
        return
    old = _old(path)
    path.replace(old)
    try:
        new.replace(path)
    except BaseException:
        old.replace(path)
        raise
    _remove(old)


def exchange_entries(new: Path, folder: Path, names: Sequence[str]) -> None:
    """Put the entries of a folder into another, in place of those that have these names there."""
    aside = folder / _old(folder).name
    _remove(aside)
    aside.mkdir()
    moves = [(folder / name, aside / name) for name in names if os.path.lexists(folder / name)]
    entries = sorted(new.iterdir(), key=lambda entry: entry.name in names[:1])
    moves += [(entry, folder / entry.name) for entry in entries]
    try:
        for source, target in moves:
            source.replace(target)
    except BaseException:
        for source, target in reversed(moves):
            if os.path.lexists(target) and not os.path.lexists(source):
                target.replace(source)
        aside.rmdir()
        raise
    _remove(aside)


def remove_own() -> None:
    """Remove what this process has made, when it must end without unwinding."""
    for path in list(_own):
        _remove(path)


@contextmanager
def _removed_at_the_end(path: Path, lock: int) -> Iterator[None]:
    _own.add(path)
    try:
        yield
    finally:
        _remove(path)
        _own.discard(path)
        os.close(lock)


def _stem(name: str) -> str:
    """Return how all names begin that are made here for a target."""
    if len(name) > _LONGEST:
        name = f"{name[: _LONGEST - 9]}-{hashlib.sha256(os.fsencode(name)).hexdigest()[:8]}"
    return f".{name}"


def _old(target: Path) -> Path:
    return target.parent / f"{_stem(target.name)}{_OLD}"


def _parts(folder: Path) -> list[str]:
    with suppress(OSError):
        return [entry.name for entry in folder.iterdir() if entry.name.endswith(PART)]
    return []


# Folders of photos are written to thousands of times.
_parts_at_first = lru_cache(maxsize=4096)(_parts)


def _clear(folder: Path, name: str, parts: Iterable[str]) -> None:
    ours = rf"{re.escape(_stem(name))}(\.[a-z0-9_]{{8}})?{re.escape(PART)}"
    for path in (folder / part for part in parts if re.fullmatch(ours, part)):
        with suppress(OSError):
            handle = os.open(path, os.O_RDONLY | _NO_LINK)
            try:
                # Held until it is gone: who has just made it, and would lock it, then sees that.
                if _try_lock(handle):
                    _remove(path)
            finally:
                os.close(handle)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def _locked(make: Callable[[], tuple[int, str]]) -> tuple[int, Path]:
    """Make and lock a file or folder, again where another run was quick to clear it."""
    while True:
        handle, path = make()
        if _try_lock(handle) is not False and Path(path).exists():
            return handle, Path(path)
        os.close(handle)


def _lock_at(path: Path) -> int:
    """Make and lock a file of this name, and again where another run was quick to clear it."""
    for _ in range(_TRIES):
        handle = os.open(path, os.O_CREAT | os.O_RDWR | _NO_LINK, 0o600)
        locked = _try_lock(handle)
        with suppress(FileNotFoundError):
            if locked is None or (locked and os.path.samestat(os.fstat(handle), path.stat())):
                return handle
        os.close(handle)
        time.sleep(_PAUSE_S)  # who looks for what is abandoned holds it for a moment
    raise BlockingIOError(f"{path} is locked")


def _try_lock(handle: int) -> bool | None:
    """Lock an open file or folder unless another holds it; return None where nothing has locks."""
    if sys.platform == "win32":
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True


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
