"""Files and folders that appear whole or not at all, checks of where to write, and hashes.

What is being written lies beside its target in a temporary folder, which the writing process locks;
the lock ends with the process, and the next writer of the target removes what a killed one left.
"""

from __future__ import annotations

import glob
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
from typing import IO, Any

from platformdirs import user_cache_path

from airzoo_bench.core.errors import UsageError, UserError, readable

if sys.platform != "win32":
    import fcntl

MARK = "benchmark.toml"  # every benchmark folder holds it
PART = ".airzoo-part"  # names of temporary folders end in it
DATA_VARIABLE = "AIRZOO_BENCH_DATA"  # names the folder of benchmarks
LIMIT_BYTES = 16 << 20  # of a text that a person wrote
_own: set[Path] = set()


@contextmanager
def atomic_write(path: Path, mode: str = "wb") -> Iterator[IO[Any]]:
    """Open a file that appears under its name only when it has been written to the end."""
    check_output_file(path)
    target = Path(os.path.realpath(path))
    text: dict[str, Any] = {} if "b" in mode else {"encoding": "utf-8", "newline": ""}
    with _temporary_beside(target) as temporary:
        with (temporary / "new").open(mode, **text) as stream:
            yield stream
        (temporary / "new").replace(target)


@contextmanager
def atomic_entries(folder: Path, names: Sequence[str]) -> Iterator[Path]:
    """Fill a folder and replace the entries of another with these names, all or none.

    The first name says that the others are complete: it is there only with all of its kind.
    """
    with _temporary_beside(folder / folder.name) as temporary:
        new, old = temporary / "new", temporary / "old"
        new.mkdir()
        old.mkdir()
        yield new
        there = [name for name in names if os.path.lexists(folder / name)]
        made = sorted(new.iterdir(), key=lambda entry: entry.name in names[:1])
        moves = [(folder / name, old / name) for name in there]
        moves += [(entry, folder / entry.name) for entry in made]
        try:
            for source, target in moves:
                source.replace(target)
        except BaseException:
            for source, target in reversed(moves):
                if os.path.lexists(target) and not os.path.lexists(source):
                    target.replace(source)
            raise


@contextmanager
def atomic_folder(path: Path, *, replace: bool = False, mark: str = MARK) -> Iterator[Path]:
    """Fill a folder that appears under its name only when it is complete."""
    check_new_folder(path, replace=replace, mark=mark)
    with atomic_entries(path.parent, [path.name]) as staged:
        (staged / path.name).mkdir()
        yield staged / path.name


@contextmanager
def _temporary_beside(target: Path) -> Iterator[Path]:
    """Make a temporary folder next to a target; say what the system refuses."""
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with temporary_folder(target.parent, target.name) as temporary:
            yield temporary
    except OSError as error:
        fix = "choose a folder you may write to, on a disk with room"
        what = f"cannot be written: {error.strerror or error}"
        raise UserError(what, where=target.parent, fix=fix) from error


@contextmanager
def temporary_folder(parent: Path, name: str) -> Iterator[Path]:
    """Make an empty folder in `parent` for this user alone, and remove it at the end.

    Those that killed processes left there under this name are removed first.
    """
    start = f".{Path(name).name[:50]}."  # systems allow names of 255 bytes
    for left in [*parent.glob(f"{glob.escape(start)}*{PART}")]:
        with suppress(OSError, UsageError), only_writer(left) as is_locked:
            if is_locked:
                shutil.rmtree(left, ignore_errors=True)
    path = Path(tempfile.mkdtemp(PART, start, parent))
    _own.add(path)
    try:
        with only_writer(path, wait=True):
            yield path
    finally:
        shutil.rmtree(path, ignore_errors=True)
        _own.discard(path)


def remove_own() -> None:
    """Remove what this process has made, when it must end without unwinding."""
    for path in [*_own]:
        shutil.rmtree(path, ignore_errors=True)


