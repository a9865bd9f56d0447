"""Copies of files at URLs, made by fsspec, and rasters that GDAL opens where they lie.

A file at ``s3://bucket/name`` has its copy in ``<cache>/s3/bucket/name``, so that a path says its
URL; ``<cache>/versions`` has which version it is. A raster is not copied: an empty file stands
for it.
"""

from __future__ import annotations

import errno
import hashlib
import importlib
import os
import re
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit
from uuid import uuid4

from airzoo_bench.core.errors import StorageError, UsageError, UserError
from airzoo_bench.core.files import atomic_write, cannot_write, sha256_of
from airzoo_bench.storage.urls import Url, cache_folder, copy_of, url_at, url_of

RASTERS = (".tif", ".tiff", ".vrt")
"""Endings of files that are not copied."""
_AT_ONCE = 8
_CONNECT_S, _READ_S = 5, 60
_PIECE_BYTES = 16 << 20
_PACKAGES = {"s3": "s3fs", "gs": "gcsfs", "hf": "huggingface_hub", "https": "aiohttp"}
_CLIENTS = ("aiohttp", "botocore", "gcsfs", "google", "httpx", "huggingface_hub", "s3fs")
_DISK_FAULTS = (errno.ENOSPC, errno.EDQUOT, errno.ENAMETOOLONG, errno.EROFS, errno.ENOTDIR)
_LOGIN = re.compile(r"//[^/\s]*@")
_CREDENTIALS = {
    "s3": "AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE, of somebody who may; "
    "AWS_NO_SIGN_REQUEST=YES for a public bucket",
    "gs": "GOOGLE_APPLICATION_CREDENTIALS, the key file of somebody who may",
    "hf": "HF_TOKEN, or log in with `hf auth login`; for gated data, ask for access on its page",
}
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


class AbsentError(StorageError):
    """Nothing lies at a URL."""


def client_of(url: Url) -> Any:
    """Return fsspec's file system of a URL, with short timeouts."""
    scheme = "https" if url.read_only else url.scheme
    try:
        fsspec = importlib.import_module("fsspec")
        package = importlib.import_module(_PACKAGES[scheme])
    except ImportError as error:
        extras = "storage,download" if scheme == "hf" else "storage"
        raise UsageError(
            f"{url.scheme}:// needs the package {error.name}",
            where=url,
            fix=f"pip install 'airzoo-bench[{extras}]'",
        ) from error
    settings: dict[str, Any] = {"use_listings_cache": False}
    if scheme == "s3":
        timeouts = {"connect_timeout": _CONNECT_S, "read_timeout": _READ_S}
        settings["config_kwargs"] = timeouts | {"retries": {"total_max_attempts": 3}}
        settings["anon"] = os.environ.get("AWS_NO_SIGN_REQUEST", "").upper() in ("YES", "TRUE", "1")
    elif scheme == "https":
        timeout = package.ClientTimeout(total=None, sock_connect=_CONNECT_S, sock_read=_READ_S)
        headers = {"Accept-Encoding": "identity"}  # sizes are those of the files
        settings["client_kwargs"] = {"timeout": timeout, "trust_env": True, "headers": headers}
    client = fsspec.filesystem(url.scheme, **settings)
    client.invalidate_cache()
    return client


@contextmanager
def _explained(url: Url) -> Iterator[None]:
    """Turn what a client raises into one message."""
    try:
        yield
    except UserError:
        raise
    except Exception as error:
        status, fix = _status(error), _CREDENTIALS.get(url.scheme, "use an address without a login")
        if not (isinstance(error, OSError) or type(error).__module__.startswith(_CLIENTS)):
            raise
        if isinstance(error, OSError) and error.errno in _DISK_FAULTS:
            raise cannot_write(cache_folder(), error) from error
        if status == 404 or (status is None and isinstance(error, FileNotFoundError)):
            what, fix = "no such file or folder", "check bucket, name, and the endpoint if any"
            raise AbsentError(what, where=url, fix=fix) from error
        if isinstance(error, PermissionError) or status in (401, 403):
            raise StorageError("access is denied", where=url, fix=fix) from error
        # Of a client's words neither passwords nor signatures are shown.
        said = " ".join(_LOGIN.sub("//", str(error).split("?")[0]).split())[:200]
        raise StorageError(
            f"refuses or cannot be reached: {status or ''} {said or type(error).__name__}",
            where=url,
            fix=f"run this again later; else check the network, AWS_ENDPOINT_URL, and {fix}",
        ) from error


