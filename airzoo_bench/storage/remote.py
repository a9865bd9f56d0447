"""Asks fsspec what lies at URLs, and says in one message what a storage refuses."""

from __future__ import annotations

import errno
import importlib
import os
import re
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar
from urllib.parse import unquote

from airzoo_bench.core.errors import StorageError, UsageError, UserError
from airzoo_bench.storage.urls import CACHE_VARIABLE, Url, cache_folder

T = TypeVar("T")
R = TypeVar("R")

PAUSES_S = (0.2, 0.5, 1.0, 2.0)
"""Before each further try."""
ABSENT = "no such file or folder"
_AT_ONCE = 8
_CONNECT_S, _READ_S = 5, 60
_PACKAGES = {"s3": "s3fs", "gs": "gcsfs", "hf": "huggingface_hub", "https": "aiohttp"}
_CLIENTS = ("aiohttp", "botocore", "gcsfs", "google", "httpx", "huggingface_hub", "s3fs")
_DISK_FAULTS = (errno.ENOSPC, errno.EDQUOT, errno.ENAMETOOLONG, errno.EROFS, errno.ENOTDIR)
# What tells one content of a name from another, by the words of each client.
_VERSIONS = ("ETag", "etag", "generation", "blob_id", "md5Hash", "Last-Modified")
_LOGIN = re.compile(r"//[^/\s]*@")
_CREDENTIALS = {
    "s3": "AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_PROFILE, of somebody who may; "
    "AWS_NO_SIGN_REQUEST=YES for a public bucket",
    "gs": "GOOGLE_APPLICATION_CREDENTIALS, the key file of somebody who may",
    "hf": "HF_TOKEN, or log in with `hf auth login`; for gated data, ask for access on its page",
}


class Entry(NamedTuple):
    """A storage's answer about a name; the version is empty where it states none."""

    version: str
    is_folder: bool
    sha256: str | None


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
        settings["config_kwargs"] = timeouts | {"retries": {"total_max_attempts": 1}}
        settings["anon"] = os.environ.get("AWS_NO_SIGN_REQUEST", "").upper() in ("YES", "TRUE", "1")
    elif scheme == "https":
        timeout = package.ClientTimeout(total=None, sock_connect=_CONNECT_S, sock_read=_READ_S)
        headers = {"Accept-Encoding": "identity"}  # sizes are those of the files
        settings["client_kwargs"] = {"timeout": timeout, "trust_env": True, "headers": headers}
    client = fsspec.filesystem(url.scheme, **settings)
    client.invalidate_cache()
    return client


def tried(url: Url, call: Callable[[], T]) -> T:
    """Call a client, again where its storage is busy or out of reach for a moment."""
    for pause in (*PAUSES_S, None):
        try:
            return call()
        except UserError:
            raise
        except Exception as error:
            if not (isinstance(error, OSError) or type(error).__module__.startswith(_CLIENTS)):
                raise
            known = _known_fault(url, error)
            if known is not None or pause is None:
                raise known or _unreachable(url, error) from error
        time.sleep(pause)
    raise AssertionError("the last try returns or raises")  # pragma: no cover


def _status(error: BaseException | None) -> int | None:
    """Return the HTTP status that an error or its cause states."""
    if error is None:
        return None
    stated = error.status if hasattr(error, "status") else getattr(error, "code", None)
    return stated if isinstance(stated, int) else _status(error.__cause__)


def _known_fault(url: Url, error: Exception) -> UserError | None:
    """Return the message of an error that another try would not mend."""
    status = _status(error)
    if getattr(error, "errno", None) in _DISK_FAULTS:
        return UserError(
            f"cannot be written: {getattr(error, 'strerror', None) or error}",
            where=cache_folder(),
            fix="make room, or remove copies in it that no run is using, "
            f"or set {CACHE_VARIABLE} to a folder on another disk",
        )
    if status == 404 or (status is None and isinstance(error, FileNotFoundError)):
        return StorageError(ABSENT, where=url, fix="check bucket, name, and the endpoint if any")
    if isinstance(error, PermissionError) or status in (401, 403):
        return StorageError("access is denied", where=url, fix=_credentials(url))
    return None


