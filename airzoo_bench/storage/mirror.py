"""Copies of files at URLs, rasters that GDAL opens where they lie, and uploads.

A file at ``s3://bucket/name`` has its copy in ``<cache>/s3/bucket/name``, so that a path says its
URL; ``<cache>/versions`` has which version it is. A raster is not copied: an empty file stands
for it.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from urllib.parse import urlsplit
from uuid import uuid4

from airzoo_bench.core.errors import StorageError, UsageError
from airzoo_bench.core.files import atomic_write, sha256_of
from airzoo_bench.storage.remote import (
    ABSENT,
    Entry,
    absent_is_absent,
    client_of,
    files,
    find,
    in_parallel,
    stat,
    tried,
)
from airzoo_bench.storage.urls import Url, cache_folder, copy_of, url_at, url_of

RASTERS = (".tif", ".tiff", ".vrt")
"""Endings of files that are not copied."""
_PIECE_BYTES = 16 << 20
_GDAL = {
    # Files beside a raster are asked for by name: to list a folder takes longer.
    "GDAL_DISABLE_READDIR_ON_OPEN": "TRUE",
    "GDAL_HTTP_CONNECTTIMEOUT": "5",
    "GDAL_HTTP_LOW_SPEED_TIME": "60",
    "GDAL_HTTP_LOW_SPEED_LIMIT": "1",
    "GDAL_HTTP_MAX_RETRY": "4",
    "GDAL_HTTP_RETRY_DELAY": "0.3",
}
_compared: set[Path] = set()  # copies that this process has held against their URLs


def fetch(url: Url, sha256: str | None = None, entry: Entry | None = None) -> Path:
    """Return the path of the copy of a file, which is made anew where the file has changed."""
    target, stamp = copy_of(url), _stamp(url)

    def download() -> Path:
        there = target.is_file()
        if there and sha256 is not None and sha256_of(target) == sha256:
            return target
        version = (entry or stat(url)).version
        if there and sha256 is None and version and _read(stamp) == version:
            return target
        target.parent.mkdir(parents=True, exist_ok=True)
        part = target.with_name(f".{uuid4().hex[:12]}.partial")
        try:
            client_of(url).get_file(url.address, str(part))
            if sha256 is not None and sha256_of(part) != sha256:
                raise StorageError(
                    "is not the file that benchmark.toml states",
                    where=url,
                    expected=f"SHA-256 {sha256[:12]}…",
                    fix="upload the benchmark again, all of it",
                )
            part.replace(target)
        finally:
            part.unlink(missing_ok=True)
        _write(stamp, version)
        return target

    _compared.add(target)
    return tried(url, download)


def _stamp(url: Url) -> Path:
    return cache_folder() / "versions" / url.scheme / f"{url.path}.txt"


def _read(path: Path) -> str:
    return path.read_text(encoding="utf-8") if path.is_file() else ""


def _write(path: Path, text: str) -> None:
    with atomic_write(path, "w") as stream:
        stream.write(text)


def fetched(path: Path, *, anew: bool = False) -> Path:
    """Return a path, and fetch the file first if it is a copy that may be missing or old."""
    url = url_at(path)
    if url is not None and (anew or path not in _compared or not path.exists()):
        try:
            fetch(url)
        except StorageError as error:
            if error.what != ABSENT:
                raise
            path.unlink(missing_ok=True)
    return path


def here(location: str | Path) -> Path:
    """Return a local path with a location's content; a raster stays where it is."""
    url = url_of(location)
    if url is None:
        return Path(location)
    says_folder = url.says_folder and not url.read_only  # a web server says so itself
    entry = None if says_folder else stat(url)
    if entry is not None and not entry.is_folder:
        is_pointed = url.name.lower().endswith(RASTERS) and not url.query
        return pointed(copy_of(url)) if is_pointed else fetch(url, entry=entry)
    found = files(url)
    if not found:
        raise StorageError(f"{ABSENT}, or an empty one", where=url)
    places = [url.child(name) for name in found]
    kept = set(in_parallel(fetch, places, [None] * len(places), found.values()))
    for path in copy_of(url).rglob("*"):  # of what lay there earlier
        if path.is_file() and path not in kept:
            path.unlink()
    return copy_of(url)


