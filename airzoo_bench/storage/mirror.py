"""Copies of what lies at URLs, rasters that GDAL opens where they lie, and uploads.

Of a folder at a URL there is a mirror ``<cache>/<key>/<name>``, which files come to when they are
asked for; its key is that of the URL and of its version, so that other content gets another one.
A raster is not copied: an empty file stands for it.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Collection, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from urllib.parse import urlsplit
from uuid import uuid4

from airzoo_bench.core.errors import StorageError, UsageError
from airzoo_bench.core.files import atomic_write, sha256_of
from airzoo_bench.storage.remote import (
    ABSENT,
    AT_ONCE,
    Entry,
    absent_is_absent,
    cache_folder,
    client_of,
    disk_fault,
    files,
    find,
    stat,
    tried,
)
from airzoo_bench.storage.urls import Url, safe_name, url_of

__all__ = [
    "RASTERS",
    "Mirror",
    "Pointer",
    "check_writable",
    "fetched",
    "here",
    "in_urls",
    "mirror_of",
    "pointed",
    "pointed_sha256",
    "pointer_at",
    "uploaded",
    "versions_of",
]

RASTERS = (".tif", ".tiff", ".vrt")
"""Endings of files that are not copied."""
_ORIGIN = "origin.txt"
_PIECE_BYTES = 16 << 20
_origins: dict[Path, Url] = {}  # messages name URLs also when the mirror is gone


def versions_of(entries: Mapping[str, Entry]) -> str:
    """Return the versions of files; of what has none nobody knows whether it is still the same."""
    return repr([(name, entry.version or uuid4()) for name, entry in entries.items()])


@dataclass(frozen=True)
class Mirror:
    """The copy of a folder, or of some files of it; `tree` has what was fetched."""

    url: Url
    tree: Path

    @classmethod
    def of(cls, url: Url, versions: str) -> Mirror:
        """Open a folder's mirror, and make it where there is none."""
        home = (
            cache_folder() / hashlib.sha256(f"{url.address}\n{versions}".encode()).hexdigest()[:24]
        )
        try:
            with atomic_write(home / _ORIGIN, "w") as stream:
                stream.write(url.address)
            (home / _ORIGIN).chmod(0o600)  # a signed URL is a secret
            (home / safe_name(url)).mkdir(exist_ok=True)
        except OSError as error:
            raise disk_fault(error) from error
        _origins[home] = url
        return cls(url, home / safe_name(url))

    def fetch(self, name: str, sha256: str | None = None) -> Path:
        """Return the path of a file, and fetch it where it is not there."""
        url, target = self.url.child(name), self.tree / name
        if os.path.isfile(target):  # noqa: PTH113 - also of a name that the disk cannot hold
            return target
        part, client = target.with_name(f".{uuid4().hex[:12]}.partial"), client_of(url)

        def download() -> None:
            target.parent.mkdir(parents=True, exist_ok=True)
            client.get_file(url.address, str(part))
            if sha256 is not None and sha256_of(part) != sha256:
                raise StorageError(
                    "is not the file that benchmark.toml states",
                    where=url,
                    expected=f"SHA-256 {sha256[:12]}…",
                    fix="upload the benchmark again, all of it",
                )
            part.replace(target)

        try:
            tried(url, download)
        finally:
            part.unlink(missing_ok=True)
        return target

    def fetch_all(self, wanted: Mapping[str, str | None]) -> None:
        """Fetch files, each with its SHA-256 where that is known, several at once."""
        for name in wanted:
            self.url.child(name)  # before anything is fetched, none may lie elsewhere
        with ThreadPoolExecutor(AT_ONCE) as pool:
            list(pool.map(self.fetch, wanted, wanted.values()))


def mirror_of(path: Path) -> tuple[Mirror, str] | None:
    """Return the mirror that a path lies in, and the name there; None of any other path."""
    try:
        key, name, *rest = path.absolute().relative_to(cache_folder()).parts
    except ValueError:
        return None
    home = cache_folder() / key
    if home not in _origins:
        with suppress(OSError):
            url = url_of((home / _ORIGIN).read_text(encoding="utf-8"))
            if url is not None:
                _origins[home] = url
    return (Mirror(_origins[home], home / name), "/".join(rest)) if home in _origins else None


def fetched(path: Path, *, anew: bool = False) -> Path:
    """Return a path, and fetch the file first if it belongs to a mirror and is not there yet."""
    found = None if path.exists() and not anew else mirror_of(path)
    if found is not None:
        path.unlink(missing_ok=True)
        with absent_is_absent():
            found[0].fetch(found[1])
    return path


def here(location: str | Path) -> Path:
    """Return a path on this machine with what lies at a location; a raster stays where it is."""
    url = url_of(location)
    if url is None:
        return Path(location)
    says_folder = url.says_folder and not url.read_only  # a web server says so itself
    entry = None if says_folder else stat(url)
    if entry is None or entry.is_folder:
        found = files(url)
        if not found:
            raise StorageError(f"{ABSENT}, or an empty one", where=url)
        mirror = Mirror.of(url, versions_of(found))
        mirror.fetch_all(dict.fromkeys(found))
        return mirror.tree
    mirror = Mirror.of(url.parent, versions_of({url.name: entry}))
    if url.name.lower().endswith(RASTERS):
        return pointed(mirror.tree / url.name)
    return mirror.fetch(url.name)


