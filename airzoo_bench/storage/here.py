"""Locations on any machine: what a task of a cluster holds, and what it finds by it."""

from __future__ import annotations

from pathlib import Path
from uuid import uuid4

from airzoo_bench.storage.faults import settled
from airzoo_bench.storage.mirror import Mirror, folder_mirror, mirror_of
from airzoo_bench.storage.rasters import RASTERS, point
from airzoo_bench.storage.remote import stat
from airzoo_bench.storage.urls import Url, url_of

__all__ = ["here", "location_of"]


def here(location: str | Path) -> Path:
    """Return a path on this machine with what lies at a location."""
    url = url_of(location)
    if url is None:
        return Path(location)
    return settled(lambda: _mirrored(url))


def _mirrored(url: Url) -> Path:
    says_folder = url.says_folder and not url.read_only  # a web server says so itself
    entry = None if says_folder else stat(url)
    if entry is None or entry.is_folder:
        return folder_mirror(url).tree
    # Of what has no version nobody knows whether it is still the same.
    mirror = Mirror.of(url.parent, f"{url.name} {entry.version or uuid4()}")
    if url.name.lower().endswith(RASTERS):
        return point(mirror, url.name, entry)
    return mirror.fetch(url.name, entry)


def location_of(path: Path) -> str:
    """Return where another machine finds what lies at a path: the URL if it is mirrored."""
    found = mirror_of(path)
    if found is None:
        return str(path)
    mirror, name = found
    url = mirror.url.child(name) if name else mirror.url
    return f"{url.address}/" if path.is_dir() and not url.read_only else url.address