def _status(error: BaseException | None) -> int | None:
    """Return the HTTP status that an error or its cause states."""
    if error is None:
        return None
    stated = error.status if hasattr(error, "status") else getattr(error, "code", None)
    return stated if isinstance(stated, int) else _status(error.__cause__)


def in_parallel(call: Callable[..., Any], *arguments: Any) -> list[Any]:
    """Call a function that waits for a storage for each of the arguments, several at once."""
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        return list(pool.map(call, *arguments))


def names(url: Url, *, deep: bool = False) -> list[str]:
    """List what lies in a folder, or all files below it; nothing where there is no such folder."""
    address = f"{url.address}/" if url.read_only else url.address
    try:
        with _explained(url):
            client = client_of(url)
            listed = client.find(address) if deep else client.ls(address, detail=False)
    except AbsentError:
        return []
    base = url.path
    if url.read_only:
        base = unquote(base)
        listed = [unquote(one.partition("://")[2].split("?")[0]) for one in listed]
    elif url.scheme == "hf":
        base = client.resolve_path(url.address).unresolve()
    below = (one.rstrip("/").removeprefix(f"{base}/") for one in listed if one.startswith(base))
    return sorted(name for name in below if name and name != base and (deep or "/" not in name))


def fetch(url: Url, sha256: str | None = None) -> Path:
    """Return the path of the copy of a file, which is made anew where the file has changed."""
    target, stamp = copy_of(url), _stamp(url)
    _compared.add(target)
    if sha256 is not None and target.is_file() and sha256_of(target) == sha256:
        return target
    with _explained(url):
        client = client_of(url)
        version = client.ukey(url.address)
        if sha256 is None and target.is_file() and _read(stamp) == version:
            return target
        target.parent.mkdir(parents=True, exist_ok=True)
        part = target.with_name(f".{uuid4().hex[:12]}.partial")
        try:
            client.get_file(url.address, str(part))
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


def _stamp(url: Url) -> Path:
    return cache_folder() / "versions" / url.scheme / f"{url.path}.txt"


def _read(path: Path) -> str:
    return path.read_text(encoding="utf-8") if path.is_file() else ""


def _write(path: Path, text: str) -> None:
    with atomic_write(path, "w") as stream:
        stream.write(text)


def fetched(path: Path) -> Path:
    """Return a path, and fetch the file first if it is a copy that may be missing or old."""
    url = url_at(path)
    if url is not None and (path not in _compared or not path.exists()):
        try:
            fetch(url)
        except AbsentError:
            path.unlink(missing_ok=True)
    return path


def here(location: str | Path) -> Path:
    """Return a local path with a location's content; a raster stays where it is."""
    url = url_of(location)
    if url is None:
        return Path(location)
    with _explained(url):
        # A web server would send a whole file to be asked whether it is a folder.
        is_folder = url.says_folder or (not url.read_only and client_of(url).isdir(url.address))
    if not is_folder:
        is_raster = url.name.lower().endswith(RASTERS) and not url.query
        return pointed(copy_of(url)) if is_raster else fetch(url)
    found = names(url, deep=True)
    if not found:
        raise AbsentError("no such file or folder, or an empty one", where=url)
    kept = set(in_parallel(fetch, map(url.child, found)))
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
    if url is not None:
        with _explained(url):
            is_there = client_of(url).exists(url.address)
        if is_there:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch()
    return path


def pointer_at(path: Path) -> Pointer | None:
    """Return the URL of the raster that an empty file represents, or None."""
    url = url_at(path)
    is_pointer = url is not None and path.is_file() and not path.stat().st_size
    return Pointer(url) if url is not None and is_pointer else None


def pointed_sha256(pointer: Pointer) -> str:
    """Return the SHA-256 of a raster at a URL, which is read through once."""
    url, stamp, digest = pointer.place, _stamp(pointer.place), hashlib.sha256()
    with _explained(url):
        client = client_of(url)
        version = client.ukey(url.address)
        known, _, found = _read(stamp).rpartition("\n")
        if known == version:
            return found
        with client.open(url.address, "rb", block_size=_PIECE_BYTES) as stream:
            while piece := stream.read(_PIECE_BYTES):
                digest.update(piece)
    _write(stamp, f"{version}\n{digest.hexdigest()}")
    return digest.hexdigest()
