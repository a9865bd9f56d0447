"""What lies below a URL, page by page, so that what has no end is not listed to its end."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import partial
from itertools import islice
from typing import Any
from urllib.parse import unquote

from airzoo_bench.core.errors import StorageError
from airzoo_bench.storage.faults import tried
from airzoo_bench.storage.remote import Entry, client_of, entry_of, stat
from airzoo_bench.storage.urls import Url

__all__ = ["files", "matching", "names"]

_LONGEST_LIST = 1_000_000
_PAGE = 1_000
_MOST_FOLDERS, _DEEPEST = 1_000, 16
"""Of a web server, which shows each folder as a page."""
_FILE, _FOLDER = Entry(None, ""), Entry(None, "", is_folder=True)
_AT_ONCE = 8


def files(url: Url) -> dict[str, Entry]:
    """List all files below a folder by their relative names, in their order."""
    found = _below(url, deep=True)
    listed = sorted(name for name, entry in found.items() if not entry.is_folder)
    if url.read_only:  # the page of a folder says no more than names
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            return dict(
                zip(listed, pool.map(lambda one: stat(url.child(one)), listed), strict=True)
            )
    return {name: found[name] for name in listed}


def names(url: Url, *, folders: bool = False) -> list[str]:
    """List what lies in a folder, one level deep; nothing where a web server lists nothing."""
    try:
        found = _below(url, deep=False)
    except StorageError as error:
        if error.what.startswith("no such"):
            return []
        raise
    return sorted(
        name
        for name, entry in found.items()
        if "/" not in name and (entry.is_folder or not folders)
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


def _below(url: Url, *, deep: bool) -> dict[str, Entry]:
    """Return what lies below a folder, with the folders in it where it is not `deep`."""
    pages = {"s3": _s3_pages, "gs": _gs_pages, "hf": _hf_page}.get(url.scheme, _web_pages)
    found: dict[str, Entry] = {}
    for page in pages(url, deep=deep):
        found |= page
        if len(found) > _LONGEST_LIST:
            raise StorageError(
                f"holds more than {_LONGEST_LIST:,} files",
                where=url,
                fix="name the folder that holds what is meant, and nothing else",
            )
    # An object whose name ends with a slash marks a folder; that of the folder itself is empty.
    return {name: one for name, one in found.items() if name and not name.endswith("/")}


def _s3_pages(url: Url, *, deep: bool) -> Iterator[dict[str, Entry]]:
    client = client_of(url)
    bucket, folder, _ = client.split_path(url.path)
    prefix = f"{folder}/" if folder else ""
    asked = {"Bucket": bucket, "Prefix": prefix, "MaxKeys": _PAGE}
    asked |= {} if deep else {"Delimiter": "/"}
    while True:
        page = tried(url, partial(client.call_s3, "list_objects_v2", **asked))
        folders = (one["Prefix"] for one in page.get("CommonPrefixes", []))
        yield {
            one["Key"].removeprefix(prefix): entry_of(one | {"size": one["Size"]})
            for one in page.get("Contents", [])
        } | {name.removeprefix(prefix)[:-1]: _FOLDER for name in folders}
        if not page.get("IsTruncated"):
            return
        asked["ContinuationToken"] = page["NextContinuationToken"]


def _gs_pages(url: Url, *, deep: bool) -> Iterator[dict[str, Entry]]:
    client = client_of(url)
    bucket, slash, folder = url.path.partition("/")
    prefix = f"{folder}/" if slash else ""
    asked: dict[str, Any] = {"prefix": prefix or None, "maxResults": _PAGE, "json_out": True}
    asked |= {} if deep else {"delimiter": "/"}
    while True:
        page = tried(url, partial(client.call, "GET", "b/{}/o", bucket, **asked))
        folders = page.get("prefixes", [])
        yield {one["name"].removeprefix(prefix): entry_of(one) for one in page.get("items", [])} | {
            name.removeprefix(prefix)[:-1]: _FOLDER for name in folders
        }
        if not page.get("nextPageToken"):
            return
        asked["pageToken"] = page["nextPageToken"]


def _hf_page(url: Url, *, deep: bool) -> Iterator[dict[str, Entry]]:
    """Yield one page: with a list that broke off nobody can go on."""
    yield tried(url, lambda: dict(islice(_hf_tree(url, deep=deep), _LONGEST_LIST + 1)))


def _hf_tree(url: Url, *, deep: bool) -> Iterator[tuple[str, Entry]]:
    from huggingface_hub import HfApi

    client = client_of(url)  # which itself lists all before it returns anything
    place, api = client.resolve_path(url.address), HfApi(client.endpoint, client.token)
    if hasattr(place, "bucket_id"):
        base = place.path
        shown: Iterable[Any] = api.list_bucket_tree(place.bucket_id, base or None, recursive=deep)
    else:
        base, asked = place.path_in_repo, {"revision": place.revision, "repo_type": place.repo_type}
        shown = api.list_repo_tree(place.repo_id, base or None, recursive=deep, **asked)
    for one in shown:
        if not base or one.path.startswith(f"{base}/"):
            is_file = hasattr(one, "size")
            yield one.path[len(base) :].lstrip("/"), entry_of(vars(one)) if is_file else _FOLDER


def _web_pages(url: Url, *, deep: bool) -> Iterator[dict[str, Entry]]:
    client = client_of(url)
    waiting, known = [url], {url}
    while waiting:
        folder = waiting.pop(0)
        shown = tried(url, partial(client.ls, f"{folder.address}/", detail=False))
        found = {_relative(url, one) for one in shown if not one.endswith("/./")}
        folders = sorted(name.rstrip("/") for name in found if name.endswith("/"))
        yield dict.fromkeys(found, _FILE) | dict.fromkeys(folders, _FOLDER)
        new = [one for one in map(url.child, folders if deep else ()) if one not in known]
        waiting += new
        known.update(new)
        _check_end(url, folder, len(known))


def _check_end(url: Url, folder: Url, count: int) -> None:
    """Refuse a server that shows a page of links wherever it is asked."""
    deep = folder.path.count("/") - url.path.count("/")
    if count > _MOST_FOLDERS or deep > _DEEPEST:
        raise StorageError(
            f"shows more than {_MOST_FOLDERS:,} folders, or folders in folders for more than "
            f"{_DEEPEST} levels",
            where=url,
            expected="a folder of files, listed as nginx and Apache do",
            fix="name the folder that holds what is meant; a server that answers any address with "
            "a page of its own, such as a web application, cannot be read from",
        )


def _relative(url: Url, name: str) -> str:
    """Return a listed name as seen from its folder; empty for the folder itself."""
    path = name.partition("://")[2]
    if not path.startswith(f"{url.path}/"):
        return ""
    return unquote(path.split("?")[0][len(url.path) + 1 :])
