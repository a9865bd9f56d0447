"""What a storage holds, through fsspec; clients are imported when a URL is first asked for."""

from __future__ import annotations

import base64
import hashlib
import importlib
import os
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import unquote
from uuid import uuid4

from airzoo_bench.core.errors import StorageError, UsageError
from airzoo_bench.storage.faults import ShortAnswerError, tried
from airzoo_bench.storage.urls import Url

__all__ = [
    "AT_ONCE",
    "Entry",
    "client_of",
    "download",
    "files",
    "find",
    "matching",
    "names",
    "sha256_at",
    "stat",
]

AT_ONCE = 8
"""Requests under way at one time."""
_MOST_FOLDERS = 1_000
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
        headers = {"Accept-Encoding": "identity"}  # sizes are those of the files
        return {"client_kwargs": {"timeout": timeout, "trust_env": True, "headers": headers}}
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


def _refreshed(url: Url) -> dict[str, bool]:
    return {"refresh": True} if url.scheme in ("s3", "hf") else {}


def _fresh(client: Any, url: Url) -> dict[str, bool]:
    if url.scheme != "hf":
        return _refreshed(url)
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


def files(url: Url) -> dict[str, Entry]:
    """List all files below a folder by their relative names, in their order."""
    if url.read_only:  # the page of a folder says no more than names
        listed = sorted(_web_files(url))
        with ThreadPoolExecutor(AT_ONCE) as pool:
            entries = pool.map(lambda name: stat(url.child(name)), listed)
            return dict(zip(listed, entries, strict=True))
    client = client_of(url)
    found = tried(url, lambda: client.find(url.address, detail=True, **_refreshed(url)))
    below = {_relative(url, path): entry_of(info) for path, info in found.items()}
    return {name: below[name] for name in sorted(below) if name and not name.endswith("/")}


def names(url: Url, *, folders: bool = False) -> list[str]:
    """List what lies in a folder, one level deep; nothing where there is no such folder."""
    client = client_of(url)
    address = f"{url.address}/" if url.read_only else url.address
    try:
        listed = tried(url, lambda: client.ls(address, detail=True, **_refreshed(url)))
    except StorageError as error:
        if error.what.startswith("no such"):
            return []
        raise
    found = {_relative(url, one["name"]).rstrip("/"): one["type"] for one in listed}
    return sorted(
        name
        for name, kind in found.items()
        if name not in ("", ".") and "/" not in name and (kind == "directory" or not folders)
    )


def matching(url: Url) -> list[Url]:
    """Return the places that a URL with ``*`` in its names means; of any other, itself."""
    if "*" not in url.path:
        return [url]
    first, *rest = url.path.split("/")
    found = [replace(url, path=first)]
    for part in rest:
        if "*" in part:
            found = [
                one.child(name) for one in found for name in names(one) if fnmatchcase(name, part)
            ]
        else:
            found = [replace(one, path=f"{one.path}/{part}") for one in found]
    if not found:
        raise StorageError("no such file or folder", where=url)
    return found


def _web_files(url: Url) -> Iterator[str]:
    """Follow the pages of folders on a web server, downwards only."""
    client = client_of(url)
    waiting = [url]
    for count, folder in enumerate(waiting):
        if count == _MOST_FOLDERS:
            raise StorageError(
                f"shows more than {_MOST_FOLDERS:,} folders",
                where=url,
                expected="a folder of files, listed as nginx and Apache do",
                fix="name the folder that holds what is meant",
            )
        shown = tried(url, partial(client.ls, f"{folder.address}/", detail=False))
        for name in {_relative(url, one) for one in shown if not one.endswith("/./")} - {""}:
            if not name.endswith("/"):
                yield name
            elif url.child(name[:-1]) not in waiting:
                waiting.append(url.child(name[:-1]))


def _relative(url: Url, listed: str) -> str:
    """Return a listed name as seen from its folder; empty for what does not lie in it."""
    base = url.path
    if url.read_only:
        base, listed = unquote(base), unquote(listed.partition("://")[2].split("?")[0])
    elif url.scheme == "hf":
        base = client_of(url).resolve_path(url.address).unresolve()
    return listed[len(base) + 1 :] if listed.startswith(f"{base}/") else ""


def download(url: Url, entry: Entry, target: Path) -> None:
    """Fetch a file whole; `target` appears when all of it is there."""
    client = client_of(url)
    part = target.with_name(f".{uuid4().hex[:12]}.partial")

    def fetch() -> None:
        client.get_file(url.address, str(part))
        size = part.stat().st_size
        if entry.size not in (None, size):
            raise ShortAnswerError(f"{size:,} of {entry.size:,} bytes came")

    try:
        tried(url, fetch)
        part.replace(target)
    finally:
        part.unlink(missing_ok=True)


def sha256_at(url: Url) -> str:
    """Return a file's SHA-256: as the storage has computed it, else by reading it through."""
    return _sha256_stated(url) or tried(url, partial(_sha256_read, url))


def _sha256_read(url: Url) -> str:
    digest = hashlib.sha256()
    with client_of(url).open(url.address, "rb", block_size=_PIECE_BYTES) as stream:
        while piece := stream.read(_PIECE_BYTES):
            digest.update(piece)
    return digest.hexdigest()


def _sha256_stated(url: Url) -> str | None:
    """Return the SHA-256 that a storage itself has computed, if any."""
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
