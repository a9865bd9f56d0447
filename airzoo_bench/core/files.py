"""Files and folders that appear whole or not at all, checks of where to write, and hashes.

What is being written lies beside its target under a temporary name, locked by the process that
fills it; a lock ends with its process. The next writer of a target takes over what a killed one
left. On disks without locks nothing is taken over.
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
from contextlib import ExitStack, contextmanager, suppress
from operator import methodcaller
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
"""Names of temporary files and folders end in it."""
DATA_VARIABLE = "AIRZOO_BENCH_DATA"
"""The variable of the environment that names the folder of benchmarks."""
LIMIT_BYTES = 16 << 20
"""The most that is read of a text that a person wrote, unless a caller wants less."""

_OLD, _LOCK = ".airzoo-old", ".lock"
_LONGEST = 50  # letters of a target in another name: systems allow 255 bytes
_NO_LINK = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
_NO_TIME = (1980, 1, 1, 0, 0, 0)

_own: set[Path] = set()


@contextmanager
def atomic_write(path: Path, mode: str = "wb") -> Iterator[IO[Any]]:
    """Open a file that appears under its name only when it has been written to the end."""
    check_output_file(path)
    target = Path(os.path.realpath(path))
    text: dict[str, Any] = {} if "b" in mode else {"encoding": "utf-8", "newline": ""}
    with _writing(path):
        target.parent.mkdir(parents=True, exist_ok=True)
        with temporary_file(target) as (handle, temporary):
            with os.fdopen(handle, mode, **text) as stream:
                yield stream
            _give_usual_permissions(temporary, 0o666)
            temporary.replace(target)


@contextmanager
def atomic_folder(path: Path, *, replace: bool = False, mark: str = MARK) -> Iterator[Path]:
    """Fill a folder that appears under its name only when it is complete."""
    with _writing(path):
        clear_abandoned(path)
        check_new_folder(path, replace=replace, mark=mark)
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary_folder(path.parent, path.name) as temporary:
            yield temporary
            _give_usual_permissions(temporary, 0o777)
            old = _hidden(path, _OLD)
            # A writer that is killed in between leaves the old one aside.
            _move_all([(path, old)] * path.exists() + [(temporary, path)])
            _remove(old)


@contextmanager
def atomic_entries(folder: Path, names: Sequence[str]) -> Iterator[Path]:
    """Fill a folder and replace the entries of another with these names, all or none.

    The first name says that the others are complete: it is there only with all of its kind.
    """
    with _writing(folder):
        clear_abandoned(folder)
        folder.mkdir(parents=True, exist_ok=True)
        with temporary_folder(folder, folder.name) as temporary:
            yield temporary
            aside = folder / _hidden(folder, _OLD).name
            _remove(aside)
            aside.mkdir()
            there = [name for name in names if os.path.lexists(folder / name)]
            moves = [(folder / name, aside / name) for name in there]
            entries = sorted(temporary.iterdir(), key=lambda entry: entry.name in names[:1])
            try:
                _move_all([*moves, *((entry, folder / entry.name) for entry in entries)])
            except BaseException:
                aside.rmdir()  # which is empty, as all is back
                raise
            _remove(aside)


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
def temporary_file(target: Path) -> Iterator[tuple[int, Path]]:
    """Make an empty file next to `target`; it is removed at the end if it is still there."""
    path = _hidden(target, PART)
    handle = _take_over(path, os.O_CREAT | os.O_RDWR)
    if handle is None:  # another process writes the same file
        handle, name = tempfile.mkstemp(PART, _hidden(target, ".").name, target.parent)
        path = Path(name)
    os.ftruncate(handle, 0)
    with _removed_at_the_end(path, os.dup(handle)):  # the copy outlives the caller's handle
        yield handle, path


@contextmanager
def temporary_folder(parent: Path, name: str) -> Iterator[Path]:
    """Make an empty folder in `parent` for this user alone, and remove it at the end."""
    path = _hidden(parent / Path(name).name, PART)
    with suppress(OSError):
        path.mkdir(0o700)
    lock = _take_over(path, os.O_RDONLY)
    if lock is None:
        path = Path(tempfile.mkdtemp(PART, _hidden(parent / Path(name).name, ".").name, parent))
        lock = os.open(path, os.O_RDONLY)
    path.chmod(0o700)
    for entry in path.iterdir():
        _remove(entry)
    with _removed_at_the_end(path, lock):
        yield path


@contextmanager
def only_writer(target: Path) -> Iterator[None]:
    """Hold a file or folder that is to be written; raise BlockingIOError where another does."""
    path = _hidden(Path(os.path.realpath(target)), _LOCK + PART)
    lock = os.open(path, os.O_CREAT | os.O_RDWR | _NO_LINK, 0o600)
    if _try_lock(lock) is False or not _is_at(lock, path):
        os.close(lock)
        raise BlockingIOError(f"{path} is locked")
    with _removed_at_the_end(path, lock):
        yield


@contextmanager
def only_run(folder: Path, what: str, where: object, otherwise: str) -> Iterator[None]:
    """Keep other runs from a folder while the block lasts."""
    made = [one for one in (folder.parent, *folder.parent.parents) if not one.exists()]
    with _writing(folder):
        folder.parent.mkdir(parents=True, exist_ok=True)
    try:
        with ExitStack() as stack:
            try:
                stack.enter_context(only_writer(folder))
            except BlockingIOError as error:
                fix = f"wait until it has ended, or {otherwise}"
                raise UsageError(what, where=where, fix=fix) from error
            except OSError:  # a folder in which no lock can be made
                pass
            yield
    finally:
        for one in made:
            with suppress(OSError):  # where something was made, it stays
                one.rmdir()


def clear_abandoned(target: Path) -> None:
    """Remove what killed writers of a target left beside it, or put their old folder back."""
    part, old = _hidden(target, PART), _hidden(target, _OLD)
    with suppress(OSError):
        handle = os.open(part, os.O_RDONLY | _NO_LINK)
        try:
            if _try_lock(handle):
                _remove(part)
        finally:
            os.close(handle)
    if target.exists():
        _remove(old)
    elif old.is_dir() and not old.is_symlink():
        old.replace(target)


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


def _hidden(target: Path, ending: str) -> Path:
    """Return the name beside a target that its writers use for a purpose."""
    return target.parent / f".{target.name[:_LONGEST]}{ending}"


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def _take_over(path: Path, flags: int) -> int | None:
    """Open and lock a file or folder of this user; None where another holds or made it."""
    try:
        handle = os.open(path, flags | _NO_LINK, 0o600)
    except OSError:  # of another user, or a link
        return None
    locked = _try_lock(handle)
    if locked and _is_at(handle, path) and os.fstat(handle).st_uid == os.getuid():
        return handle
    os.close(handle)
    if locked is None:
        _remove(path)
    return None


def _is_at(handle: int, path: Path) -> bool:
    """Tell whether an open file is still the one at a path: its last holder may have removed it."""
    with suppress(FileNotFoundError):
        return os.path.samestat(os.fstat(handle), path.lstat())
    return False


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


def _give_usual_permissions(path: Path, usual: int) -> None:
    # What is temporary is private to its owner; a result is meant to be shared.
    current = os.umask(0)
    os.umask(current)
    path.chmod(usual & ~current)


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
    if re.fullmatch(r"[a-z][a-z0-9+.-]+:", folder.parts[0] if folder.parts else "", re.IGNORECASE):
        raise UsageError(
            "looks like a URL, and this is written to a disk",
            where=folder,
            expected="a path",
            fix="upload it afterwards, with your storage's own tools",
        )
    place = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not place.is_dir():
        raise UsageError("a file, not a folder", where=place, fix="name a folder")
    if not os.access(place, os.W_OK | os.X_OK):
        fix = "name another one"
        raise UsageError("nothing may be written into this folder", where=place, fix=fix)
    for path in (folder / name for name in names):
        if path.exists() and not path.is_file():
            kind = "a folder" if path.is_dir() else "a pipe or a device"
            raise UsageError(f"{kind}, not a file", where=path, fix="name another place")
        # Even root would not want to replace what is marked as read-only.
        if path.exists() and not path.stat().st_mode & 0o222:
            fix = "name another place"
            raise UsageError("a read-only file, which is not replaced", where=path, fix=fix)


def check_output_file(path: Path) -> None:
    """Refuse a file that cannot be written, before the work that it is to hold."""
    with _writing(path):
        check_output_folder(path.parent, [path.name])


def check_new_folder(path: Path, *, replace: bool, mark: str = MARK) -> None:
    """Refuse a folder that cannot be made, or must not be replaced."""
    if not path.exists():
        check_output_folder(path.parent, ())
        return
    if not replace:
        fix = "name another, or add --force"
        raise UsageError("the folder exists already", where=path, fix=fix)
    if not path.is_dir() or (any(path.iterdir()) and not (path / mark).is_file()):
        kind = "a benchmark folder" if mark == MARK else "such a folder"
        raise UsageError(
            f"is not {kind}, and so is not replaced",
            where=path,
            expected=f"a folder with {mark}, or none",
            fix="name another folder",
        )


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
    files, seen = [], set[str]()
    for home, folders, names in os.walk(path, followlinks=True):
        real = os.path.realpath(home)
        if real in seen:  # links may lead round
            folders.clear()
            continue
        seen.add(real)
        folders.sort()
        files += [one for one in (Path(home) / name for name in names) if one.is_file()]
    return fingerprint(
        [[one.relative_to(path).as_posix(), sha256_of(one)] for one in sorted(files)]
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
            member = zipfile.ZipInfo(f"{name}.npy", _NO_TIME)
            member.compress_type = method
            with archive.open(member, "w", force_zip64=True) as stream:
                np.lib.format.write_array(stream, np.asanyarray(array), allow_pickle=False)


def first_bytes(path: Path, count: int) -> bytes:
    """Return the first bytes of a regular file, or none where it cannot be read."""
    try:
        if not path.is_file():  # opening a pipe would wait
            return b""
        with path.open("rb") as stream:
            return stream.read(count)
    except OSError:
        return b""


def read_text(path: Path, kind: type[UserError], what: str, limit_bytes: int = LIMIT_BYTES) -> str:
    """Read a small UTF-8 text that a person wrote."""
    if path.is_dir():
        raise kind(f"a folder, not a {what}", where=path)
    if not path.is_file():
        raise kind(f"no such {what}", where=path)
    if path.stat().st_size > limit_bytes:
        raise kind(f"too large for a {what}", where=path, expected=f"at most {limit_bytes:,} bytes")
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise kind(
            f"not text: byte {error.start} is not UTF-8, in line {line}",
            where=path,
            expected=f"a {what} in UTF-8",
        ) from error


def npz_fields(path: Path) -> frozenset[str]:
    """Return the names of the arrays in an npz; none where it is no such file."""
    if path.suffix.lower() != ".npz" or not path.is_file():
        return frozenset()
    try:
        with zipfile.ZipFile(path) as archive:
            return frozenset(map(methodcaller("removesuffix", ".npy"), archive.namelist()))
    except (OSError, RuntimeError, ValueError, zipfile.BadZipFile):
        return frozenset()