def _credentials(url: Url) -> str:
    return _CREDENTIALS.get(url.scheme, "use an address that needs no login, or a signed one")


def _unreachable(url: Url, error: Exception) -> UserError:
    # Of a client's words neither passwords nor signatures are shown.
    said = " ".join(_LOGIN.sub("//", str(error).split("?")[0]).split())[:200]
    return StorageError(
        f"refuses or cannot be reached, tried {len(PAUSES_S) + 1} times: "
        f"{_status(error) or ''} {said or type(error).__name__}",
        where=url,
        fix="run this again later; where it stays so, check the network, AWS_ENDPOINT_URL, and "
        + _credentials(url),
    )


def in_parallel(call: Callable[..., R], *arguments: Any) -> list[R]:
    """Call a function that waits for a storage for each of the arguments, several at once."""
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        return list(pool.map(call, *arguments))


def stat(url: Url) -> Entry:
    """Ask what lies at a URL."""
    client = client_of(url)
    return _entry(tried(url, lambda: client.info(url.address)))


def find(url: Url) -> Entry | None:
    """Ask what lies at a URL; None where there is nothing."""
    try:
        return stat(url)
    except StorageError as error:
        if error.what != ABSENT:
            raise
        return None


@contextmanager
def absent_is_absent() -> Iterator[None]:
    """Go on where a storage does not have what was asked for."""
    try:
        yield
    except StorageError as error:
        if error.what != ABSENT:
            raise


def _entry(info: Mapping[str, Any]) -> Entry:
    stated = [f"{key}={info[key]}" for key in _VERSIONS if info.get(key)]
    # A web server shows a folder as a page.
    is_folder = info.get("type") == "directory" or info.get("mimetype") == "text/html"
    version = " ".join([*stated, f"size={info.get('size')}"]) if stated else ""
    return Entry(version, is_folder, (info.get("lfs") or {}).get("sha256"))


def files(url: Url) -> dict[str, Entry]:
    """List all files below a folder by their relative names, in their order."""
    client = client_of(url)
    found = tried(url, lambda: client.find(_folder_address(url), detail=True))
    below = {_relative(url, path): _entry(info) for path, info in found.items()}
    listed = sorted(name for name in below if name and not name.endswith("/"))
    if not url.read_only:
        return {name: below[name] for name in listed}
    # The page of a folder says no more than names.
    return dict(zip(listed, in_parallel(stat, map(url.child, listed)), strict=True))


def names(url: Url, *, folders: bool = False) -> list[str]:
    """List what lies in a folder, one level deep; nothing where there is no such folder."""
    client = client_of(url)
    listed: list[dict[str, Any]] = []
    with absent_is_absent():
        listed = tried(url, lambda: client.ls(_folder_address(url), detail=True))
    kinds = {_relative(url, one["name"]).rstrip("/"): one["type"] for one in listed}
    found = [name for name in kinds if name not in ("", ".") and "/" not in name]
    return sorted(name for name in found if not folders or kinds[name] == "directory")


def _folder_address(url: Url) -> str:
    return f"{url.address}/" if url.read_only else url.address


def _relative(url: Url, listed: str) -> str:
    """Return a listed name as seen from its folder; empty for what does not lie in it."""
    base = url.path
    if url.read_only:
        base, listed = unquote(base), unquote(listed.partition("://")[2].split("?")[0])
    elif url.scheme == "hf":
        base = client_of(url).resolve_path(url.address).unresolve()
    return listed[len(base) + 1 :] if listed.startswith(f"{base}/") else ""


def matching(url: Url) -> list[Url]:
    """Return the places that a URL with ``*`` in its names means; of any other, itself."""
    if "*" not in url.path:
        return [url]
    client = client_of(url)
    found = sorted(tried(url, lambda: client.glob(url.address)))
    if not found:
        raise StorageError(ABSENT, where=url)
    return [replace(url, path=one.rpartition("://")[2].rstrip("/")) for one in found]