@dataclass(frozen=True)
class Pointer:
    """Where a raster lies that GDAL opens at its URL."""

    place: Url

    @property
    def virtual(self) -> str:
        """Its name for GDAL."""
        if self.place.scheme in ("s3", "gs"):
            return f"/vsi{self.place.scheme}/{self.place.path}"
        if self.place.scheme == "hf":
            return f"/vsicurl/{client_of(self.place).url(self.place.address)}"
        return f"/vsicurl/{self.place.address}"

    def settings(self) -> dict[str, str]:
        """Return GDAL's settings for it; keys it finds in the environment itself."""
        found, environment = dict(_GDAL), os.environ
        endpoint = environment.get("AWS_ENDPOINT_URL_S3") or environment.get("AWS_ENDPOINT_URL")
        if self.place.scheme == "s3" and endpoint:
            address = urlsplit(endpoint)
            found["AWS_S3_ENDPOINT"] = address.netloc + address.path.rstrip("/")
            found["AWS_HTTPS"] = "YES" if address.scheme == "https" else "NO"
            found["AWS_VIRTUAL_HOSTING"] = "FALSE"
        if self.place.scheme == "hf" and environment.get("HF_TOKEN"):
            found["GDAL_HTTP_HEADERS"] = f"Authorization: Bearer {environment['HF_TOKEN']}"
        return found


def pointed(path: Path) -> Path:
    """Return the path of a raster; an empty file represents one at a URL."""
    url = None if path.exists() else url_at(path)
    if url is not None and find(url) is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    return path


def pointer_at(path: Path) -> Pointer | None:
    """Return the URL of the raster that an empty file represents, or None."""
    url = url_at(path)
    stands = url is not None and path.is_file() and not path.stat().st_size
    return Pointer(url) if url is not None and stands else None


def pointed_sha256(pointer: Pointer) -> str:
    """Return the SHA-256 of a raster at a URL: as stated there, else read through once."""
    url, now = pointer.place, stat(pointer.place)
    if now.sha256 is not None:
        return now.sha256
    stamp = _stamp(url)
    known, _, found = _read(stamp).rpartition("\n")
    if known and known == now.version:
        return found

    def read() -> str:
        digest = hashlib.sha256()
        with client_of(url).open(url.address, "rb", block_size=_PIECE_BYTES) as stream:
            while piece := stream.read(_PIECE_BYTES):
                digest.update(piece)
        return digest.hexdigest()

    found = tried(url, read)
    _write(stamp, f"{now.version}\n{found}")
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
    """Fill the copy of a folder, and upload it in place of the earlier upload.

    The file that counts, `last`, is removed first and comes last.
    """
    folder, names = copy_of(url), {last, *replaced}
    yield folder
    try:
        paths = [path for path in folder.rglob("*") if path.is_file()]
        new = [path.relative_to(folder).as_posix() for path in paths]
        new = [name for name in new if name.partition("/")[0] in names]
        old = list[str]()
        with absent_is_absent():
            old = [name for name in files(url) if name.partition("/")[0] in names]
        client = client_of(url)
        for name in sorted(old, key=lambda name: name != last):
            if name == last or name not in new:
                tried(url.child(name), partial(client.rm_file, url.child(name).address))
        for name in sorted(new, key=lambda name: (name == last, name)):
            place = url.child(name)
            tried(place, partial(client.put_file, str(folder / name), place.address))
    except StorageError as error:
        kept = cache_folder() / f"unsent-{uuid4().hex[:12]}" / folder.name
        kept.parent.mkdir()
        folder.rename(kept)
        error.fix = f"{error.fix or 'mend it'}; what was made is kept in {kept}"
        raise
