"""What a storage holds, through fsspec; clients are imported when a URL is first asked for."""

from __future__ import annotations

import base64
import importlib
import os
import shutil
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from airzoo_bench.core.errors import StorageError, UsageError
from airzoo_bench.storage.faults import ShortAnswerError, changed, check_version, tried
from airzoo_bench.storage.urls import Url, url_of
from airzoo_bench.storage.web import fetch_behind, web_range

__all__ = [
    "Entry",
    "client_of",
    "entry_of",
    "fetch_onto",
    "find",
    "read_range",
    "sha256_stated",
    "stat",
]

_CONNECT_S, _READ_S = 5, 60
_PIECE_BYTES = 16 << 20
_PACKAGES = {
    "s3": ("fsspec", "s3fs"),
    "gs": ("fsspec", "gcsfs"),
    "hf": ("fsspec", "huggingface_hub"),
    "https": ("fsspec", "aiohttp"),
}
# What tells one content of a name from another, by the words of each client.
_VERSIONS = ("ETag", "etag", "generation", "blob_id", "md5Hash", "Last-Modified")


@dataclass(frozen=True, slots=True)
class Entry:
    """What a storage says of a name.

    Attributes
    ----------
    size : int or None
        Bytes, where it says so.
    version : str
        The same only where the content is the same; empty where the storage states none.
    is_folder : bool
    sha256 : str or None
        Of the content, where the storage has computed it.
    """

    size: int | None
    version: str
    is_folder: bool = False
    sha256: str | None = None


def client_of(url: Url) -> Any:
    """Return fsspec's file system of a URL."""
    scheme = "https" if url.read_only else url.scheme
    for name in _PACKAGES[scheme]:
        try:
            importlib.import_module(name)
        except ImportError as error:
            raise UsageError(
                f"{url.scheme}:// needs the package {name}",
                where=url,
                fix="pip install 'airzoo-bench[storage"
                + (",download]'" if url.scheme == "hf" else "]'"),
            ) from error
    import fsspec

    return fsspec.filesystem(url.scheme, **_settings(scheme))


def _settings(scheme: str) -> dict[str, Any]:
    """Return short timeouts, and no tries but `tried`'s."""
    if scheme == "s3":
        timeouts = {"connect_timeout": _CONNECT_S, "read_timeout": _READ_S}
        return {
            "config_kwargs": timeouts | {"retries": {"total_max_attempts": 1}},
            "use_listings_cache": False,
            "anon": os.environ.get("AWS_NO_SIGN_REQUEST", "").upper() in ("YES", "TRUE", "1"),
        }
    if scheme == "https":
        import aiohttp

        timeout = aiohttp.ClientTimeout(total=None, sock_connect=_CONNECT_S, sock_read=_READ_S)
        return {"client_kwargs": {"timeout": timeout, "trust_env": True}}
    return {"use_listings_cache": False}


def stat(url: Url) -> Entry:
    """Ask what lies at a URL."""
    client = client_of(url)
    try:
        return entry_of(tried(url, lambda: client.info(url.address, **_fresh(client, url))))
    except StorageError as error:
        unclear = error.what.startswith(("access is denied", "the storage refuses"))
        if unclear and url.scheme == "s3" and "/" in url.path:
            # The answer to HEAD has no text; that to GET says why.
            tried(url, lambda: client.cat_file(url.address, start=0, end=1))
        raise


def _fresh(client: Any, url: Url) -> dict[str, bool]:
    if url.scheme != "hf":
        return {"refresh": True} if url.scheme == "s3" else {}
    # Unless it is asked for more, this client lists the whole folder that a file lies in.
    below = getattr(client.resolve_path(url.address), "path_in_repo", "")
    return {"refresh": True, "expand_info": bool(below)}


def find(url: Url) -> Entry | None:
    """Ask what lies at a URL; None where there is nothing."""
    try:
        return stat(url)
    except StorageError as error:
        if error.what.startswith("no such"):
            return None
        raise


