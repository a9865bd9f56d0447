"""The cache folder, and how a file comes into it: whole, of one version, by one writer."""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from airzoo_bench.core.errors import StorageError, UserError
from airzoo_bench.core.files import sha256_of
from airzoo_bench.core.temporaries import only_writer
from airzoo_bench.storage.faults import ChangedError, changed, settled
from airzoo_bench.storage.remote import Entry, fetch_onto, stat
from airzoo_bench.storage.urls import Url

__all__ = ["CACHE_VARIABLE", "cache_faults", "cache_folder", "fetch_file", "held"]

CACHE_VARIABLE = "AIRZOO_BENCH_CACHE"
"""The variable of the environment that names the folder of all mirrors."""
_PAUSE_S = 0.1


def cache_folder() -> Path:
    """Return the folder of all mirrors: AIRZOO_BENCH_CACHE, else one of the user's cache."""
    named = os.environ.get(CACHE_VARIABLE)
    if named:
        return Path(named).expanduser().absolute()
    from platformdirs import user_cache_path

    return user_cache_path("airzoo-bench") / "mirrors"


def fetch_file(url: Url, target: Path, entry: Entry | None, sha256: str | None) -> None:
    """Fetch a file whose name appears when all of it is there, and of the version of `entry`."""
    if entry is None:
        settled(lambda: fetch_file(url, target, stat(url), sha256))
        return
    digest = hashlib.sha256(entry.version.encode()).hexdigest()[:12]
    part = target.with_name(f".{target.name[:40]}.{digest}.partial")
    if not entry.version:
        part.unlink(missing_ok=True)
    _check_room(target.parent, entry, part)
    try:
        fetch_onto(url, entry, part)
        if stat(url).version != entry.version or entry.size not in (None, part.stat().st_size):
            raise changed(url)
    except ChangedError:
        part.unlink(missing_ok=True)
        raise
    _refuse_other(url, part, sha256)
    part.replace(target)


def _refuse_other(url: Url, part: Path, sha256: str | None) -> None:
    if sha256 is not None and sha256_of(part) != sha256:
        part.unlink()
        raise StorageError(
            "is not the file that benchmark.toml states",
            where=url,
            expected=f"SHA-256 {sha256[:12]}…",
            fix="upload the benchmark again, all of it",
        )


def _check_room(folder: Path, entry: Entry, part: Path) -> None:
    begun = part.stat().st_size if part.exists() else 0
    if entry.size is not None and entry.size - begun > shutil.disk_usage(folder).free:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@contextmanager
def cache_faults() -> Iterator[None]:
    """Turn what this machine's disk refuses into a message."""
    try:
        yield
    except OSError as error:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        raise UserError(
            "the disk is full" if full else f"cannot be written: {error.strerror or error}",
            where=cache_folder(),
            fix="make room, or remove mirrors in it that no run is using, "
            f"or set {CACHE_VARIABLE} to a folder on another disk",
        ) from error


@contextmanager
def held(target: Path) -> Iterator[bool]:
    """Wait until nobody else fetches a file; yields whether it is there by then."""
    while True:
        try:
            with only_writer(target):
                yield target.is_file()
            return
        except BlockingIOError:
            time.sleep(_PAUSE_S)
