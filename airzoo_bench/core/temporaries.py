"""Temporary files and folders next to their final place, cleared by the next run if this one dies.

Each is locked by the process that fills it. A lock ends with its process, however that ends, so
what nobody holds any more is abandoned. On disks and systems without locks nothing is cleared.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path

__all__ = [
    "PART",
    "clear_abandoned",
    "only_writer",
    "remove_own",
    "set_aside",
    "temporary_file",
    "temporary_folder",
]

PART = ".airzoo-part"
"""How names of temporary files and folders end."""
_ASIDE = ".airzoo-aside"
_TAKEN = ".airzoo-names"
# Of a name, in that of the file or folder next to it: systems allow 255 bytes, with what is added.
_KEPT_LETTERS = 40
_TRIES, _PAUSE_S = 5, 0.02

_own: set[Path] = set()


@contextmanager
def temporary_file(target: Path) -> Iterator[tuple[int, Path]]:
    """Make an empty file next to `target`; it is removed at the end if it is still there.

    Yields
    ------
    handle : int
        Open for reading and writing; to be closed by the caller.
    path : Path
    """
    _clear_once(target.parent)
    # A copy of the handle keeps the lock, and outlives the caller's.
    handle, path = _locked(lambda: tempfile.mkstemp(PART, _prefix(target), target.parent))
    lock = os.dup(handle)
    _own.add(path)
    try:
        yield handle, path
    finally:
        path.unlink(missing_ok=True)
        _own.discard(path)
        os.close(lock)


@contextmanager
def temporary_folder(parent: Path, name: str) -> Iterator[Path]:
    """Make an empty folder in `parent`; whatever stands there is removed at the end.

    Parameters
    ----------
    parent : Path
    name : str
        Of what it shall become, for a person who finds it.
    """
    clear_abandoned(parent)
    with _locked_folder(parent, _prefix(Path(name)), PART) as path:
        _own.add(path)
        try:
            yield path
        finally:
            _own.discard(path)


@contextmanager
def only_writer(target: Path) -> Iterator[None]:
    """Hold a file or folder that is to be written, so that nobody else begins to.

    On disks and systems without locks nobody is kept from it.

    Raises
    ------
    BlockingIOError
        Another holds it, in this process or in another.
    """
    target = Path(os.path.realpath(target))
    clear_abandoned(target.parent)
    digest = hashlib.sha256(target.name.encode()).hexdigest()[:8]  # long names are cut
    path = target.parent / f"{_prefix(target)}{digest}{PART}"
    lock = _lock_at(path)
    _own.add(path)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
        _own.discard(path)
        os.close(lock)


@contextmanager
def set_aside(folder: Path, names: Collection[str]) -> Iterator[None]:
    """Take entries of a folder away while others take their names.

    Only when the block has ended are the old ones given up. Where it fails they are put back, and
    what took their names is removed; where the process dies, `clear_abandoned` does that.

    Parameters
    ----------
    folder : Path
    names : collection of str
        Those that are there are taken away; the block may make any of them.
    """
    with _locked_folder(folder, ".", _ASIDE) as aside:
        try:
            for name in names:
                if (folder / name).exists():
                    (folder / name).replace(aside / name)
            _write_whole(aside / _TAKEN, "".join(f"{name}\n" for name in names))
            yield
            # From here on it is rubbish, which nobody puts back.
            done = aside.replace(aside.with_suffix(PART))
        except BaseException:
            _put_back(aside)
            raise
        _remove(done)


def clear_abandoned(folder: Path) -> None:
    """Remove temporary files and folders whose process is gone, and put back what it had set aside.

    Parameters
    ----------
    folder : Path
        Where to look; nothing below it is touched.
    """
    with suppress(OSError):
        for entry in list(os.scandir(folder)):
            if not entry.name.endswith((PART, _ASIDE)):
                continue
            path = Path(entry.path)
            # Held until it is gone: who has just made it, and waits for the lock, then sees that.
            with _held_if_abandoned(path) as held:
                if held and entry.name.endswith(PART):
                    _remove(path)
                elif held:
                    _put_back(path)


def remove_own() -> None:
    """Remove what this process has made, when it must end without unwinding."""
    for path in list(_own):
        _remove(path)


@lru_cache(maxsize=4096)
def _clear_once(folder: Path) -> None:
    # Folders of photos are written to thousands of times.
    clear_abandoned(folder)


@contextmanager
def _locked_folder(parent: Path, prefix: str, suffix: str) -> Iterator[Path]:
    def made() -> tuple[int, str]:
        folder = tempfile.mkdtemp(suffix, prefix, parent)
        return os.open(folder, os.O_RDONLY), folder

    lock, path = _locked(made)
    try:
        yield path
    finally:
        shutil.rmtree(path, ignore_errors=True)
        os.close(lock)


def _prefix(path: Path) -> str:
    return f".{path.name[:_KEPT_LETTERS]}."


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def _write_whole(path: Path, text: str) -> None:
    """Write a file that is not there, or is there to its last byte, also after a power cut."""
    part = path.with_suffix(PART)
    with part.open("w", encoding="utf-8") as stream:
        stream.write(text)
        stream.flush()
        os.fsync(stream.fileno())
    part.replace(path)


def _put_back(aside: Path) -> None:
    marker = aside / _TAKEN
    if marker.is_file():  # all old entries were taken away: what has these names now is new
        taken = set(marker.read_text(encoding="utf-8").split("\n"))
        for entry in list(os.scandir(aside.parent)):  # never the folder itself, nor one above it
            if entry.name in taken:
                _remove(Path(entry.path))
        marker.unlink()
    marker.with_suffix(PART).unlink(missing_ok=True)
    for kept in list(aside.iterdir()):
        kept.replace(aside.parent / kept.name)
    aside.rmdir()


if sys.platform == "win32":

    def _locked(make: Callable[[], tuple[int, str]]) -> tuple[int, Path]:
        handle, path = make()
        return handle, Path(path)

    def _lock_at(path: Path) -> int:
        return os.open(path, os.O_CREAT | os.O_RDWR)

    @contextmanager
    def _held_if_abandoned(path: Path) -> Iterator[bool]:
        del path
        yield False

else:
    import fcntl

    def _locked(make: Callable[[], tuple[int, str]]) -> tuple[int, Path]:
        """Make and lock a file or folder, again where another run was quick to clear it."""
        while True:
            handle, path = make()
            with suppress(OSError):
                fcntl.flock(handle, fcntl.LOCK_EX)
            if Path(path).exists():
                return handle, Path(path)
            os.close(handle)

    def _lock_at(path: Path) -> int:
        """Make and lock a file of this name, and again where another run was quick to clear it."""
        for _ in range(_TRIES):
            handle = os.open(path, os.O_CREAT | os.O_RDWR | os.O_NOFOLLOW, 0o600)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                os.close(handle)
                time.sleep(_PAUSE_S)  # who looks for what is abandoned holds it for a moment
                continue
            except OSError:  # a disk without locks
                return handle
            with suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(handle), path.stat()):
                    return handle
            os.close(handle)
        raise BlockingIOError(f"{path} is locked")

    @contextmanager
    def _held_if_abandoned(path: Path) -> Iterator[bool]:
        """Lock what no process holds; whether there was such a thing."""
        try:
            handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
        except OSError:
            yield False
            return
        try:
            yield _is_free(handle)
        finally:
            os.close(handle)

    def _is_free(handle: int) -> bool:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return False
        return True
