"""Copies of what lies at URLs, in a cache folder: made when they are asked for.

A mirror is a folder ``<cache>/<key>/<name>``; its key is that of the URL and of the versions of
what was asked for, so that other content gets another mirror. Beside it ``origin.json`` says where
it is from, so that more of it can be fetched, file by file.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from uuid import uuid4

from airzoo_bench.core.errors import StorageError, UserError
from airzoo_bench.core.files import atomic_write, sha256_of
from airzoo_bench.storage.faults import DISK_FAULTS
from airzoo_bench.storage.remote import AT_ONCE, Entry, download, files, stat
from airzoo_bench.storage.urls import Url, safe_name, url_of

__all__ = [
    "CACHE_VARIABLE",
    "Mirror",
    "absent_is_absent",
    "cache_folder",
    "fetched",
    "folder_mirror",
    "in_urls",
    "mirror_of",
    "versions_of",
]

CACHE_VARIABLE = "AIRZOO_BENCH_CACHE"
"""The variable of the environment that names the folder of all mirrors."""
_ORIGIN = "origin.json"
_origins: dict[Path, Url] = {}


def cache_folder() -> Path:
    """Return the folder of all mirrors: AIRZOO_BENCH_CACHE, else one of the user's cache."""
    named = os.environ.get(CACHE_VARIABLE)
    if named:
        return Path(named).expanduser().absolute()
    from platformdirs import user_cache_path

    return user_cache_path("airzoo-bench") / "mirrors"


def versions_of(entries: Mapping[str, Entry]) -> str:
    """Return the versions of files; of what has none nobody knows whether it is still the same."""
    return repr([(name, entry.version or uuid4()) for name, entry in entries.items()])


@dataclass(frozen=True)
class Mirror:
    """The copy of a folder, or of some files of it.

    Attributes
    ----------
    url : Url
        The folder.
    tree : Path
        What was fetched of it.
    """

    url: Url
    tree: Path

    @classmethod
    def of(cls, url: Url, versions: str) -> Mirror:
        """Open a folder's mirror, and make it where there is none."""
        key = hashlib.sha256(f"{url.address}\n{versions}".encode()).hexdigest()[:24]
        home = cache_folder() / key
        tree = home / safe_name(url)
        with _disk_faults():
            if not (home / _ORIGIN).is_file():
                with atomic_write(home / _ORIGIN, "w") as stream:
                    json.dump({"url": url.address}, stream)
                (home / _ORIGIN).chmod(0o600)  # a signed URL is a secret
            tree.mkdir(exist_ok=True)
        with suppress(OSError):  # of a cache that others own
            (home / _ORIGIN).touch()  # says when the mirror was last used
        _origins[home] = url  # messages name it also when the mirror is gone
        return cls(url, tree)

    def fetch(self, name: str, entry: Entry | None = None, sha256: str | None = None) -> Path:
        """Return the path of a file, and fetch it where it is not there."""
        url, target = self.url.child(name), self.tree / name
        with _disk_faults():
            if not target.is_file():
                target.parent.mkdir(parents=True, exist_ok=True)
                download(url, entry or stat(url), target)
                _refuse_other(url, target, sha256)
        return target

    def fetch_all(
        self, entries: Mapping[str, Entry | None], sums: Mapping[str, str] | None = None
    ) -> None:
        """Fetch files, several at once; see `fetch`."""
        known = sums or {}
        for name in entries:
            self.url.child(name)  # before anything is fetched, none may lie elsewhere
        with ThreadPoolExecutor(AT_ONCE) as pool:
            waiting = [
                pool.submit(self.fetch, name, entry, known.get(name))
                for name, entry in entries.items()
            ]
            try:
                for one in waiting:
                    one.result()
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise


def folder_mirror(url: Url) -> Mirror:
    """Return the mirror of a folder with all files of it."""
    found = files(url)
    if not found:
        raise StorageError("no such file or folder, or an empty one", where=url)
    mirror = Mirror.of(url, versions_of(found))
    mirror.fetch_all(found)
    return mirror


def mirror_of(path: Path) -> tuple[Mirror, str] | None:
    """Return the mirror that a path lies in, and the name there; None of any other path."""
    try:
        key, name, *rest = path.absolute().relative_to(cache_folder()).parts
    except ValueError:
        return None
    home = cache_folder() / key
    if not (home / _ORIGIN).is_file():
        return None
    if home not in _origins:
        url = url_of(json.loads((home / _ORIGIN).read_text(encoding="utf-8"))["url"])
        assert url is not None, "written by Mirror.of"
        _origins[home] = url
    return Mirror(_origins[home], home / name), "/".join(rest)


def fetched(path: Path, *, anew: bool = False) -> Path:
    """Return a path, and fetch the file first if it belongs to a mirror and is not there yet."""
    found = None if path.exists() and not anew else mirror_of(path)
    if found is not None:
        path.unlink(missing_ok=True)
        with absent_is_absent():
            found[0].fetch(found[1])
    return path


@contextmanager
def absent_is_absent() -> Iterator[None]:
    """Go on where a storage does not have what was asked for."""
    try:
        yield
    except StorageError as error:
        if not error.what.startswith("no such"):
            raise


def in_urls(text: str) -> str:
    """Return a message in which paths of mirrors are called by their URLs."""
    for home, url in _origins.items():
        text = text.replace(str(home / safe_name(url)), str(url))
    return text


def _refuse_other(url: Url, target: Path, sha256: str | None) -> None:
    if sha256 is not None and sha256_of(target) != sha256:
        target.unlink()
        raise StorageError(
            "is not the file that benchmark.toml states",
            where=url,
            expected=f"SHA-256 {sha256[:12]}…",
            fix="upload the benchmark again, all of it",
        )


@contextmanager
def _disk_faults() -> Iterator[None]:
    """Turn what this machine's disk refuses into a message."""
    try:
        yield
    except OSError as error:
        full = error.errno in DISK_FAULTS[:2]
        raise UserError(
            "the disk is full" if full else f"cannot be written: {error.strerror or error}",
            where=cache_folder(),
            fix="make room, or remove mirrors in it that no run is using, "
            f"or set {CACHE_VARIABLE} to a folder on another disk",
        ) from error
