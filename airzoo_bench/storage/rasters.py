"""Rasters at URLs: opened where they lie, by GDAL's virtual files, which read windows only.

In a mirror an empty file stands for a raster, and a pointer beside the mirror says where it lies.
Its SHA-256 is what the storage itself has computed (see `remote.sha256_at`); where it has none,
the raster is read through once, and the pointer keeps what was found.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from urllib.parse import urlsplit
from uuid import uuid4

from airzoo_bench.core.files import atomic_write
from airzoo_bench.storage.mirror import Mirror, absent_is_absent, folder_mirror, mirror_of
from airzoo_bench.storage.remote import Entry, client_of, sha256_at, stat
from airzoo_bench.storage.urls import Url, url_of

__all__ = ["RASTERS", "Pointer", "here", "pointed", "pointed_sha256", "pointer_at"]

RASTERS = (".tif", ".tiff", ".vrt")
"""Endings of files that a mirror points to."""
_POINTERS = ".pointers"


@dataclass(frozen=True)
class Pointer:
    """Where a raster lies.

    Attributes
    ----------
    url : str
    version : str
        Of its content, see `remote.Entry`.
    sha256 : str or None
        As far as it is known.
    """

    url: str
    version: str
    sha256: str | None = None

    @property
    def place(self) -> Url:
        """The URL."""
        url = url_of(self.url)
        assert url is not None, "written by point"
        return url

    @property
    def virtual(self) -> str:
        """The name by which GDAL opens it."""
        if self.place.scheme == "s3":
            return f"/vsis3/{self.place.path}"
        if self.place.scheme == "gs":
            return f"/vsigs/{self.place.path}"
        if self.place.scheme == "hf":
            return f"/vsicurl/{client_of(self.place).url(self.place.address)}"
        return f"/vsicurl/{self.place.address}"

    def without_secrets(self, text: str) -> str:
        """Return what GDAL says, without the password and the signature of the URL."""
        login, at, _ = self.place.path.partition("/")[0].rpartition("@")
        for secret in filter(None, (f"{login}{at}", self.place.query)):
            text = text.replace(secret, "…")
        return text

    def settings(self) -> dict[str, str]:
        """Return GDAL's settings for it; keys it finds in the environment itself."""
        # Files beside a raster are asked for by name: to list a folder of thousands takes longer.
        found = {
            "GDAL_DISABLE_READDIR_ON_OPEN": "TRUE",
            "GDAL_HTTP_CONNECTTIMEOUT": "5",
            "GDAL_HTTP_LOW_SPEED_TIME": "60",
            "GDAL_HTTP_LOW_SPEED_LIMIT": "1",
            "GDAL_HTTP_MAX_RETRY": "4",
            "GDAL_HTTP_RETRY_DELAY": "0.3",
        }
        return found | dict(_of_scheme(self.place.scheme))


def _of_scheme(scheme: str) -> Iterator[tuple[str, str]]:
    endpoint = os.environ.get("AWS_ENDPOINT_URL_S3") or os.environ.get("AWS_ENDPOINT_URL")
    if scheme == "s3" and endpoint:
        address = urlsplit(endpoint)
        yield "AWS_S3_ENDPOINT", address.netloc + address.path.rstrip("/")
        yield "AWS_HTTPS", "YES" if address.scheme == "https" else "NO"
        yield "AWS_VIRTUAL_HOSTING", "FALSE"
    emulator = os.environ.get("STORAGE_EMULATOR_HOST")
    if scheme == "gs" and emulator:
        yield "CPL_GS_ENDPOINT", emulator.rstrip("/") + "/"
    token = os.environ.get("HF_TOKEN")
    if scheme == "hf" and token:
        yield "GDAL_HTTP_HEADERS", f"Authorization: Bearer {token}"


def here(location: str | Path) -> Path:
    """Return a path on this machine with what lies at a location; a raster stays where it is."""
    url = url_of(location)
    if url is None:
        return Path(location)
    says_folder = url.says_folder and not url.read_only  # a web server says so itself
    entry = None if says_folder else stat(url)
    if entry is None or entry.is_folder:
        return folder_mirror(url).tree
    # Of what has no version nobody knows whether it is still the same.
    mirror = Mirror.of(url.parent, f"{url.name} {entry.version or uuid4()}")
    if url.name.lower().endswith(RASTERS):
        return point(mirror, url.name, entry)
    return mirror.fetch(url.name, entry)


def pointed(path: Path) -> Path:
    """Return the path of a raster; in a mirror, with a pointer to where it lies."""
    found = None if path.exists() else mirror_of(path)
    if found is not None:
        with absent_is_absent():
            point(*found)
    return path


def point(mirror: Mirror, name: str, entry: Entry | None = None) -> Path:
    """Return the path of a raster in a mirror, an empty file, and keep where the raster lies."""
    url, target = mirror.url.child(name), mirror.tree / name
    entry = entry or stat(url)
    _write(_pointer_file(mirror, name), Pointer(url.address, entry.version))
    with atomic_write(target):
        pass
    return target


def pointer_at(path: Path) -> Pointer | None:
    """Return where the raster lies for which a mirror has an empty file; None of any other path."""
    found = mirror_of(path)
    file = None if found is None else _pointer_file(*found)
    if file is None or not file.is_file():
        return None
    return Pointer(**json.loads(file.read_text(encoding="utf-8")))


def _pointer_file(mirror: Mirror, name: str) -> Path:
    # Beside the tree: what comes from a storage must not be able to point anywhere.
    return mirror.tree.parent / _POINTERS / f"{name}.json"


def _write(file: Path, pointer: Pointer) -> None:
    with atomic_write(file, "w") as stream:
        json.dump(asdict(pointer), stream)
    file.chmod(0o600)  # a signed URL is a secret


def pointed_sha256(path: Path, pointer: Pointer) -> str:
    """Return the SHA-256 of a raster that lies elsewhere, and keep it with the pointer."""
    now = stat(pointer.place)
    if pointer.sha256 is not None and now.version and pointer.version == now.version:
        return pointer.sha256
    found = sha256_at(pointer.place)
    mirrored = mirror_of(path)
    if mirrored is not None:
        _write(_pointer_file(*mirrored), replace(pointer, version=now.version, sha256=found))
    return found
