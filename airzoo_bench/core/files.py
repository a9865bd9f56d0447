"""Writing files whole or not at all, and naming content by its hash."""

from __future__ import annotations

import hashlib
import json
import os
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from stat import S_ISREG
from typing import IO, TYPE_CHECKING, Any

from airzoo_bench.core.errors import UserError
from airzoo_bench.core.places import (
    MARK,
    cannot_write,
    check_new_folder,
    check_output_file,
    check_output_folder,
    followed,
)
from airzoo_bench.core.temporaries import (
    clear_abandoned,
    exchange,
    exchange_entries,
    temporary_file,
    temporary_folder,
)
from airzoo_bench.core.trees import entries_below

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = [
    "LIMIT_BYTES",
    "atomic_entries",
    "atomic_folder",
    "atomic_write",
    "canonical_json",
    "check_output_file",
    "check_output_folder",
    "fingerprint",
    "first_bytes",
    "read_text",
    "sha256_of",
    "sha256_of_tree",
    "stamps",
    "write_npz",
]

LIMIT_BYTES = 16 << 20
"""The most that is read of a text that a person wrote, unless a caller wants less."""
_CHUNK_BYTES = 1 << 20
_NO_TIME = (1980, 1, 1, 0, 0, 0)


@contextmanager
def atomic_write(path: Path, mode: str = "wb") -> Iterator[IO[Any]]:
    """Open a file that appears under its name only when it has been written to the end."""
    check_output_file(path)
    target = followed(path)
    text: dict[str, Any] = {} if "b" in mode else {"encoding": "utf-8", "newline": ""}
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with temporary_file(target) as (handle, temporary):
            with os.fdopen(handle, mode, **text) as stream:
                yield stream
            _give_usual_permissions(temporary, 0o666)
            temporary.replace(target)
    except OSError as error:
        raise cannot_write(path, error) from error


@contextmanager
def atomic_folder(path: Path, *, replace: bool = False, mark: str = MARK) -> Iterator[Path]:
    """Fill a folder that appears under its name only when it is complete."""
    try:
        clear_abandoned(path)
        check_new_folder(path, replace=replace, mark=mark)
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary_folder(path.parent, path.name) as temporary:
            yield temporary
            _give_usual_permissions(temporary, 0o777)
            if path.exists():
                exchange(temporary, path)
            else:
                temporary.replace(path)
    except OSError as error:
        raise cannot_write(path, error) from error


@contextmanager
def atomic_entries(folder: Path, names: Sequence[str]) -> Iterator[Path]:
    """Fill a folder whose entries replace those of another that have these names, all or none."""
    try:
        clear_abandoned(folder)
        folder.mkdir(parents=True, exist_ok=True)
        whole = _is_ours_alone(folder, names)
        with temporary_folder(folder.parent if whole else folder, folder.name) as temporary:
            yield temporary
            if whole and _is_ours_alone(folder, names):
                temporary.chmod(folder.stat().st_mode)
                exchange(temporary, folder)
            else:
                exchange_entries(temporary, folder, names)
    except OSError as error:
        raise cannot_write(folder, error) from error


def _is_ours_alone(folder: Path, names: Sequence[str]) -> bool:
    stays = folder.is_symlink() or folder.is_mount() or folder.samefile(Path.cwd())
    writable = os.access(folder.parent, os.W_OK | os.X_OK)
    return writable and not stays and {entry.name for entry in folder.iterdir()} <= set(names)


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file's bytes, in hexadecimal, read in pieces."""
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while chunk := stream.read(_CHUNK_BYTES):
            digest.update(chunk)
    return digest.hexdigest()


def sha256_of_tree(path: Path) -> str:
    """Return the SHA-256 of a file, or of all files of a folder, through links, by their names."""
    if path.is_file():
        return sha256_of(path)
    files = sorted(p for p in entries_below(path) if p.is_file())
    return fingerprint([[p.relative_to(path).as_posix(), sha256_of(p)] for p in files])


def stamps(path: Path) -> dict[Path, tuple[int, int]]:
    """Return size and time of change, in ns, of a file or of all files of a folder."""
    found: dict[Path, tuple[int, int]] = {}
    for entry in entries_below(path) if path.is_dir() else (path,):
        with suppress(OSError, ValueError):  # it may go at any moment
            told = entry.stat()
            if S_ISREG(told.st_mode):
                found[entry] = told.st_size, told.st_mtime_ns
    return found


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
    import numpy as np

    method = zipfile.ZIP_DEFLATED if compress else zipfile.ZIP_STORED
    with zipfile.ZipFile(target, "w", method) as archive:
        for name, array in arrays.items():
            member = zipfile.ZipInfo(f"{name}.npy", _NO_TIME)
            member.compress_type = method
            with archive.open(member, "w", force_zip64=True) as stream:
                np.lib.format.write_array(stream, np.asanyarray(array), allow_pickle=False)


def first_bytes(path: Path, count: int) -> bytes:
    """Return the first bytes of a regular file; none of what is no such file or is not readable."""
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


def _umask() -> int:
    current = os.umask(0)
    os.umask(current)
    return current


def _give_usual_permissions(path: Path, usual: int) -> None:
    # What is temporary is private to its owner; a result is meant to be shared.
    path.chmod(usual & ~_umask())
