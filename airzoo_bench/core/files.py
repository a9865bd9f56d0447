"""Files and folders that appear whole or not at all, checks of where to write, and hashes.

What is being written lies beside its target in a temporary folder, which the writing process locks;
the lock ends with the process, and the next writer of the target removes what a killed one left.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import sys
import tempfile
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from platformdirs import user_cache_path

from airzoo_bench.core.errors import UsageError, UserError

if TYPE_CHECKING:
    from numpy.typing import NDArray
if sys.platform != "win32":
    import fcntl

MARK = "benchmark.toml"
"""Every benchmark folder holds it."""
PART = ".airzoo-part"
"""Names of temporary folders end in it."""
DATA_VARIABLE = "AIRZOO_BENCH_DATA"
"""The variable of the environment that names the folder of benchmarks."""
LIMIT_BYTES = 16 << 20
"""The most that is read of a text that a person wrote, unless a caller wants less."""

_LONGEST = 50  # letters of a target in another name: systems allow 255 bytes
_own: set[Path] = set()


@contextmanager
def atomic_write(path: Path, mode: str = "wb") -> Iterator[IO[Any]]:
    """Open a file that appears under its name only when it has been written to the end."""
    check_output_file(path)
    target = Path(os.path.realpath(path))
    text: dict[str, Any] = {} if "b" in mode else {"encoding": "utf-8", "newline": ""}
    with _writing(path):
        target.parent.mkdir(parents=True, exist_ok=True)
        with temporary_folder(target.parent, target.name) as temporary:
            with (temporary / "new").open(mode, **text) as stream:
                yield stream
            (temporary / "new").replace(target)


@contextmanager
def atomic_folder(path: Path, *, replace: bool = False, mark: str = MARK) -> Iterator[Path]:
    """Fill a folder that appears under its name only when it is complete."""
    with _writing(path):
        check_new_folder(path, replace=replace, mark=mark)
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary_folder(path.parent, path.name) as temporary:
            (temporary / "new").mkdir()
            yield temporary / "new"
            old = [(path, temporary / "old")] if path.exists() else []
            _move_all([*old, (temporary / "new", path)])


@contextmanager
def atomic_entries(folder: Path, names: Sequence[str]) -> Iterator[Path]:
    """Fill a folder and replace the entries of another with these names, all or none.

    The first name says that the others are complete: it is there only with all of its kind.
    """
    with _writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with temporary_folder(folder, folder.name) as temporary:
            new, old = temporary / "new", temporary / "old"
            new.mkdir()
            old.mkdir()
            yield new
            there = [name for name in names if os.path.lexists(folder / name)]
            made = sorted(new.iterdir(), key=lambda entry: entry.name in names[:1])
            moves = [(folder / name, old / name) for name in there]
            _move_all([*moves, *((entry, folder / entry.name) for entry in made)])


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise cannot_write(path, error) from error


def _move_all(moves: Sequence[tuple[Path, Path]]) -> None:
    """Rename files and folders one after the other, and all back where one fails."""
    try:
        for source, target in moves:
            source.replace(target)
    except BaseException:
        for source, target in reversed(moves):
            if os.path.lexists(target) and not os.path.lexists(source):
                target.replace(source)
        raise


@contextmanager
def temporary_folder(parent: Path, name: str) -> Iterator[Path]:
    """Make an empty folder in `parent` for this user alone, and remove it at the end."""
    clear_abandoned(parent / name)
    path, lock = _new_folder(parent, _hidden_start(name))
    _own.add(path)
    try:
        yield path
    finally:
        shutil.rmtree(path, ignore_errors=True)
        _own.discard(path)
        _unlock(lock)


def _new_folder(parent: Path, start: str) -> tuple[Path, int | None]:
    while True:
        path = Path(tempfile.mkdtemp(PART, start, parent))
        with suppress(FileNotFoundError):  # before its lock, another writer may have removed it
            lock = _lock(path, wait=True)
            if path.exists():
                return path, lock
            _unlock(lock)


def _hidden_start(name: str) -> str:
    return f".{Path(name).name[:_LONGEST]}."


def clear_abandoned(target: Path) -> None:
    """Remove the temporary folders of killed writers of a target."""
    start = _hidden_start(target.name)
    with suppress(OSError):  # of which another writer removes some
        for path in [one for one in target.parent.iterdir() if one.name.startswith(start)]:
            with suppress(OSError):
                lock = _lock(path) if path.name.endswith(PART) else None
                if lock is not None:
                    shutil.rmtree(path, ignore_errors=True)
                    _unlock(lock)


def remove_own() -> None:
    """Remove what this process has made, when it must end without unwinding."""
    for path in list(_own):
        shutil.rmtree(path, ignore_errors=True)


@contextmanager
def only_writer(folder: Path, *, wait: bool = False) -> Iterator[None]:
    """Make and hold a folder; refuse it, or wait, where another process holds it."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        lock = _lock(folder, wait=wait)
    except BlockingIOError as error:
        fix = "wait until it has ended"
        raise UsageError("another process writes here", where=folder, fix=fix) from error
    try:
        yield
    finally:
        _unlock(lock)


