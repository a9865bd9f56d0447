"""Copies of what lies at URLs, in a cache folder: made when they are asked for, and never in part.

A mirror is a folder ``<cache>/<key>/<name>``; its key is that of the URL and of the versions of
what was asked for, so that other content gets another mirror, and no file within ever changes.
What changes while it is fetched for one mirror is left out of it, and fetched for another.
Beside it ``origin.json`` says where it is from, so that more of it can be fetched, file by file;
``versions.json``, if there is one, of which versions all files are that ever come into it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from uuid import uuid4

from airzoo_bench.core.errors import StorageError
from airzoo_bench.core.files import atomic_write
from airzoo_bench.storage.cache import cache_faults, cache_folder, fetch_file, held
from airzoo_bench.storage.faults import changed, settled
from airzoo_bench.storage.listing import files
from airzoo_bench.storage.remote import Entry
from airzoo_bench.storage.urls import Url, safe_name, url_of

__all__ = [
    "Mirror",
    "absent_is_absent",
    "fetched",
    "folder_mirror",
    "in_urls",
    "listed_mirror",
    "mirror_of",
    "versions_of",
]

_ORIGIN, _VERSIONS = "origin.json", "versions.json"
_AT_ONCE = 8
_origins: dict[Path, Url] = {}


def folder_mirror(url: Url) -> Mirror:
    """Return the mirror of a folder with all files of it, as they were at one time."""
    return settled(lambda: _folder_mirror(url))


def _folder_mirror(url: Url) -> Mirror:
    found = files(url)
    if not found:
        raise StorageError("no such file or folder, or an empty one", where=url)
    mirror = Mirror.of(url, versions_of(found))
    mirror.fetch_all(found)
    if files(url) != found:
        raise changed(url)
    return mirror


def versions_of(entries: Mapping[str, Entry]) -> str:
    """Return the versions of files; of what has none nobody knows whether it is still the same."""
    return repr([(name, entry.version or uuid4()) for name, entry in entries.items()])


def listed_mirror(url: Url) -> Mirror:
    """Return the mirror of a folder whose files are fetched when they are asked for."""
    found: dict[str, Entry] = {}
    with absent_is_absent():
        found = files(url)
    mirror = Mirror.of(url, versions_of(found))
    stated = mirror.tree.parent / _VERSIONS
    if not stated.is_file():
        with atomic_write(stated, "w") as stream:
            json.dump({name: (one.size, one.version) for name, one in found.items()}, stream)
    return mirror


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
        if not (home / _ORIGIN).is_file():
            with atomic_write(home / _ORIGIN, "w") as stream:
                json.dump({"url": url.address}, stream)
            (home / _ORIGIN).chmod(0o600)  # a signed URL is a secret
        with suppress(OSError):  # of a cache that others own
            (home / _ORIGIN).touch()  # says when the mirror was last used
        tree = home / safe_name(url)
        tree.mkdir(exist_ok=True)
        _origins[home] = url  # messages name it also when the mirror is gone
        return cls(url, tree)

    def fetch(self, name: str, entry: Entry | None = None, sha256: str | None = None) -> Path:
        """Return the path of a file, and fetch it where it is not there."""
        url, target = self.url.child(name), self.tree / name
        with cache_faults():
            if target.is_file():
                return target
            target.parent.mkdir(parents=True, exist_ok=True)
            with held(target) as is_there:
                if not is_there:
                    fetch_file(url, target, entry or self._stated(name), sha256)
        return target

    def _stated(self, name: str) -> Entry | None:
        """Return the version that a file must have, where that is known before it is fetched."""
        versions = _versions(self.tree.parent / _VERSIONS)
        if versions is not None and name not in versions:
            raise StorageError(
                "no such file when its folder was listed", where=self.url.child(name)
            )
        return None if versions is None else Entry(*versions[name])

    def fetch_all(
        self, entries: Mapping[str, Entry | None], sums: Mapping[str, str] | None = None
    ) -> None:
        """Fetch files, several at once; see `fetch`."""
        known = sums or {}
        for name in entries:
            self.url.child(name)  # before anything is fetched, none may lie elsewhere
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            fetched = [
                pool.submit(self.fetch, name, entry, known.get(name))
                for name, entry in entries.items()
            ]
            try:
                for one in fetched:
                    one.result()
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise


def _split(path: Path) -> tuple[Path, str] | None:
    """Return the mirror that a path lies in, and the name there; None of any other path."""
    try:
        key, name, *rest = path.absolute().relative_to(cache_folder()).parts
    except ValueError:
        return None
    home = cache_folder() / key
    return (home / name, "/".join(rest)) if (home / _ORIGIN).is_file() else None


@lru_cache(maxsize=64)
def _versions(file: Path) -> dict[str, tuple[int | None, str]] | None:
    if not file.is_file():
        return None
    stated: dict[str, tuple[int | None, str]] = json.loads(file.read_text(encoding="utf-8"))
    return stated


def _origin(home: Path) -> Url:
    if home not in _origins:
        text = (home / _ORIGIN).read_text(encoding="utf-8")
        url = url_of(json.loads(text)["url"])
        assert url is not None, "written by Mirror.of"
        _origins[home] = url
    return _origins[home]


def mirror_of(path: Path) -> tuple[Mirror, str] | None:
    """Return the mirror that a path lies in, and the name there; None of any other path."""
    found = _split(path)
    return found and (Mirror(_origin(found[0].parent), found[0]), found[1])


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