@contextmanager
def only_writer(folder: Path, *, wait: bool = False) -> Iterator[bool]:
    """Make and hold a folder; refuse it, or wait, where another process holds it.

    Yields whether it is locked, which some systems and disks cannot do.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lock = _lock(folder, wait=wait)
    try:
        yield lock is not None
    finally:
        if lock is not None:
            os.close(lock)


def _lock(folder: Path, *, wait: bool) -> int | None:
    """Lock a folder, which is made again where its last holder removed it meanwhile."""
    while sys.platform != "win32":
        folder.mkdir(exist_ok=True)
        lock = os.open(folder, os.O_RDONLY | os.O_NOFOLLOW | os.O_DIRECTORY)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
            if folder.exists() and os.path.samestat(os.fstat(lock), folder.stat()):
                return lock
        except OSError as error:
            os.close(lock)
            if isinstance(error, BlockingIOError):
                what, fix = "another process writes here", "wait until it has ended"
                raise UsageError(what, where=folder, fix=fix) from error
            return None
        os.close(lock)
    return None


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
        fix = f"set {DATA_VARIABLE} to a folder; what is read may be a URL, by --data"
        what = "a URL, and a folder of this machine is needed"
        raise UsageError(what, where=f"{DATA_VARIABLE}={place}", fix=fix)
    return place


def check_output_folder(folder: Path, names: Iterable[str]) -> None:
    """Refuse a folder for output that cannot take files of these names, before any is written."""
    place = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    is_url = re.match(r"[a-z][a-z0-9+.-]+:/", folder.as_posix(), re.IGNORECASE)
    if is_url or not (place.is_dir() and os.access(place, os.W_OK | os.X_OK)):
        what = "no folder of a disk that files may be written into"
        raise UsageError(what, where=folder if is_url else place, fix="name another one")
    for path in (folder / name for name in names):
        # Even root would not want to replace what is marked as read-only.
        if path.exists() and not (path.is_file() and path.stat().st_mode & 0o222):
            what = "a folder, a device or read-only, and so is not replaced"
            raise UsageError(what, where=path, fix="name another place")


def check_output_file(path: Path) -> None:
    """Refuse a file that cannot be written, before the work that it is to hold."""
    check_output_folder(path.parent, [path.name])


def check_new_folder(path: Path, *, replace: bool, mark: str = MARK) -> None:
    """Refuse a folder that cannot be made, or must not be replaced."""
    check_output_folder(path.parent, ())
    if path.exists() and not replace:
        fix = "name another, or add --force"
        raise UsageError("the folder exists already", where=path, fix=fix)
    if path.exists() and not (path / mark).is_file() and (path.is_file() or any(path.iterdir())):
        fix = f"name another folder: only one with {mark} is replaced"
        raise UsageError("holds other files, and so is not replaced", where=path, fix=fix)


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file's bytes, in hexadecimal, read in pieces."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def sha256_of_tree(path: Path) -> str:
    """Return the SHA-256 of a file, or of all files of a folder, through links, by their names."""
    if path.is_file():
        return sha256_of(path)
    homes = os.walk(path, followlinks=True)
    paths = sorted(Path(home) / name for home, _, names in homes for name in names)
    files = [one for one in paths if one.is_file()]
    return fingerprint([[one.relative_to(path).as_posix(), sha256_of(one)] for one in files])


def canonical_json(value: object) -> str:
    """Serialise to the one JSON text that equal values share: sorted keys, no blanks."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def fingerprint(value: object) -> str:
    """Return the SHA-256 of a value's canonical JSON, in hexadecimal."""
    return hashlib.sha256(canonical_json(value).encode()).hexdigest()


def write_npz(
    target: Path | IO[bytes], arrays: Mapping[str, Any], *, compress: bool = False
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
    faults = OSError, RuntimeError, ValueError, zipfile.BadZipFile
    with suppress(*faults), zipfile.ZipFile(path) as archive:
        return frozenset(name.removesuffix(".npy") for name in archive.namelist())
    return frozenset()


def first_bytes(path: Path, count: int) -> bytes:
    """Return the first bytes of a regular file, or none where it cannot be read."""
    if path.is_file():  # opening a pipe would wait
        with suppress(OSError), path.open("rb") as stream:
            return stream.read(count)
    return b""


def read_text(path: Path, kind: type[UserError], what: str, limit_bytes: int = LIMIT_BYTES) -> str:
    """Read a small UTF-8 text that a person wrote."""
    if not path.is_file():
        raise kind(f"a folder, not a {what}" if path.is_dir() else f"no such {what}", where=path)
    if path.stat().st_size > limit_bytes:
        raise kind(f"too large for a {what}", where=path, expected=f"at most {limit_bytes:,} bytes")
    with readable(path, f"not a {what} in UTF-8", kind=kind):
        return path.read_text(encoding="utf-8")