def _lock(folder: Path, *, wait: bool = False) -> int | None:
    """Open and lock a folder; return None on systems and disks without locks."""
    if sys.platform == "win32":
        return None
    handle = os.open(folder, os.O_RDONLY | os.O_NOFOLLOW | os.O_DIRECTORY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError as error:
        os.close(handle)
        if isinstance(error, BlockingIOError):
            raise
        return None
    return handle


def _unlock(lock: int | None) -> None:
    if lock is not None:
        os.close(lock)


def data_location() -> str | Path:
    """Return where benchmark folders lie: AIRZOO_BENCH_DATA, path or URL, else a cache folder."""
    named = os.environ.get(DATA_VARIABLE)
    if named:
        return named if "://" in named else Path(named).expanduser()
    return user_cache_path("airzoo-bench") / "data"


def data_root() -> Path:
    """Return the folder of this machine in which benchmark folders lie and are made."""
    place = data_location()
    if isinstance(place, str):
        raise UsageError(
            "a URL, and a folder of this machine is needed",
            where=f"{DATA_VARIABLE}={place}",
            fix=f"set {DATA_VARIABLE} to a folder; what is read may be a URL, by --data",
        )
    return place


def check_output_folder(folder: Path, names: Iterable[str]) -> None:
    """Refuse a folder for output that cannot take files of these names, before any is written."""
    if re.match(r"[a-z][a-z0-9+.-]+:/", folder.as_posix(), re.IGNORECASE):
        fix = "name a path, and upload it afterwards with your storage's own tools"
        raise UsageError("looks like a URL, and this is written to a disk", where=folder, fix=fix)
    place = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not place.is_dir():
        raise UsageError("a file, not a folder", where=place, fix="name a folder")
    if not os.access(place, os.W_OK | os.X_OK):
        fix = "name another one"
        raise UsageError("nothing may be written into this folder", where=place, fix=fix)
    for path in (folder / name for name in names):
        # Even root would not want to replace what is marked as read-only.
        if path.exists() and not (path.is_file() and path.stat().st_mode & 0o222):
            what = "a folder, a device or read-only, and so is not replaced"
            raise UsageError(what, where=path, fix="name another place")


def check_output_file(path: Path) -> None:
    """Refuse a file that cannot be written, before the work that it is to hold."""
    with _writing(path):
        check_output_folder(path.parent, [path.name])


def check_new_folder(path: Path, *, replace: bool, mark: str = MARK) -> None:
    """Refuse a folder that cannot be made, or must not be replaced."""
    if not path.exists():
        check_output_folder(path.parent, ())
    elif not replace:
        fix = "name another, or add --force"
        raise UsageError("the folder exists already", where=path, fix=fix)
    elif not path.is_dir() or (any(path.iterdir()) and not (path / mark).is_file()):
        fix = f"name another folder: only one with {mark} is replaced"
        raise UsageError("holds other files, and so is not replaced", where=path, fix=fix)


def cannot_write(path: Path, error: OSError) -> UserError:
    """Make the error of a file or folder that the system refuses to write."""
    return UserError(
        f"cannot be written: {error.strerror or error}",
        where=path,
        fix="choose a folder you may write to, on a disk with room",
    )


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file's bytes, in hexadecimal, read in pieces."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def sha256_of_tree(path: Path) -> str:
    """Return the SHA-256 of a file, or of all files of a folder, through links, by their names."""
    if path.is_file():
        return sha256_of(path)
    homes = os.walk(path, followlinks=True)
    files = sorted(Path(home) / name for home, _, names in homes for name in names)
    return fingerprint(
        [[one.relative_to(path).as_posix(), sha256_of(one)] for one in files if one.is_file()]
    )


def canonical_json(value: object) -> str:
    """Serialise to the one JSON text that equal values share: sorted keys, no blanks."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def fingerprint(value: object) -> str:
    """Return the SHA-256 of a value's canonical JSON, in hexadecimal."""
    return hashlib.sha256(canonical_json(value).encode()).hexdigest()


def write_npz(
    target: Path | IO[bytes], arrays: Mapping[str, NDArray[Any]], *, compress: bool = False
) -> None:
    """Write arrays as ``.npz`` that is the same to the last byte for the same arrays."""
    import numpy as np  # the help of commands does without

    method = zipfile.ZIP_DEFLATED if compress else zipfile.ZIP_STORED
    with zipfile.ZipFile(target, "w", method) as archive:
        for name, array in arrays.items():
            member = zipfile.ZipInfo(f"{name}.npy")  # of 1980
            member.compress_type = method
            with archive.open(member, "w", force_zip64=True) as stream:
                np.lib.format.write_array(stream, np.asanyarray(array), allow_pickle=False)


def npz_fields(path: Path) -> frozenset[str]:
    """Return the names of the arrays in an npz; none where it is no such file."""
    if path.suffix.lower() != ".npz" or not path.is_file():
        return frozenset()
    try:
        with zipfile.ZipFile(path) as archive:
            return frozenset(name.removesuffix(".npy") for name in archive.namelist())
    except (OSError, RuntimeError, ValueError, zipfile.BadZipFile):
        return frozenset()


def first_bytes(path: Path, count: int) -> bytes:
    """Return the first bytes of a regular file, or none where it cannot be read."""
    with suppress(OSError):
        if path.is_file():  # opening a pipe would wait
            with path.open("rb") as stream:
                return stream.read(count)
    return b""


def read_text(path: Path, kind: type[UserError], what: str, limit_bytes: int = LIMIT_BYTES) -> str:
    """Read a small UTF-8 text that a person wrote."""
    if not path.is_file():
        raise kind(f"a folder, not a {what}" if path.is_dir() else f"no such {what}", where=path)
    if path.stat().st_size > limit_bytes:
        raise kind(f"too large for a {what}", where=path, expected=f"at most {limit_bytes:,} bytes")
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        expected = f"a {what} in UTF-8"
        raise kind(f"not text in line {line}", where=path, expected=expected) from error
