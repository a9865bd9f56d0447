"""Files at URLs, which fsspec copies into a cache folder.

The copy of ``s3://bucket/name`` is ``<cache>/s3/bucket/name``, so that a path says its URL;
``<cache>/versions`` says which version it is.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import quote

from platformdirs import user_cache_path

from airzoo_bench.core.errors import StorageError, UsageError, UserError
from airzoo_bench.core.files import atomic_write
from airzoo_bench.core.registry import resolve

T = TypeVar("T")

SCHEMES = ("s3", "gs", "hf", "https", "http")
_BUGS = (AssertionError, AttributeError, LookupError, NameError, TypeError)  # of no storage


class AbsentError(StorageError):
    """Nothing lies at a URL."""


def url_of(location: str | Path) -> str | None:
    """Return the URL that a location is, or None where it is a path."""
    scheme, mark, rest = str(location).partition("://")
    if not mark:
        return None
    names = rest.partition("?")[0].rstrip("/").split("/")
    is_odd = {"", ".", ".."} & set(names) or {"\\", "\0"} & set(rest) or "?versionId=" in rest
    if scheme.lower() not in SCHEMES or is_odd or "@" in names[0]:
        expected = f"{', '.join(f'{one}://' for one in SCHEMES)}, then a bucket or host and names"
        what, fix = "no URL as they are read", "names and passwords belong into ~/.netrc"
        raise UsageError(what, where=f"{scheme}://…", expected=expected, fix=fix)
    return f"{scheme.lower()}://{rest}"


def cache_folder() -> Path:
    """Return the folder of copies: AIRZOO_BENCH_CACHE, else one of the user's cache."""
    named = os.environ.get("AIRZOO_BENCH_CACHE")
    return Path(named).expanduser().absolute() if named else user_cache_path("airzoo-bench/mirrors")


def path_of(url: str) -> Path:
    """Return the path of the copy of a file or folder, which may not be there."""
    scheme, _, rest = url.partition("://")
    return cache_folder() / scheme / rest.partition("?")[0].strip("/")


def url_at(path: Path) -> str | None:
    """Return the URL that a path was copied from, or None."""
    place = Path(os.path.normpath(path.absolute()))  # names in a manifest may have ".."
    if not place.is_relative_to(cache_folder()):
        return None
    scheme, _, rest = place.relative_to(cache_folder()).as_posix().partition("/")
    rest = quote(rest, "/:[]%") if scheme.startswith("http") else rest
    return f"{scheme}://{rest}" if scheme in SCHEMES and rest else None


@contextmanager
def client_of(url: str) -> Iterator[Any]:
    """Yield fsspec's file system of a URL, and turn what it raises into one message."""
    scheme, where = url.partition("://")[0], url.partition("?")[0]  # behind ? may be a signature
    settings: dict[str, Any] = {}
    try:
        if scheme == "s3":
            unsigned = os.environ.get("AWS_NO_SIGN_REQUEST", "").upper() in ("YES", "TRUE", "1")
            retries = {"retries": {"total_max_attempts": 3}}
            settings = {"anon": unsigned, "config_kwargs": retries}
        elif scheme.startswith("http"):
            limit = resolve("aiohttp:ClientTimeout")(total=None, sock_connect=5, sock_read=60)
            settings = {"client_kwargs": {"timeout": limit, "trust_env": True}}
        client = resolve("fsspec:filesystem")(scheme, use_listings_cache=False, **settings)
        client.invalidate_cache()
        yield client
    except ImportError as error:
        what = f"{scheme}:// needs packages that are not installed ({error})"
        fix = "pip install 'airzoo-bench[storage,download]'"
        raise UsageError(what, where=where, fix=fix) from error
    except (UserError, *_BUGS):
        raise
    except Exception as error:  # of many libraries
        causes = (error, error.__cause__)
        codes = (getattr(one, name, None) for one in causes for name in ("status", "code"))
        status = next((code for code in codes if isinstance(code, int)), None)
        if status == 404 or (status is None and isinstance(error, FileNotFoundError)):
            fix = "check bucket, name, and the endpoint if any"
            raise AbsentError("no such file or folder", where=where, fix=fix) from error
        # A client's own words may hold passwords and signatures.
        why = getattr(error, "strerror", None) or f"{type(error).__name__} {status or ''}".strip()
        is_denied = isinstance(error, PermissionError) or status in (401, 403)
        what = "access is denied" if is_denied else f"cannot be read: {why}"
        fix = "check credentials (docs/scale.md), network and AWS_ENDPOINT_URL, or try again later"
        raise StorageError(what, where=where, fix=fix) from error


def in_parallel(call: Callable[[T], Path], arguments: Iterable[T]) -> set[Path]:
    """Call a function that waits for a storage for each of the arguments, eight at once."""
    with ThreadPoolExecutor(8) as pool:
        return set(pool.map(call, arguments))


def fetch_listed(client: Any, names: Iterable[str]) -> set[Path]:
    """Copy the files that a file system lists by these names; return the paths of the copies."""
    urls = (url_of(client.unstrip_protocol(name)) for name in names)
    return in_parallel(fetch, filter(None, urls))


def fetch(url: str) -> Path:
    """Copy a file where its version is another than the copy's; return the path of the copy."""
    path = path_of(url)
    stamp = cache_folder() / "versions" / path.relative_to(cache_folder())
    with client_of(url) as client:
        version = repr(client.info(url))
        if not (path.is_file() and stamp.is_file() and stamp.read_text("utf-8") == version):
            with atomic_write(path) as stream:
                client.get_file(url, stream.name)
            with atomic_write(stamp, "w") as stream:
                stream.write(version)
    return path


@cache
def ensure_file(path: Path) -> Path:
    """Return a path, and fetch the file first, once a run, if it is a copy from a URL."""
    url = url_at(path)
    try:
        return path if url is None else fetch(url)
    except AbsentError:
        path.unlink(missing_ok=True)
        return path


def local_path(location: str | Path) -> Path:
    """Return a path of this machine with the file or folder that a location names."""
    url = url_of(location)
    if url is None:
        return Path(location)
    with client_of(url) as client:
        # A web server would send a whole file to be asked whether it is a folder.
        is_web = url.startswith("http")
        if not (url.endswith("/") or (not is_web and client.isdir(url))):
            return fetch(url)
        copies = fetch_listed(client, client.find(url))
    if not copies:
        raise AbsentError("no such file or folder, or an empty one", where=url)
    for old in path_of(url).rglob("*"):
        if old.is_file() and old not in copies:
            old.unlink()
    return path_of(url)
