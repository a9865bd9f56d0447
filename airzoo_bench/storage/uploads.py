"""Folders that are written at URLs: filled here, then uploaded; the file that counts goes last."""

from __future__ import annotations

import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from uuid import uuid4

from airzoo_bench.core.errors import StorageError, UsageError
from airzoo_bench.storage.faults import tried
from airzoo_bench.storage.mirror import Mirror, cache_folder
from airzoo_bench.storage.remote import client_of, files, find
from airzoo_bench.storage.urls import Url

__all__ = ["check_writable", "uploaded"]

_PROBE = ".airzoo-part"


def check_writable(url: Url) -> None:
    """Refuse, before any work, a place where nothing can be written."""
    if url.read_only:
        raise UsageError(
            "can only be read from",
            where=f"--out {url}",
            expected="a folder, or a URL of s3://, gs:// or hf://",
        )
    with TemporaryDirectory() as folder:
        empty = Path(folder, _PROBE)
        empty.touch()
        _put(empty, url.child(_PROBE))
    _delete(url.child(_PROBE))


@contextmanager
def uploaded(url: Url, last: str, replaced: Collection[str]) -> Iterator[Path]:
    """Fill a folder of this machine, and upload it in place of what was uploaded there before."""
    folder = Mirror.of(url, str(uuid4())).tree
    try:
        yield folder
        _upload(folder, url, last, replaced)
    except StorageError as error:
        kept = folder.parent.rename(cache_folder() / f"unsent-{uuid4().hex[:12]}") / folder.name
        error.fix = f"{error.fix or 'mend it'}; what was made is kept in {kept}"
        raise
    finally:
        shutil.rmtree(folder.parent, ignore_errors=True)


def _upload(folder: Path, url: Url, last: str, replaced: Collection[str]) -> None:
    new = [path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()]
    _delete(url.child(last))
    for name in sorted(set(new) - {last}):
        _put(folder / name, url.child(name))
    for name in files(url):
        if name not in new and name.partition("/")[0] in replaced:
            _delete(url.child(name))
    _put(folder / last, url.child(last))


def _put(path: Path, url: Url) -> None:
    """Upload a file; it appears under its name whole, or not at all."""
    client = client_of(url)
    tried(url, lambda: client.put_file(str(path), url.address))


def _delete(url: Url) -> None:
    """Remove a file, if it is there."""
    if find(url) is not None:
        client = client_of(url)
        tried(url, lambda: client.rm_file(url.address))