def in_urls(text: str) -> str:
    """Return a message in which paths of mirrors are called by their URLs."""
    for home, url in _origins.items():
        text = text.replace(str(home / safe_name(url)), str(url))
    return text


@dataclass(frozen=True)
class Pointer:
    """Where a raster lies that GDAL opens at its URL."""

    place: Url

    @property
    def virtual(self) -> str:
        """The name by which GDAL opens it."""
        if self.place.scheme in ("s3", "gs"):
            return f"/vsi{self.place.scheme}/{self.place.path}"
        if self.place.scheme == "hf":
            return f"/vsicurl/{client_of(self.place).url(self.place.address)}"
        return f"/vsicurl/{self.place.address}"

    def without_secrets(self, text: str) -> str:
        """Return what GDAL says, without the password and the signature of the URL."""
        login, at, _ = self.place.path.partition("/")[0].rpartition("@")
        for secret in filter(None, (f"{login}{at}", self.place.query)):
            text = text.replace(secret, "…")
        return text

    def settings(self) -> dict[str, str]:
        """Return GDAL's settings for it; keys it finds in the environment itself."""
        found = {
            # Files beside a raster are asked for by name: to list a folder takes longer.
            "GDAL_DISABLE_READDIR_ON_OPEN": "TRUE",
            "GDAL_HTTP_CONNECTTIMEOUT": "5",
            "GDAL_HTTP_LOW_SPEED_TIME": "60",
            "GDAL_HTTP_LOW_SPEED_LIMIT": "1",
            "GDAL_HTTP_MAX_RETRY": "4",
            "GDAL_HTTP_RETRY_DELAY": "0.3",
        }
        scheme, environment = self.place.scheme, os.environ
        endpoint = environment.get("AWS_ENDPOINT_URL_S3") or environment.get("AWS_ENDPOINT_URL")
        if scheme == "s3" and endpoint:
            address = urlsplit(endpoint)
            found["AWS_S3_ENDPOINT"] = address.netloc + address.path.rstrip("/")
            found["AWS_HTTPS"] = "YES" if address.scheme == "https" else "NO"
            found["AWS_VIRTUAL_HOSTING"] = "FALSE"
        if scheme == "hf" and environment.get("HF_TOKEN"):
            found["GDAL_HTTP_HEADERS"] = f"Authorization: Bearer {environment['HF_TOKEN']}"
        return found


def pointed(path: Path) -> Path:
    """Return the path of a raster; in a mirror an empty file stands for one that lies at a URL."""
    found = None if path.exists() else mirror_of(path)
    if found is not None and find(found[0].url.child(found[1])) is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    return path


def pointer_at(path: Path) -> Pointer | None:
    """Return where the raster lies for which a mirror has an empty file; None of any other path."""
    found = mirror_of(path)
    stands = found is not None and path.is_file() and not path.stat().st_size
    return Pointer(found[0].url.child(found[1])) if found is not None and stands else None


def pointed_sha256(path: Path, pointer: Pointer) -> str:
    """Return the SHA-256 of a raster at a URL: as stated there, else read through once."""
    url, now = pointer.place, stat(pointer.place)
    if now.sha256 is not None:
        return now.sha256
    key = hashlib.sha256(f"{url.address} {now.version}".encode()).hexdigest()[:24]
    kept = cache_folder() / "checksums" / key
    if now.version and kept.is_file():
        return kept.read_text(encoding="ascii")

    def read() -> str:
        digest = hashlib.sha256()
        with client_of(url).open(url.address, "rb", block_size=_PIECE_BYTES) as stream:
            while piece := stream.read(_PIECE_BYTES):
                digest.update(piece)
        return digest.hexdigest()

    found = tried(url, read)
    with atomic_write(kept, "w") as stream:
        stream.write(found)
    return found


def check_writable(url: Url) -> None:
    """Refuse, before any work, a place where nothing can be written."""
    if url.read_only:
        raise UsageError(
            "can only be read from",
            where=f"--out {url}",
            expected="a folder, or a URL of s3://, gs:// or hf://",
        )
    client, probe = client_of(url), url.child(".airzoo-part")
    tried(probe, lambda: client.pipe_file(probe.address, b"0"))
    tried(probe, lambda: client.rm_file(probe.address))


@contextmanager
def uploaded(url: Url, last: str, replaced: Collection[str]) -> Iterator[Path]:
    """Fill a folder of this machine, and upload it in place of what was uploaded there before.

    The file that counts, `last`, is removed first and comes last.
    """
    folder = Mirror.of(url, str(uuid4())).tree
    try:
        yield folder
        new = [path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()]
        old = list[str]()
        with absent_is_absent():
            old = [name for name in files(url) if name.partition("/")[0] in {last, *replaced}]
        client = client_of(url)
        for name in sorted(old, key=lambda name: name != last):
            if name == last or name not in new:
                tried(url.child(name), partial(client.rm_file, url.child(name).address))
        for name in sorted(new, key=lambda name: (name == last, name)):
            place = url.child(name)
            tried(place, partial(client.put_file, str(folder / name), place.address))
    except StorageError as error:
        kept = folder.parent.rename(cache_folder() / f"unsent-{uuid4().hex[:12]}") / folder.name
        error.fix = f"{error.fix or 'mend it'}; what was made is kept in {kept}"
        raise
    finally:
        shutil.rmtree(folder.parent, ignore_errors=True)