def entry_of(info: Mapping[str, Any]) -> Entry:
    """Return an entry by what a client says."""
    stated = [f"{key}={info[key]}" for key in _VERSIONS if info.get(key)]
    lfs = info.get("lfs") or {}
    size = info.get("size")
    return Entry(
        None if size is None else int(size),
        " ".join([*stated, f"size={size}"]) if stated else "",
        # A web server shows a folder as a page.
        info.get("type") == "directory" or info.get("mimetype") == "text/html",
        lfs.get("sha256"),
    )


def read_range(location: str | Path, offset: int, length: int, version: str = "") -> bytes:
    """Read bytes of a file where it lies: at a URL, or on this machine."""
    url = url_of(location)
    if url is None:
        with Path(location).open("rb") as stream:
            stream.seek(offset)
            found = stream.read(length)
        if len(found) != length:
            raise StorageError("the file ends before what was to be read", where=location)
        return found
    return _range(url, offset, length, version)


def _range(url: Url, offset: int, length: int, version: str) -> bytes:
    if not length:
        return b""
    client = client_of(url)

    def read() -> bytes:
        if url.read_only:
            found = web_range(client, url, offset, length, version)
        elif url.scheme == "s3":
            found = _s3_range(client, url, offset, length, version)
        else:
            found = client.cat_file(url.address, start=offset, end=offset + length)
        if len(found) != length:
            raise ShortAnswerError(f"{len(found):,} of {length:,} bytes came")
        return found

    data: bytes = tried(url, read)
    if version and url.scheme in ("gs", "hf") and stat(url).version != version:
        raise changed(url)  # their clients do not show what an answer says of itself
    return data


def _s3_range(client: Any, url: Url, offset: int, length: int, version: str) -> bytes:
    from fsspec.asyn import sync

    bucket, key, _ = client.split_path(url.path)
    wanted = f"bytes={offset}-{offset + length - 1}"
    answer = client.call_s3("get_object", Bucket=bucket, Key=key, Range=wanted)

    async def read() -> bytes:
        with closing(answer["Body"]) as body:
            check_version(url, version, answer)
            return bytes(await body.read())

    data: bytes = sync(client.loop, read)
    return data


def fetch_onto(url: Url, entry: Entry, part: Path) -> None:
    """Fetch a file behind the bytes that `part` has already, all of one version."""
    if url.read_only:
        _fetch_web(url, entry, part)
        return
    with part.open("ab") as stream:
        while (done := stream.tell()) < (entry.size or 0):
            length = min(_PIECE_BYTES, (entry.size or 0) - done)
            stream.write(_range(url, done, length, entry.version))


def _fetch_web(url: Url, entry: Entry, part: Path) -> None:
    client = client_of(url)
    # Of what states no size, nobody knows whether it ends.
    most = shutil.disk_usage(part.parent).free // 2 if entry.size is None else entry.size

    def fetch() -> None:
        if not entry.version:  # who knows whether what came before is of the same
            part.unlink(missing_ok=True)
        fetch_behind(client, url, part, most, entry.version)
        came = part.stat().st_size
        if entry.size is not None and came < entry.size:
            raise ShortAnswerError(f"{came:,} of {entry.size:,} bytes came")

    if entry.size is None or not part.exists() or part.stat().st_size < entry.size:
        tried(url, fetch)
    if entry.size is None and part.stat().st_size > most:
        part.unlink()
        raise StorageError(
            "states no size, and is larger than half of what is free on the disk",
            where=url,
            fix="have the server state the size of files (Content-Length)",
        )


def sha256_stated(url: Url) -> str | None:
    """Return the SHA-256 that a storage itself has computed of a file, or None."""
    if url.scheme != "s3":
        return stat(url).sha256
    client = client_of(url)
    bucket, key, _ = client.split_path(url.path)
    head = tried(
        url, lambda: client.call_s3("head_object", Bucket=bucket, Key=key, ChecksumMode="ENABLED")
    )
    stated = head.get("ChecksumSHA256")
    if stated is None or "-" in stated:  # of several parts it is a checksum of checksums
        return None
    return base64.b64decode(stated).hex()
