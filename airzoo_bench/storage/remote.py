"""What lies at URLs, asked for through fsspec: one message for what a storage refuses."""

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
from pathlib import Path
from typing import Any, NamedTuple, TypeVar
from urllib.parse import unquote

from airzoo_bench.core.errors import StorageError, UsageError, UserError
from airzoo_bench.storage.urls import Url

__all__ = [
    "ABSENT",
    "AT_ONCE",
    "CACHE_VARIABLE",
    "Entry",
    "absent_is_absent",
    "cache_folder",
    "client_of",
    "disk_fault",
    "files",
    "find",
    "matching",
    "names",
    "stat",
    "tried",
]

T = TypeVar("T")

CACHE_VARIABLE = "AIRZOO_BENCH_CACHE"
"""The variable of the environment that names the folder of all mirrors."""
PAUSES_S = (0.2, 0.5, 1.0, 2.0)
"""Before each further try."""
AT_ONCE = 8
_CONNECT_S, _READ_S = 5, 60
_PACKAGES = {"s3": "s3fs", "gs": "gcsfs", "hf": "huggingface_hub", "https": "aiohttp"}
_CLIENTS = ("aiohttp", "botocore", "gcsfs", "google", "httpx", "huggingface_hub", "s3fs")
_PASSING = (408, 425, 429, 500, 502, 503, 504)
# Errors of an answer that breaks off, the 400 of which is aiohttp's own.
_BROKEN_OFF = ("ClientPayloadError", "IncompleteRead", "ResponseStreamingError")
_DISK_FAULTS = (errno.ENOSPC, errno.EDQUOT, errno.ENAMETOOLONG, errno.EROFS)
ABSENT = "no such file or folder"
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
    """What a storage says of a name; an empty version is that of a storage that states none."""

    size: int | None
    version: str
    is_folder: bool
    sha256: str | None


def cache_folder() -> Path:
    """Return the folder of all mirrors: AIRZOO_BENCH_CACHE, else one of the user's cache."""
    named = os.environ.get(CACHE_VARIABLE)
    if named:
        return Path(named).expanduser().absolute()
    from platformdirs import user_cache_path

    return user_cache_path("airzoo-bench") / "mirrors"


def client_of(url: Url) -> Any:
    """Return fsspec's file system of a URL, with short timeouts."""
    scheme = "https" if url.read_only else url.scheme
    try:
        fsspec = importlib.import_module("fsspec")
        importlib.import_module(_PACKAGES[scheme])
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
        import aiohttp

        timeout = aiohttp.ClientTimeout(total=None, sock_connect=_CONNECT_S, sock_read=_READ_S)
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
        except Exception as error:
            known = isinstance(error, OSError) or type(error).__module__.startswith(_CLIENTS)
            if not known or isinstance(error, UserError):
                raise
            if pause is None or not _may_pass(error):
                raise _explained(url, error) from error
        time.sleep(pause)
    raise AssertionError("the last try returns or raises")  # pragma: no cover


def _status(error: BaseException) -> int | None:
    """Return the HTTP status that an error states, or what caused it."""
    if type(error).__name__ in _BROKEN_OFF:
        return None
    response: Any = getattr(error, "response", None)
    if isinstance(response, dict):  # botocore
        stated = response.get("ResponseMetadata", {}).get("HTTPStatusCode")
    else:
        stated = getattr(error, "status", getattr(response, "status_code", None))
    stated = stated or getattr(error, "code", None)
    if str(stated).isdigit():
        return int(str(stated))
    return None if error.__cause__ is None else _status(error.__cause__)


def _may_pass(error: Exception) -> bool:
    status = _status(error)
    lacking = "Credential" in type(error).__name__ or getattr(error, "errno", 0) in _DISK_FAULTS
    final = lacking or isinstance(error, FileNotFoundError | PermissionError)
    return not final if status is None else status in _PASSING


def _explained(url: Url, error: Exception) -> UserError:
    """Return the message of what a client raised."""
    credentials = _CREDENTIALS.get(
        url.scheme, "use an address that needs no login, or a signed one"
    )
    if getattr(error, "errno", None) in _DISK_FAULTS:
        return disk_fault(error)
    status = _status(error)
    if status == 404 or (status is None and isinstance(error, FileNotFoundError)):
        return StorageError(ABSENT, where=url, fix="check bucket, name, and the endpoint if any")
    if status in (401, 403) or isinstance(error, PermissionError):
        return StorageError("access is denied", where=url, fix=credentials)
    if _may_pass(error):
        what = f"cannot be reached, tried {len(PAUSES_S) + 1} times ({status or 'no answer'})"
        fix = "run this again later; where it stays so, check the network and AWS_ENDPOINT_URL"
    else:
        what, fix = "the storage refuses", credentials
    # Of a client's words neither passwords nor signatures are shown.
    said = " ".join(_LOGIN.sub("//", str(error).split("?")[0]).split())[:200]
    return StorageError(f"{what}: {said or type(error).__name__}", where=url, fix=fix)


def disk_fault(error: Exception) -> UserError:
    """Return the message of what the disk of this machine refuses."""
    return UserError(
        f"cannot be written: {getattr(error, 'strerror', None) or error}",
        where=cache_folder(),
        fix="make room, or remove mirrors in it that no run is using, "
        f"or set {CACHE_VARIABLE} to a folder on another disk",
    )


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
    size = info.get("size")
    # A web server shows a folder as a page.
    is_folder = info.get("type") == "directory" or info.get("mimetype") == "text/html"
    version = " ".join([*stated, f"size={size}"]) if stated else ""
    return Entry(size, version, is_folder, (info.get("lfs") or {}).get("sha256"))


def files(url: Url) -> dict[str, Entry]:
    """List all files below a folder by their relative names, in their order."""
    client = client_of(url)
    address = f"{url.address}/" if url.read_only else url.address
    found = tried(url, lambda: client.find(address, detail=True))
    below = {_relative(url, path): _entry(info) for path, info in found.items()}
    listed = sorted(name for name in below if name and not name.endswith("/"))
    if not url.read_only:
        return {name: below[name] for name in listed}
    with ThreadPoolExecutor(AT_ONCE) as pool:  # the page of a folder says no more than names
        entries = pool.map(lambda name: stat(url.child(name)), listed)
        return dict(zip(listed, entries, strict=True))


def names(url: Url, *, folders: bool = False) -> list[str]:
    """List what lies in a folder, one level deep; nothing where there is no such folder."""
    client = client_of(url)
    address = f"{url.address}/" if url.read_only else url.address
    listed: list[dict[str, Any]] = []
    with absent_is_absent():
        listed = tried(url, lambda: client.ls(address, detail=True))
    kinds = {_relative(url, one["name"]).rstrip("/"): one["type"] for one in listed}
    found = [name for name in kinds if name not in ("", ".") and "/" not in name]
    return sorted(name for name in found if not folders or kinds[name] == "directory")


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
